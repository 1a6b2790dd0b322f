//! How fast joints turn from frame to frame.

use glam::DQuat;

use crate::motion::FRAMES_PER_SECOND;
use crate::rotations::Rotations;
use crate::skeleton::{JOINTS, Joint};

/// How far every joint turns from one frame to the next, in degrees a frame of 1/20 s.
///
/// A joint turns as a rig has it: in the frame of the joint that it hangs from, the pelvis in the world. What no position
/// tells is seen here too: a chest or a shoulder that flips about its own bone, and back, stays where it is and takes all that
/// hangs from it on the wrong way round between two frames.
///
/// The turn from one rotation to the next is the shortest there is, 0 to 180 degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct JointTurning {
    /// From each frame to the next.
    steps: Vec<[f32; JOINTS]>,
}

/// A joint that turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointTurn {
    /// How far from one frame to the next, in degrees.
    pub degrees: f32,
    /// The joint that does.
    pub joint: Joint,
    /// The frame at which it has; 0 where nothing turns.
    pub frame: usize,
}

impl JointTurning {
    /// Measures the [local](Rotations::local) rotations. Those of another frame rate are
    /// [resampled](Rotations::resampled) to 20 frames a second before, as readers of files do.
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

    /// Measures local rotations at 20 frames a second: quaternions `[x, y, z, w]` frame by frame, indexed by
    /// [`Joint::index`]. Neither their sign nor their length matters, nor does it matter in which rest pose they would be
    /// none: what turns a joint before or after all of its rotations cancels.
    pub fn of_local(local: &[[[f64; 4]; JOINTS]]) -> JointTurning {
        let steps = local.windows(2).map(|pair| {
            std::array::from_fn(|joint| degrees(pair[0][joint], pair[1][joint]) as f32)
        });
        JointTurning {
            steps: steps.collect(),
        }
    }

    /// How far every joint turns from each frame to the next, in degrees, indexed by [`Joint::index`]: an entry less than
    /// there are frames.
    pub fn steps(&self) -> &[[f32; JOINTS]] {
        &self.steps
    }

    /// How far a joint turns on average, in degrees a frame; 0 for a motion of one frame.
    pub fn mean(&self, joint: Joint) -> f32 {
        let sum: f64 = self.of_joint(joint).map(f64::from).sum();
        (sum / self.steps.len().max(1) as f64) as f32
    }

    /// Where a joint turns farthest from one frame to the next.
    pub fn largest(&self, joint: Joint) -> JointTurn {
        let still = JointTurn {
            degrees: 0.0,
            joint,
            frame: 0,
        };
        let steps = self.of_joint(joint).enumerate();
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

    /// How far all joints but the pelvis turn on average, in degrees a frame.
    pub fn mean_but_pelvis(&self) -> f32 {
        let sum: f32 = OTHERS.iter().map(|&joint| self.mean(joint)).sum();
        sum / OTHERS.len() as f32
    }

    /// Where any joint but the pelvis turns farthest; the first of [`Joint::ALL`] where several do.
    pub fn largest_but_pelvis(&self) -> JointTurn {
        let turns = OTHERS.iter().map(|&joint| self.largest(joint));
        let farthest = turns.reduce(|farthest, turn| match turn.degrees > farthest.degrees {
            true => turn,
            false => farthest,
        });
        farthest.expect("there are other joints")
    }

    /// How often a joint turns by more than so many degrees from one frame to the next.
    pub fn snaps(&self, joint: Joint, degrees: f32) -> usize {
        self.of_joint(joint).filter(|turn| *turn > degrees).count()
    }

    fn of_joint(&self, joint: Joint) -> impl Iterator<Item = f32> {
        self.steps.iter().map(move |step| step[joint.index()])
    }
}

/// All joints but the pelvis.
const OTHERS: &[Joint] = Joint::ALL.split_at(1).1;

/// The angle between two rotations. The cosine alone would lose small angles: near 1 it hardly changes.
fn degrees(from: [f64; 4], to: [f64; 4]) -> f64 {
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

    /// A pose in which one joint is turned.
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
        let worst = turning.largest_but_pelvis();
        assert!(close(worst.degrees, 92.0));
        assert_eq!((worst.joint, worst.frame), (Joint::Spine3, 4));
        // There and back.
        assert!(close(turning.mean(Joint::Spine3), 2.0 * 92.0 / 10.0));
        assert!(close(turning.mean_but_pelvis(), 18.4 / 21.0));
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
            assert_eq!(turning.largest_but_pelvis().degrees, 0.0);
            assert_eq!(turning.largest(Joint::Pelvis).frame, 0);
            assert_eq!(turning.mean(Joint::Pelvis), 0.0);
            assert_eq!(turning.mean_but_pelvis(), 0.0);
        }
    }

    /// A stiff body that turns about itself by 3 degrees a frame.
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
            assert!(turning.largest_but_pelvis().degrees < 1e-2, "{rate}");
        }
    }
}
