//! The turning of joints by the rotations of a file is measured for any skeleton.

use crate::figure::{Figure, Stance, position_at};
use glam::{DQuat, DVec3};
use lamogen_files::bvh::{self, BvhNames, BvhOptions, read_text};
use lamogen_files::glb::{self, GlbOptions};
use lamogen_files::{ImportedMotion, JointMapping, ReadError, ReadOptions, Unit, read};
use lamogen_motion::{JOINTS, Joint, JointTurning, Motion, Rotations};

/// Returns a motion of a body that turns slowly, bends its limbs, and tilts its head at one frame.
fn motion_with_twitch(frames: usize, twitch: usize, degrees: f64) -> Motion {
    let pose = |frame: usize| {
        let bend = DQuat::from_rotation_x(-0.6 - 0.02 * frame as f64);
        let mut places = [(DVec3::ZERO, DQuat::IDENTITY); JOINTS];
        for joint in Joint::ALL {
            let turn = match joint {
                Joint::Pelvis => DQuat::from_rotation_y(0.03 * frame as f64),
                Joint::LeftElbow | Joint::RightElbow => DQuat::from_rotation_z(0.5) * bend,
                Joint::LeftKnee | Joint::RightKnee => bend.inverse(),
                // The axis is perpendicular to the bone to the head, which is in the plane of Y and Z.
                Joint::Neck if frame == twitch => DQuat::from_rotation_x(degrees.to_radians()),
                _ => DQuat::IDENTITY,
            };
            places[joint.index()] = match joint.parent() {
                None => (DVec3::Y, turn),
                Some(parent) => {
                    let (place, above) = places[parent.index()];
                    let bone = position_at(joint.name(), 0.0) - position_at(parent.name(), 0.0);
                    (place + above * bone, above * turn)
                }
            };
        }
        places.map(|(place, _)| place.as_vec3().to_array())
    };
    Motion::from_joints((0..frames).map(pose).collect()).unwrap()
}

/// Writes rotations in several formats and returns the turning of the files that are read back.
fn read_back(rotations: &Rotations) -> Vec<(&'static str, JointTurning)> {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("a.glb");
    glb::write(&glb, &rotations.clone().into(), &GlbOptions::default()).unwrap();
    let default = ReadOptions::default();
    let text = |options: BvhOptions| {
        let text = bvh::text(&rotations.clone().into(), &options);
        let imported = read_text(&text, &default, "a.bvh").unwrap();
        imported.turning.unwrap()
    };
    let mixamo = BvhOptions {
        names: BvhNames::Mixamo,
        unit: Unit::Metre,
    };
    vec![
        ("BVH", text(BvhOptions::default())),
        ("BVH, Mixamo's names", text(mixamo)),
        ("GLB", read(&glb, &default).unwrap().turning.unwrap()),
    ]
}

#[test]
fn a_twitch_of_one_joint_is_read_back_from_bvh_and_glb() {
    let rotations = Rotations::of(&motion_with_twitch(40, 23, 35.0));
    let expected = JointTurning::of(&rotations);
    for (format, found) in read_back(&rotations) {
        assert_eq!(found.steps().len(), 39, "{format}");
        for (frame, (found, expected)) in found.steps().iter().zip(expected.steps()).enumerate() {
            for joint in Joint::ALL {
                let [found, expected] = [found, expected].map(|step| step[joint.index()]);
                assert!(
                    (found - expected).abs() < 1e-2,
                    "{format}, {} at {frame}: {found}, not {expected}",
                    joint.name()
                );
            }
        }
        let worst = found.largest_without_pelvis();
        assert_eq!((worst.joint, worst.frame), (Joint::Neck, 23), "{format}");
        assert!((worst.degrees - 35.0).abs() < 0.1, "{format}: {worst:?}");
        assert_eq!(found.snaps(Joint::Neck, 30.0), 2, "{format}");
        let pelvis = f64::from(found.mean(Joint::Pelvis));
        assert!((pelvis - 0.03f64.to_degrees()).abs() < 1e-2, "{format}");
    }
}

#[test]
fn files_of_another_rate_turn_as_fast() {
    let rotations = Rotations::of(&motion_with_twitch(40, 23, 35.0));
    for rate in [60.0, 120.0] {
        for (format, found) in read_back(&rotations.resampled(rate)) {
            let worst = found.largest_without_pelvis();
            assert_eq!((worst.joint, worst.frame), (Joint::Neck, 23), "{format}");
            assert!((worst.degrees - 35.0).abs() < 0.1, "{format}: {worst:?}");
        }
    }
}

const TREE: &str = "\
pelvis Hips
 spine1 Spine
  spine3 Chest
   neck Neck
    head Head
   left_shoulder %Arm
    left_elbow %ForeArm
     left_wrist %Hand
 left_hip %UpLeg
  left_knee %Leg
   left_ankle %Foot";

/// Reads a figure that bends its left elbow and its right knee by 1.1 radians per second and turns by 0.6 radians per
/// second.
fn figure(stance: Stance) -> Result<ImportedMotion, ReadError> {
    let text = Figure {
        tree: TREE,
        sides: ["Left", "Right"],
        unit: 0.01,
        stance,
        frames_per_second: 30.0,
        frames: 31,
    }
    .text();
    let names = [
        ("pelvis", "Hips"),
        ("spine1", "Spine"),
        ("neck", "Neck"),
        ("head", "Head"),
    ];
    let limbs = [
        ("shoulder", "Arm"),
        ("elbow", "ForeArm"),
        ("wrist", "Hand"),
        ("hip", "UpLeg"),
        ("knee", "Leg"),
        ("ankle", "Foot"),
    ];
    let mut mapping = std::collections::BTreeMap::new();
    for (joint, name) in names {
        mapping.insert(joint.to_owned(), name.to_owned());
    }
    for (joint, name) in limbs {
        mapping.insert(format!("left_{joint}"), format!("Left{name}"));
        mapping.insert(format!("right_{joint}"), format!("Right{name}"));
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("names.json");
    std::fs::write(&path, serde_json::to_string(&mapping).unwrap()).unwrap();
    let options = ReadOptions {
        mapping: Some(JointMapping::read(&path).unwrap()),
        ..ReadOptions::default()
    };
    read_text(&text, &options, "figure.bvh")
}

#[test]
fn axes_rest_pose_and_missing_joints_do_not_change_the_turning() {
    let stances = [Stance::YUp, Stance::ZUp, Stance::Lying, Stance::RestYUp];
    for stance in stances {
        let imported = figure(stance).unwrap();
        let turning = imported.turning.unwrap();
        for joint in Joint::ALL {
            let expected = match joint {
                Joint::Pelvis => 0.6f64,
                Joint::LeftElbow | Joint::RightKnee => 1.1,
                _ => 0.0,
            };
            let expected = expected.to_degrees() / 20.0;
            let found = f64::from(turning.mean(joint));
            let far = (found - expected).abs();
            assert!(far < 1e-2, "{stance:?}, {}: {found}", joint.name());
        }
        for joint in [Joint::Spine3, Joint::LeftCollar, Joint::RightFoot] {
            assert!(imported.placed.contains(&joint), "{}", joint.name());
        }
    }
}

#[test]
fn an_array_has_no_rotations_to_measure() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    motion_with_twitch(5, 2, 10.0).save_joints(&path).unwrap();
    let imported = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(imported.turning, None);
}

#[test]
fn text_that_is_no_bvh_is_an_error_under_the_name_given() {
    let options = ReadOptions::default();
    let message = read_text("HIERARCHY\nROOT", &options, "in memory").unwrap_err();
    assert!(
        message.to_string().contains("in memory, line 2"),
        "{message}"
    );
}
