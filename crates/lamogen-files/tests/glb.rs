//! Motions are written as GLB files and read back through the public functions of the crate.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Quat, Vec3};
use lamogen_files::{ReadOptions, Unit, UpAxis, WriteOptions, read, write};
use lamogen_motion::{JOINTS, Joint, Motion, Rotations};

/// Returns a motion of a person who turns around, bends over and swings all limbs.
fn motion(frames: usize) -> Motion {
    let pose = |frame: usize| {
        let time = frame as f32 / 20.0;
        let mut placed = [(Vec3::ZERO, Quat::IDENTITY); JOINTS];
        for joint in Joint::ALL {
            let turn = match joint {
                Joint::Pelvis => {
                    Quat::from_rotation_y(TAU * time / 2.0)
                        * Quat::from_rotation_x(0.5 * time.sin())
                }
                Joint::LeftShoulder => Quat::from_rotation_z(time.sin() - FRAC_PI_2),
                Joint::RightShoulder => Quat::from_rotation_z(FRAC_PI_2 - time.sin()),
                other => Quat::from_rotation_x(0.3 * (time + other.index() as f32).sin()),
            };
            placed[joint.index()] = match joint.parent() {
                None => (Vec3::new(0.4 * time, 0.95, time.sin()), turn),
                Some(parent) => {
                    let (place, frame) = placed[parent.index()];
                    (place + frame * bone(joint), frame * turn)
                }
            };
        }
        placed.map(|(place, _)| place.to_array())
    };
    Motion::from_joints((0..frames).map(pose).collect()).unwrap()
}

fn bone(joint: Joint) -> Vec3 {
    use Joint::*;
    let left = match joint {
        Pelvis => [0.0; 3],
        LeftHip | RightHip => [0.07, -0.09, 0.0],
        LeftKnee | RightKnee => [0.0, -0.38, 0.0],
        LeftAnkle | RightAnkle => [0.0, -0.4, 0.0],
        LeftFoot | RightFoot => [0.0, -0.06, 0.12],
        Spine1 | Spine2 | Spine3 => [0.0, 0.11, 0.0],
        Neck => [0.0, 0.21, 0.0],
        Head => [0.0, 0.1, 0.0],
        LeftCollar | RightCollar => [0.08, 0.12, 0.0],
        LeftShoulder | RightShoulder => [0.1, 0.03, 0.0],
        LeftElbow | RightElbow => [0.26, 0.0, 0.0],
        LeftWrist | RightWrist => [0.25, 0.0, 0.0],
    };
    let side = match joint.name().starts_with("right") {
        true => -1.0,
        false => 1.0,
    };
    Vec3::from(left) * Vec3::new(side, 1.0, 1.0)
}

fn largest_gap(found: &Motion, expected: &[[[f32; 3]; JOINTS]]) -> f32 {
    assert_eq!(found.frames(), expected.len());
    let pairs = found.joints().iter().flatten();
    let pairs = pairs.zip(expected.iter().flatten());
    let gaps = pairs.map(|(&a, &b)| Vec3::from(a).distance(Vec3::from(b)));
    gaps.fold(0.0, f32::max)
}

#[test]
fn a_motion_is_read_back_to_a_tenth_of_a_millimetre() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.GLB");
    let motion = motion(60);
    write(&path, &motion, &WriteOptions::default()).unwrap();
    let back = read(&path, &ReadOptions::default()).unwrap();
    let gap = largest_gap(&back.motion, &Rotations::of(&motion).joints());
    assert!(gap < 1e-4, "{gap}");
    assert_eq!((back.unit, back.up), (Unit::Metre, UpAxis::Y));
    assert!((back.source_frames_per_second - 20.0).abs() < 1e-3);
}

#[test]
fn another_frame_rate_keeps_the_movement() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.glb");
    let motion = motion(61);
    let options = WriteOptions {
        frames_per_second: Some(60.0),
        ..WriteOptions::default()
    };
    write(&path, &motion, &options).unwrap();
    let back = read(&path, &ReadOptions::default()).unwrap();
    assert!((back.source_frames_per_second - 60.0).abs() < 1e-2);
    let gap = largest_gap(&back.motion, &Rotations::of(&motion).joints());
    assert!(gap < 1e-3, "{gap}");
}

#[test]
fn a_still_pose_is_a_file_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("still.glb");
    let motion = motion(1);
    write(&path, &motion, &WriteOptions::default()).unwrap();
    let back = read(&path, &ReadOptions::default()).unwrap();
    let gap = largest_gap(&back.motion, &Rotations::of(&motion).joints());
    assert!(gap < 1e-4, "{gap}");
}

#[test]
fn an_animation_is_chosen_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("jump.glb");
    let mut options = WriteOptions::default();
    options.glb.name = "jump".into();
    write(&path, &motion(5), &options).unwrap();
    let named = |name: &str| ReadOptions {
        animation: Some(name.into()),
        ..ReadOptions::default()
    };
    assert!(read(&path, &named("jump")).is_ok());
    let message = read(&path, &named("walk")).unwrap_err().to_string();
    assert!(
        ["jump.glb", "\"walk\"", "\"jump\""]
            .iter()
            .all(|part| message.contains(part)),
        "{message}"
    );
}
