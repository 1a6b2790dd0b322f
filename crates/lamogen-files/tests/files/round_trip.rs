//! Motions are written and read back.

use crate::figure::position_at;
use glam::{DQuat, DVec3, Vec3};
use lamogen_files::bvh::{BvhNames, BvhOptions};
use lamogen_files::{ReadOptions, Unit, UpAxis, WriteOptions, read, write};
use lamogen_motion::{Joint, Motion, Rotations};

/// Returns a motion of a body that turns around, goes upside down and moves every joint.
fn acrobat(frames: usize) -> Motion {
    let pose = |frame: usize| {
        let wave = |joint: usize, speed: f64, most: f64| {
            most * (frame as f64 * speed + joint as f64 * 1.9).sin()
        };
        let mut places = [(DVec3::ZERO, DQuat::IDENTITY); 22];
        for joint in Joint::ALL {
            let j = joint.index();
            places[j] = match joint.parent() {
                None => {
                    let spin = DQuat::from_rotation_y(frame as f64 * 0.13);
                    let place = DVec3::new(wave(0, 0.05, 2.0), 1.0, wave(1, 0.04, 3.0));
                    (place, spin * DQuat::from_rotation_x(wave(2, 0.03, 4.0)))
                }
                Some(parent) => {
                    let (place, turn) = places[parent.index()];
                    let bone = position_at(joint.name(), 0.0) - position_at(parent.name(), 0.0);
                    let bend = DQuat::from_rotation_z(wave(j, 0.07, 0.5))
                        * DQuat::from_rotation_x(wave(j, 0.11, 0.6));
                    (place + turn * bone, turn * bend)
                }
            };
        }
        places.map(|(place, _)| place.as_vec3().to_array())
    };
    Motion::from_joints((0..frames).map(pose).collect()).unwrap()
}

/// Returns the largest distance between the joints of two motions.
fn largest_distance(a: &[[[f32; 3]; 22]], b: &[[[f32; 3]; 22]]) -> f32 {
    assert_eq!(a.len(), b.len());
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs
        .map(|(a, b)| Vec3::from(*a).distance(Vec3::from(*b)))
        .fold(0.0, f32::max)
}

#[test]
fn bvh_keeps_every_joint_to_a_tenth_of_a_millimetre() {
    let motion = acrobat(200);
    let rotations = Rotations::of(&motion);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("acrobat.bvh");
    for unit in [Unit::Centimetre, Unit::Metre] {
        for names in [BvhNames::HumanMl3d, BvhNames::Mixamo] {
            let options = WriteOptions {
                bvh: BvhOptions { unit, names },
                ..WriteOptions::default()
            };
            write(&path, &motion, &options).unwrap();
            let imported = read(&path, &ReadOptions::default()).unwrap();
            assert_eq!((imported.unit, imported.up), (unit, UpAxis::Y));
            assert!(imported.placed.is_empty());
            let far = largest_distance(imported.motion.joints(), &rotations.joints());
            assert!(far < 1e-4, "{unit} {names:?}: {far} m");
        }
    }
}

#[test]
fn bvh_at_another_frame_rate_is_the_same_motion() {
    let motion = acrobat(81);
    let expected = Rotations::of(&motion).joints();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("acrobat.bvh");
    for frames_per_second in [60.0, 120.0] {
        let options = WriteOptions {
            frames_per_second: Some(frames_per_second),
            ..WriteOptions::default()
        };
        write(&path, &motion, &options).unwrap();
        let imported = read(&path, &ReadOptions::default()).unwrap();
        let far = largest_distance(imported.motion.joints(), &expected);
        assert!(far < 1e-4, "{frames_per_second}: {far} m");
    }
}

#[test]
fn features_written_are_features_read() {
    use burn::tensor::{Device, Tensor, TensorData};
    let values: Vec<f32> = (0..30 * 263).map(|i| (i as f32 * 0.7).sin()).collect();
    let data = TensorData::new(values, [30, 263]);
    let motion = Motion::from_features(Tensor::from_data(data, &Device::flex())).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.features.npy");
    write(&path, &motion, &WriteOptions::default()).unwrap();
    let imported = read(&path, &ReadOptions::default()).unwrap();
    assert!(largest_distance(imported.motion.joints(), motion.joints()) < 1e-4);
}
