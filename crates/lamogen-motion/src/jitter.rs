//! Measures how unsteadily a motion goes from frame to frame.

use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::skeleton::Joint;

/// How unsteadily joints move from frame to frame.
///
/// Real motion is smooth at 20 frames a second. A generator that jumps between two phases of a step makes the legs
/// jump, which shows at the ankles; noise shows at all joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jitter {
    /// The mean length of the second difference of both ankles' positions, in mm a frame²; 0 for motions of
    /// fewer than 3 frames.
    pub ankles: f32,
    /// The mean length of the third difference of all joints' positions, as jerk in m/s³; 0 for motions of fewer
    /// than 4 frames.
    pub jerk: f32,
}

/// Factors of the second difference, `p(t) - 2 p(t + 1) + p(t + 2)`.
const SECOND_DIFFERENCE: [f32; 3] = [1.0, -2.0, 1.0];

/// Factors of the third difference, `-p(t) + 3 p(t + 1) - 3 p(t + 2) + p(t + 3)`.
const THIRD_DIFFERENCE: [f32; 4] = [-1.0, 3.0, -3.0, 1.0];

impl Jitter {
    /// Measures a motion.
    pub fn of(motion: &Motion) -> Jitter {
        let ankles = [Joint::LeftAnkle, Joint::RightAnkle];
        let jerk = mean_difference(motion, &Joint::ALL, THIRD_DIFFERENCE);
        Jitter {
            ankles: 1000.0 * mean_difference(motion, &ankles, SECOND_DIFFERENCE),
            jerk: jerk * FRAMES_PER_SECOND.powi(3),
        }
    }
}

/// Returns the mean length, in metres, of a finite difference along time. The mean is over the joints and over all
/// windows of `N` frames; 0 if there are none.
fn mean_difference<const N: usize>(motion: &Motion, joints: &[Joint], factors: [f32; N]) -> f32 {
    let windows = motion.joints().windows(N);
    let count = windows.len() * joints.len();
    let lengths = windows.flat_map(|window| {
        joints.iter().map(|joint| {
            let mut difference = [0.0; 3];
            for (pose, factor) in window.iter().zip(factors) {
                for (sum, coordinate) in difference.iter_mut().zip(pose[joint.index()]) {
                    *sum += factor * coordinate;
                }
            }
            let squared: f32 = difference.iter().map(|x| x * x).sum();
            f64::from(squared.sqrt())
        })
    });
    (lengths.sum::<f64>() / count.max(1) as f64) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skeleton::JOINTS;

    fn motion(frames: usize, place: impl Fn(f32, Joint) -> [f32; 3]) -> Motion {
        let frames = (0..frames).map(|frame| Joint::ALL.map(|joint| place(frame as f32, joint)));
        Motion::from_joints(frames.collect()).unwrap()
    }

    #[test]
    fn steady_speed_has_no_jitter_and_steady_acceleration_no_jerk() {
        let gliding = Jitter::of(&motion(20, |t, _| [0.25 * t, 1.0, -0.5 * t]));
        assert_eq!((gliding.ankles, gliding.jerk), (0.0, 0.0));
        // The second difference along y is 2 · 1/128 m a frame².
        let falling = Jitter::of(&motion(20, |t, _| [0.0, -t * t / 128.0, 0.0]));
        assert_eq!((falling.ankles, falling.jerk), (15.625, 0.0));
    }

    #[test]
    fn an_ankle_that_jumps_is_seen_and_arms_that_do_are_jerk_only() {
        let shaking = |shaken: Joint| {
            Jitter::of(&motion(8, |t, joint| match joint == shaken {
                true => [0.0, if t % 2.0 == 0.0 { 0.0 } else { 0.125 }, 0.0],
                false => [0.0; 3],
            }))
        };
        let ankle = shaking(Joint::LeftAnkle);
        // The second difference is 2 · 0.125 m at one of two ankles; the third difference is 4 · 0.125 m.
        assert_eq!(ankle.ankles, 125.0);
        let jerk = 0.5 * 8000.0 / JOINTS as f32;
        assert!((ankle.jerk - jerk).abs() < 1e-3);
        let wrist = shaking(Joint::RightWrist);
        assert_eq!((wrist.ankles, wrist.jerk), (0.0, ankle.jerk));
    }

    #[test]
    fn motions_too_short_for_a_difference_have_none() {
        let short = Jitter::of(&motion(2, |t, _| [t * t, 0.0, 0.0]));
        assert_eq!((short.ankles, short.jerk), (0.0, 0.0));
    }
}
