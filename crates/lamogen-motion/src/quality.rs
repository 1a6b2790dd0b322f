//! Measures two faults of motions: bones that change their length, and feet that slide.

use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::skeleton::{JOINTS, Joint};

/// How much bones change their length over a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneDrift {
    /// The median length of the bone that ends in each joint, in metres; 0 for the pelvis.
    pub lengths: [f32; JOINTS],
    /// The largest deviation of each bone from its median length, in metres.
    pub drift: [f32; JOINTS],
    /// The joint in which the bone with the largest deviation ends.
    pub worst: Joint,
    /// The frame of the largest deviation.
    pub frame: usize,
}

impl BoneDrift {
    /// Measures a motion.
    pub fn of(motion: &Motion) -> BoneDrift {
        let mut measured = BoneDrift {
            lengths: [0.0; JOINTS],
            drift: [0.0; JOINTS],
            worst: Joint::Pelvis,
            frame: 0,
        };
        for joint in Joint::ALL {
            let Some(parent) = joint.parent() else {
                continue;
            };
            let poses = motion.joints().iter();
            let lengths: Vec<f32> = poses
                .map(|pose| distance(pose[joint.index()], pose[parent.index()]))
                .collect();
            let mut sorted = lengths.clone();
            let middle = sorted.len() / 2;
            let median = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
            measured.lengths[joint.index()] = median;
            for (frame, length) in lengths.into_iter().enumerate() {
                let drift = (length - median).abs();
                if drift > measured.drift[joint.index()] {
                    measured.drift[joint.index()] = drift;
                }
                if drift > measured.largest() || measured.worst == Joint::Pelvis {
                    (measured.worst, measured.frame) = (joint, frame);
                }
            }
        }
        measured
    }

    /// Returns the largest deviation of any bone, in metres.
    pub fn largest(&self) -> f32 {
        self.drift[self.worst.index()]
    }
}

/// How much feet slide while they stand.
///
/// A foot stands while its ball is less than 5 cm above the lowest point that the ball of either foot reaches in the
/// motion. The limits are those of Karunratanakul et al. 2023 (GMD, section 5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FootSliding {
    /// The share of steps from frame to frame, 0 to 1, in which a foot stands and yet moves more than 2.5 cm along
    /// the ground.
    pub ratio: f32,
    /// The distances that the left and the right foot move along the ground while they stand, in metres.
    pub distance: [f32; 2],
    /// The mean speed of a standing foot along the ground, in metres a second; 0 if no foot ever stands.
    pub speed: f32,
}

/// Height in metres above the lowest point below which a foot stands.
const STANDING_BELOW: f32 = 0.05;
/// Distance in metres from frame to frame above which a standing foot slides.
const SLIDING_FROM: f32 = 0.025;

impl FootSliding {
    /// Measures a motion.
    pub fn of(motion: &Motion) -> FootSliding {
        let feet = [Joint::LeftFoot, Joint::RightFoot];
        let heights = motion
            .joints()
            .iter()
            .flat_map(|pose| feet.map(|foot| pose[foot.index()][1]));
        let ground = heights.fold(f32::INFINITY, f32::min);
        let (mut sliding, mut standing, mut distance) = (0, 0, [0.0; 2]);
        for pair in motion.joints().windows(2) {
            let mut slides = false;
            for (side, foot) in feet.into_iter().enumerate() {
                let [from, to] = [pair[0], pair[1]].map(|pose| pose[foot.index()]);
                if from[1].max(to[1]) - ground >= STANDING_BELOW {
                    continue;
                }
                let moved = (to[0] - from[0]).hypot(to[2] - from[2]);
                standing += 1;
                distance[side] += moved;
                slides |= moved > SLIDING_FROM;
            }
            sliding += usize::from(slides);
        }
        let steps = (motion.frames() - 1).max(1);
        FootSliding {
            ratio: sliding as f32 / steps as f32,
            distance,
            speed: distance.iter().sum::<f32>() / standing.max(1) as f32 * FRAMES_PER_SECOND,
        }
    }
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let squared: f32 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    squared.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(place: impl Fn(usize, Joint) -> [f32; 3]) -> Motion {
        let frames = (0..21).map(|frame| Joint::ALL.map(|joint| place(frame, joint)));
        Motion::from_joints(frames.collect()).unwrap()
    }

    #[test]
    fn the_bone_that_drifts_is_named_with_its_frame() {
        let motion = motion(|frame, joint| match (frame, joint) {
            (7, Joint::LeftWrist) => [0.0, 20.25, 0.0],
            (_, joint) => [0.0, joint.index() as f32, 0.0],
        });
        let drift = BoneDrift::of(&motion);
        assert_eq!((drift.worst, drift.frame), (Joint::LeftWrist, 7));
        assert_eq!(drift.largest(), 0.25);
        assert_eq!(drift.lengths[Joint::LeftWrist.index()], 2.0);
        assert_eq!(drift.drift[Joint::RightWrist.index()], 0.0);
    }

    #[test]
    fn only_a_foot_that_stands_can_slide() {
        // The left foot slides by 5 cm a frame on the ground; the right foot moves as fast in the air.
        let sliding = motion(|frame, joint| match joint {
            Joint::LeftFoot => [0.05 * frame as f32, 0.01, 0.0],
            Joint::RightFoot => [0.05 * frame as f32, 0.2, 0.0],
            _ => [0.0, 1.0, 0.0],
        });
        let found = FootSliding::of(&sliding);
        assert_eq!(found.ratio, 1.0);
        assert!((found.distance[0] - 1.0).abs() < 1e-5 && found.distance[1] == 0.0);
        assert!((found.speed - 1.0).abs() < 1e-5);

        let still = motion(|_, _| [0.3, 0.0, 0.1]);
        let found = FootSliding::of(&still);
        assert_eq!((found.ratio, found.speed), (0.0, 0.0));
    }

    #[test]
    fn a_single_frame_does_not_slide() {
        let motion = Motion::from_joints(vec![[[0.0; 3]; JOINTS]]).unwrap();
        assert_eq!(FootSliding::of(&motion).ratio, 0.0);
        assert_eq!(BoneDrift::of(&motion).largest(), 0.0);
    }
}
