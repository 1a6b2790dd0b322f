//! Measures how far joints turn from frame to frame.

use glam::DQuat;

use crate::motion::FRAMES_PER_SECOND;
use crate::rotations::Rotations;
use crate::skeleton::{JOINTS, Joint};

/// How far every joint turns from one frame to the next, in degrees a frame of 1/20 s.
///
/// Rotations are local, as in a rig: each joint turns in the frame of its parent, the pelvis in the world. This also
/// shows faults that joint positions do not show: a chest or a shoulder may flip about its own bone and back without
/// changing its position, and takes the whole body part below it the wrong way round between two frames.
///
/// The angle is that of the shortest turn from one rotation to the next, 0 to 180 degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct JointTurning {
    /// The angles of all joints from each frame to the next, in degrees.
    steps: Vec<[f32; JOINTS]>,
}

/// The turn of a joint from one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointTurn {
    /// The angle of the turn, in degrees.
    pub degrees: f32,
    /// The joint that turns.
    pub joint: Joint,
    /// The frame at the end of the turn; 0 if nothing turns.
    pub frame: usize,
}

impl JointTurning {
    /// Measures the [local](Rotations::local) rotations. Rotations at another frame rate are first
    /// [resampled](Rotations::resampled) to 20 frames a second, as when files are read.
    pub fn of(rotations: &Rotations) -> JointTurning {
        let resampled;
        let local = match rotations.frames_per_second() == FRAMES_PER_SECOND {
            true => rotations.local(),
            false => {
                resampled = rotations.resampled(FRAMES_PER_SECOND);
                resampled.local()
            }
        };
        let wide = |pose: &[[f32; 4]; JOINTS]| pose.map(|turn| turn.map(f64::from));
        let local: Vec<_> = local.iter().map(wide).collect();
        JointTurning::of_local(&local)
    }

    /// Measures local rotations at 20 frames a second: quaternions `[x, y, z, w]` for each frame, indexed by
    /// [`Joint::index`].
    ///
    /// Neither the sign nor the length of a quaternion matters. The rest pose does not matter either: a constant
    /// rotation before or after all rotations of a joint cancels.
    pub fn of_local(local: &[[[f64; 4]; JOINTS]]) -> JointTurning {
        let steps = local.windows(2).map(|pair| {
            std::array::from_fn(|joint| angle_degrees(pair[0][joint], pair[1][joint]) as f32)
        });
        JointTurning {
            steps: steps.collect(),
        }
    }

    /// Returns how far every joint turns from each frame to the next, in degrees, indexed by [`Joint::index`]. There is
    /// one entry less than there are frames.
    pub fn steps(&self) -> &[[f32; JOINTS]] {
        &self.steps
    }

    /// Returns how far a joint turns on average, in degrees a frame; 0 for a motion of one frame.
    pub fn mean(&self, joint: Joint) -> f32 {
        let sum: f64 = self.steps_of(joint).map(f64::from).sum();
        (sum / self.steps.len().max(1) as f64) as f32
    }

    /// Returns the largest turn of a joint from one frame to the next.
    pub fn largest(&self, joint: Joint) -> JointTurn {
        let still = JointTurn {
            degrees: 0.0,
            joint,
            frame: 0,
        };
        let steps = self.steps_of(joint).enumerate();
        steps.fold(still, |largest, (step, degrees)| {
            match degrees > largest.degrees {
                true => JointTurn {
                    degrees,
                    joint,
                    frame: step + 1,
                },
                false => largest,
            }
        })
    }

    /// Returns how far all joints but the pelvis turn on average, in degrees a frame.
    pub fn mean_without_pelvis(&self) -> f32 {
        let sum: f32 = ALL_BUT_PELVIS.iter().map(|&joint| self.mean(joint)).sum();
        sum / ALL_BUT_PELVIS.len() as f32
    }

    /// Returns the largest turn of any joint but the pelvis. If several joints turn as far, the first of
    /// [`Joint::ALL`] is returned.
    pub fn largest_without_pelvis(&self) -> JointTurn {
        let turns = ALL_BUT_PELVIS.iter().map(|&joint| self.largest(joint));
        let farthest = turns.reduce(|farthest, turn| match turn.degrees > farthest.degrees {
            true => turn,
            false => farthest,
        });
        farthest.expect("there are other joints")
    }

    /// Returns how often a joint turns by more than `degrees` from one frame to the next.
    pub fn snaps(&self, joint: Joint, degrees: f32) -> usize {
        self.steps_of(joint).filter(|turn| *turn > degrees).count()
    }

    /// Returns the angles of one joint, in degrees.
    fn steps_of(&self, joint: Joint) -> impl Iterator<Item = f32> {
        self.steps.iter().map(move |step| step[joint.index()])
    }
}

/// All joints but the pelvis.
const ALL_BUT_PELVIS: &[Joint] = Joint::ALL.split_at(1).1;

/// Returns the angle between two rotations, in degrees. It is computed from sine and cosine, because the cosine alone
/// hardly changes at small angles.
fn angle_degrees(from: [f64; 4], to: [f64; 4]) -> f64 {
    let turn = DQuat::from_array(from).conjugate() * DQuat::from_array(to);
    let sine = turn.xyz().length();
    // Both signs of a quaternion are the same rotation.
    (2.0 * sine.atan2(turn.w.abs())).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Motion;
    use glam::DVec3;

    type Pose = [[f64; 4]; JOINTS];

    const STILL: Pose = [[0.0, 0.0, 0.0, 1.0]; JOINTS];

    /// Returns local rotations of which only that of one joint is not the identity.
    fn turned(joint: Joint, turn: DQuat) -> Pose {
        let mut pose = STILL;
        pose[joint.index()] = turn.to_array();
        pose
    }

    fn close(found: f32, expected: f64) -> bool {
        (f64::from(found) - expected).abs() <= 1e-6 * expected
    }

    #[test]
    fn angles_are_right_from_a_millionth_of_a_degree_to_half_a_turn() {
        let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
        let before = DQuat::from_rotation_y(1.3);
        for degrees in [1e-6, 1e-3, 0.5, 14.0, 92.0, 179.9, 180.0] {
            let after = before * DQuat::from_axis_angle(axis, f64::to_radians(degrees));
            for after in [after, -after, after * 3.0] {
                let poses = [turned(Joint::Neck, before), turned(Joint::Neck, after)];
                let found = JointTurning::of_local(&poses).largest(Joint::Neck);
                assert!(close(found.degrees, degrees), "{degrees}: {found:?}");
            }
        }
    }

    #[test]
    fn what_turns_farther_than_half_is_turned_back_the_shorter_way() {
        let after = DQuat::from_rotation_x(f64::to_radians(350.0));
        let turning = JointTurning::of_local(&[STILL, turned(Joint::Head, after)]);
        assert!(close(turning.mean(Joint::Head), 10.0));
    }

    #[test]
    fn the_joint_that_twitches_is_named_with_its_frame_and_the_pelvis_apart() {
        let mut poses = vec![STILL; 11];
        let by = |degrees: f64| DQuat::from_rotation_x(degrees.to_radians());
        poses[4] = turned(Joint::Spine3, by(92.0));
        for pose in &mut poses[7..] {
            pose[Joint::Pelvis.index()] = by(120.0).to_array();
        }
        let turning = JointTurning::of_local(&poses);
        assert_eq!(turning.steps().len(), 10);
        let worst = turning.largest_without_pelvis();
        assert!(close(worst.degrees, 92.0));
        assert_eq!((worst.joint, worst.frame), (Joint::Spine3, 4));
        // The joint turns by 92 degrees and back.
        assert!(close(turning.mean(Joint::Spine3), 2.0 * 92.0 / 10.0));
        assert!(close(turning.mean_without_pelvis(), 18.4 / 21.0));
        assert_eq!(turning.snaps(Joint::Spine3, 60.0), 2);
        assert_eq!(turning.snaps(Joint::Spine3, 93.0), 0);
        let pelvis = turning.largest(Joint::Pelvis);
        assert!(close(pelvis.degrees, 120.0));
        assert_eq!(pelvis.frame, 7);
        assert!(close(turning.mean(Joint::Pelvis), 12.0));
        assert_eq!(turning.snaps(Joint::Pelvis, 60.0), 1);
    }

    #[test]
    fn constant_turns_before_and_after_change_nothing() {
        let swing = |frame: usize| DQuat::from_rotation_z(0.2 * (frame as f64).sin());
        let (before, after) = (DQuat::from_rotation_x(0.7), DQuat::from_rotation_y(-2.0));
        let turning = |change: &dyn Fn(DQuat) -> DQuat| {
            let poses = (0..30).map(|frame| turned(Joint::LeftHip, change(swing(frame))));
            JointTurning::of_local(&poses.collect::<Vec<_>>())
        };
        let plain = turning(&|turn| turn);
        let changed = turning(&|turn| before * turn * after);
        for (plain, changed) in plain.steps().iter().zip(changed.steps()) {
            let [plain, changed] = [plain, changed].map(|step| step[Joint::LeftHip.index()]);
            assert!((plain - changed).abs() < 1e-5);
        }
    }

    #[test]
    fn a_single_frame_does_not_turn() {
        for turning in [
            JointTurning::of_local(&[]),
            JointTurning::of_local(&[STILL]),
            JointTurning::of(&Rotations::of(&spinning(1))),
        ] {
            assert_eq!(turning.largest_without_pelvis().degrees, 0.0);
            assert_eq!(turning.largest(Joint::Pelvis).frame, 0);
            assert_eq!(turning.mean(Joint::Pelvis), 0.0);
            assert_eq!(turning.mean_without_pelvis(), 0.0);
        }
    }

    /// Returns the motion of a stiff body that turns about the vertical by 3 degrees a frame.
    fn spinning(frames: usize) -> Motion {
        let mut rest = [DVec3::ZERO; JOINTS];
        for joint in Joint::ALL {
            if let Some(parent) = joint.parent() {
                let offset = crate::RestPose::humanml3d().offset(joint);
                rest[joint.index()] = rest[parent.index()] + crate::precise::vector(offset);
            }
        }
        let pose = |frame: usize| {
            let turn = DQuat::from_rotation_y(f64::to_radians(3.0 * frame as f64));
            rest.map(|place| (turn * place).as_vec3().to_array())
        };
        Motion::from_joints((0..frames).map(pose).collect()).unwrap()
    }

    #[test]
    fn degrees_are_of_a_twentieth_second_whatever_the_rate_of_the_rotations() {
        let rotations = Rotations::of(&spinning(41));
        for rate in [20.0, 60.0, 30.0] {
            let turning = JointTurning::of(&rotations.resampled(rate));
            assert_eq!(turning.steps().len(), 40);
            assert!((turning.mean(Joint::Pelvis) - 3.0).abs() < 1e-3, "{rate}");
            assert!(turning.largest_without_pelvis().degrees < 1e-2, "{rate}");
        }
    }
}
