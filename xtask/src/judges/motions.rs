//! Motions from formulas for checking files. They pass through all headings and turn upside down.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DQuat, DVec3};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Motion};

use Joint::*;

/// A pose: the position of the pelvis, and the rotation of every joint relative to its parent.
struct Pose {
    root: DVec3,
    rotations: [DQuat; JOINTS],
}

/// Returns all motions with their names.
pub fn named_motions() -> Vec<(&'static str, Motion)> {
    vec![
        ("walk", motion(60, walk)),
        ("turning", motion(100, turning)),
        ("cartwheel", motion(60, cartwheel)),
    ]
}

/// Returns a pose of walking forwards, three steps in each second and a half.
fn walk(time: f64) -> Pose {
    let phase = time * TAU;
    let mut pose = standing();
    pose.root += DVec3::new(0.0, 0.03 * (2.0 * phase).cos(), 1.2 * time);
    for (side, hip, knee, ankle, shoulder, elbow) in [
        (1.0, LeftHip, LeftKnee, LeftAnkle, LeftShoulder, LeftElbow),
        (
            -1.0,
            RightHip,
            RightKnee,
            RightAnkle,
            RightShoulder,
            RightElbow,
        ),
    ] {
        let swing = side * phase.sin();
        pose.bend(hip, DVec3::X, -0.5 * swing);
        pose.bend(
            knee,
            DVec3::X,
            0.35 - 0.3 * (phase + side * 0.8).cos() * side,
        );
        pose.bend(ankle, DVec3::X, -0.1 * swing);
        pose.bend(shoulder, DVec3::X, 0.4 * swing);
        pose.bend(elbow, DVec3::Y, -side * 0.5);
    }
    pose.bend(Pelvis, DVec3::Y, 0.1 * phase.sin());
    pose.bend(Spine3, DVec3::Y, -0.2 * phase.sin());
    pose
}

/// Returns a pose of turning on the spot, twice around in each direction, while bowing.
fn turning(time: f64) -> Pose {
    let mut pose = standing();
    pose.bend(Pelvis, DVec3::Y, 2.0 * TAU * (time * TAU / 5.0).sin());
    for joint in [Spine1, Spine2, Spine3] {
        pose.bend(joint, DVec3::X, 0.2 - 0.2 * (time * 2.0).cos());
    }
    pose.bend(Neck, DVec3::Y, 0.5 * (time * 3.0).sin());
    pose.bend(LeftShoulder, DVec3::Z, 1.2 * (time * 1.5).sin().abs());
    pose.bend(RightElbow, DVec3::Y, 1.8 * (time * 1.5).sin().abs());
    pose.bend(LeftCollar, DVec3::Z, 0.2 * (time * 1.5).sin().abs());
    pose
}

/// Returns a pose of a cartwheel: sideways over the hands, with arms and legs spread.
fn cartwheel(time: f64) -> Pose {
    let part = (time / 3.0).clamp(0.0, 1.0);
    let mut pose = standing();
    let angle = -TAU * part;
    pose.rotations[Pelvis.index()] = DQuat::from_rotation_z(angle);
    pose.root = DVec3::new(2.2 * part, 0.93 + 0.1 * (1.0 - angle.cos()) / 2.0, 0.0);
    for (side, hip, shoulder) in [
        (1.0, LeftHip, LeftShoulder),
        (-1.0, RightHip, RightShoulder),
    ] {
        pose.rotations[shoulder.index()] = DQuat::from_rotation_z(side * 0.9);
        pose.bend(hip, DVec3::Z, side * 0.6 * (part * TAU / 2.0).sin());
    }
    pose
}

/// Returns a standing pose with hanging arms.
fn standing() -> Pose {
    let mut pose = Pose {
        root: DVec3::Y * 0.93,
        rotations: [DQuat::IDENTITY; JOINTS],
    };
    pose.bend(LeftShoulder, DVec3::Z, 0.1 - FRAC_PI_2);
    pose.bend(RightShoulder, DVec3::Z, FRAC_PI_2 - 0.1);
    pose
}

impl Pose {
    /// Rotates a joint about an axis of its parent, after its previous rotation.
    fn bend(&mut self, joint: Joint, axis: DVec3, angle: f64) {
        let rotation = &mut self.rotations[joint.index()];
        *rotation = DQuat::from_axis_angle(axis, angle) * *rotation;
    }
}

/// Computes a motion from a function of the time in seconds.
fn motion(frames: usize, pose: fn(f64) -> Pose) -> Motion {
    let frames = (0..frames).map(|frame| {
        let Pose { root, rotations } = pose(frame as f64 / f64::from(FRAMES_PER_SECOND));
        let mut transforms = [(root, rotations[Pelvis.index()]); JOINTS];
        for joint in Joint::ALL {
            if let Some(parent) = joint.parent() {
                let (position, rotation) = transforms[parent.index()];
                transforms[joint.index()] = (
                    position + rotation * bone(joint),
                    rotation * rotations[joint.index()],
                );
            }
        }
        transforms.map(|(position, _)| position.as_vec3().to_array())
    });
    Motion::from_joints(frames.collect()).expect("formulas give finite positions")
}

/// Returns the joints of a T-pose. `sizes` are the sizes of legs, trunk and arms in units of those of the motions' body.
pub fn t_pose([legs, trunk, arms]: [f64; 3]) -> [[f32; 3]; JOINTS] {
    let mut positions = [DVec3::Y; JOINTS];
    for joint in Joint::ALL {
        let size = match joint {
            Pelvis | LeftHip | RightHip | LeftKnee | RightKnee | LeftAnkle | RightAnkle
            | LeftFoot | RightFoot => legs,
            LeftElbow | RightElbow | LeftWrist | RightWrist => arms,
            _ => trunk,
        };
        if let Some(parent) = joint.parent() {
            positions[joint.index()] = positions[parent.index()] + size * bone(joint);
        }
    }
    positions.map(|position| position.as_vec3().to_array())
}

/// Returns the position of a joint relative to its parent in metres, in the T-pose of a body of 1.7 m.
fn bone(joint: Joint) -> DVec3 {
    let [x, y, z] = match joint {
        Pelvis => [0.0; 3],
        LeftHip | RightHip => [0.07, -0.09, -0.01],
        LeftKnee | RightKnee => [0.0, -0.38, 0.0],
        LeftAnkle | RightAnkle => [0.0, -0.4, 0.0],
        LeftFoot | RightFoot => [0.0, -0.055, 0.125],
        Spine1 => [0.0, 0.11, -0.02],
        Spine2 => [0.0, 0.135, 0.0],
        Spine3 => [0.0, 0.055, 0.0],
        Neck => [0.0, 0.21, -0.03],
        Head => [0.0, 0.09, 0.0],
        LeftCollar | RightCollar => [0.075, 0.12, -0.02],
        LeftShoulder | RightShoulder => [0.11, 0.04, 0.0],
        LeftElbow | RightElbow => [0.26, 0.0, 0.0],
        LeftWrist | RightWrist => [0.25, 0.0, 0.0],
    };
    let mirrored = joint.mirrored().index() < joint.index();
    DVec3::new(if mirrored { -x } else { x }, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_motions_go_through_all_headings_and_upside_down() {
        let motions = named_motions();
        let [_, (_, turning), (_, cartwheel)] = &motions[..] else {
            panic!("three motions")
        };
        let heading = |frame: usize| {
            let [left, right] = [LeftHip, RightHip]
                .map(|hip| DVec3::from(turning.position(frame, hip).map(f64::from)));
            (left - right).z.atan2((left - right).x)
        };
        for quarter in 0..8 {
            let expected = f64::from(quarter) * TAU / 8.0 - TAU / 2.0;
            let is_near = |frame: usize| (heading(frame) - expected).abs() < 0.4;
            assert!((0..turning.frames()).any(is_near), "{expected}");
        }
        let is_upside_down = |frame: usize| {
            cartwheel.position(frame, Head)[1] < cartwheel.position(frame, Pelvis)[1] - 0.5
        };
        assert!((0..cartwheel.frames()).any(is_upside_down));
    }
}
