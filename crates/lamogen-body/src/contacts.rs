//! Which foot stands when.

use glam::DVec3;
use lamogen_motion::{FOOT_CONTACT_JOINTS, FRAMES_PER_SECOND, FeatureGroup, JOINTS, Joint, Motion};

/// Limits within which ankle or ball of a foot stands, metres and metres a second.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// A stand begins below this height and goes on below that.
    height: [f64; 2],
    /// The same of speeds.
    speed: [f64; 2],
}

const ANKLE: Limits = Limits {
    height: [0.10, 0.13],
    speed: [0.35, 0.6],
};
const BALL: Limits = Limits {
    height: [0.05, 0.07],
    speed: [0.5, 0.8],
};
/// Shorter stands are none, in frames.
const SHORTEST: usize = 2;
/// What the network says counts from here on.
const SAID: f32 = 0.5;
/// The ball of a standing foot is at most so far above the ground, in metres: the height of its joint above the sole.
const BALL_HEIGHT: f64 = 0.02;

/// One run of frames in which ankle or ball of a foot stays where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Stand {
    /// Ankle or foot (the ball) of one side.
    pub joint: Joint,
    /// First frame.
    pub from: usize,
    /// The frame after the last.
    pub until: usize,
    /// Where it stands, in metres.
    pub place: [f64; 3],
}

/// The runs of frames in which ankles and balls of the feet stand.
///
/// A foot stands where it is low and slow and, for motions that come from pose features, where these say so too. Heights are above
/// `floor`.
pub fn stands(motion: &Motion, floor: f64) -> Vec<Stand> {
    let all: Vec<[DVec3; JOINTS]> = { motion.joints().iter() }
        .map(|pose| pose.map(|point| DVec3::from(point.map(f64::from))))
        .collect();
    let said = |frame: usize, place: usize| match motion.features() {
        None => true,
        Some(rows) => rows[frame][FeatureGroup::FootContact.range().start + place] > SAID,
    };
    let mut stands = Vec::new();
    for (place, joint) in FOOT_CONTACT_JOINTS.into_iter().enumerate() {
        let limits = if is_ankle(joint) { ANKLE } else { BALL };
        let at = |frame: usize| all[frame][joint.index()];
        let speed = |frame: usize| {
            let next = (frame + 1).min(all.len() - 1);
            let before = frame.saturating_sub(1);
            let steps = (next - before).max(1) as f64;
            at(next).distance(at(before)) / steps * f64::from(FRAMES_PER_SECOND)
        };
        let within = |frame: usize, which: usize| {
            at(frame).y - floor < limits.height[which] && speed(frame) < limits.speed[which]
        };
        let mut standing: Vec<bool> = (0..all.len())
            .map(|frame| within(frame, 0) && said(frame, place))
            .collect();
        // Begun, a stand goes on both ways as long as the wider limits hold.
        for frame in 1..all.len() {
            standing[frame] |= standing[frame - 1] && within(frame, 1);
        }
        for frame in (1..all.len()).rev() {
            standing[frame - 1] |= standing[frame] && within(frame - 1, 1);
        }
        let mut from = 0;
        for run in standing.chunk_by(|a, b| a == b) {
            let until = from + run.len();
            if run[0] && run.len() >= SHORTEST {
                let sum: DVec3 = (from..until).map(at).sum();
                let mean = sum / run.len() as f64;
                stands.push(Stand {
                    joint,
                    from,
                    until,
                    place: mean.to_array(),
                });
            }
            from = until;
        }
    }
    // The lowest ball stands on the ground, and no other far above it.
    let balls = stands.iter().filter(|stand| !is_ankle(stand.joint));
    let lowest = balls.map(|stand| stand.place[1]).fold(f64::INFINITY, f64::min);
    if lowest.is_finite() {
        for stand in &mut stands {
            stand.place[1] += floor - lowest;
            if !is_ankle(stand.joint) {
                stand.place[1] = stand.place[1].min(floor + BALL_HEIGHT);
            }
        }
    }
    stands
}

fn is_ankle(joint: Joint) -> bool {
    matches!(joint, Joint::LeftAnkle | Joint::RightAnkle)
}
