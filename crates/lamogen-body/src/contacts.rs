//! Which foot stands when, and how high a foot that swings has to be.

use glam::DVec3;
use lamogen_motion::{
    FOOT_CONTACT_JOINTS, FRAMES_PER_SECOND, FeatureGroup, JOINTS, Joint, POSE_FEATURES,
};

/// Limits within which ankle or ball of a foot stands. What begins within the first number goes on within the second.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// In metres above the ground.
    height: [f64; 2],
    /// In metres a second.
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
/// Contact features say that a joint stands from here on.
const SAID: f32 = 0.5;
/// How far above the lowest one another ball may stand, in metres.
const UNEVEN: f64 = 0.02;
/// How high the ball of a foot has to be to clear the ground, in metres, once it is fast.
const CLEAR: f64 = 0.06;
/// Speeds along the ground at which a foot begins to be fast, and is, in metres a second.
const FAST: [f64; 2] = [0.3, 0.7];
/// A pelvis below this height is that of a body that sits, lies or crawls, whose feet may touch the ground as they move; in metres.
const UPRIGHT: f64 = 0.5;

pub(crate) const FEET: [Joint; 2] = [Joint::LeftFoot, Joint::RightFoot];

/// A run of frames in which ankle or ball of a foot stays in its place.
#[derive(Clone, Debug, PartialEq)]
pub struct FootContact {
    /// An ankle, or a foot, which is its ball.
    pub joint: Joint,
    /// The first frame.
    pub from: usize,
    /// The frame after the last one.
    pub until: usize,
    /// Where it stands, in metres.
    pub place: [f64; 3],
}

/// The runs of frames in which ankles and balls of the feet stand: where they are low and slow and, if there are pose features, where
/// their contacts say so. Heights are above `ground`.
pub(crate) fn stands(
    poses: &[[DVec3; JOINTS]],
    features: Option<&[[f32; POSE_FEATURES]]>,
    ground: f64,
) -> Vec<FootContact> {
    let mut stands = Vec::new();
    for (place, joint) in FOOT_CONTACT_JOINTS.into_iter().enumerate() {
        let limits = if is_ankle(joint) { ANKLE } else { BALL };
        let within = |frame: usize, which: usize| {
            poses[frame][joint.index()].y - ground < limits.height[which]
                && velocity(poses, frame, joint).length() < limits.speed[which]
        };
        let said = |frame: usize| {
            let contact = FeatureGroup::FootContact.range().start + place;
            features.is_none_or(|rows| rows[frame][contact] > SAID)
        };
        let mut standing: Vec<bool> = (0..poses.len())
            .map(|frame| within(frame, 0) && said(frame))
            .collect();
        // Begun, a stand goes on both ways as long as the wider limits hold.
        for frame in 1..poses.len() {
            standing[frame] |= standing[frame - 1] && within(frame, 1);
        }
        for frame in (1..poses.len()).rev() {
            standing[frame - 1] |= standing[frame] && within(frame - 1, 1);
        }
        let mut from = 0;
        for run in standing.chunk_by(|a, b| a == b) {
            let until = from + run.len();
            if run[0] && run.len() >= SHORTEST {
                let places = poses[from..until].iter().map(|pose| pose[joint.index()]);
                let place = places.sum::<DVec3>() / run.len() as f64;
                stands.push(FootContact {
                    joint,
                    from,
                    until,
                    place: place.to_array(),
                });
            }
            from = until;
        }
    }
    put_on_the_ground(&mut stands, ground);
    stands
}

/// The lowest ball stands on the ground, and no other one far above it.
fn put_on_the_ground(stands: &mut [FootContact], ground: f64) {
    let balls = stands.iter().filter(|stand| !is_ankle(stand.joint));
    let lowest = balls
        .map(|stand| stand.place[1])
        .fold(f64::INFINITY, f64::min);
    if lowest.is_finite() {
        for stand in stands {
            stand.place[1] += ground - lowest;
            if !is_ankle(stand.joint) {
                stand.place[1] = stand.place[1].min(ground + UNEVEN);
            }
        }
    }
}

/// How high the ball of each foot has to be at every frame, in metres: where it neither stands nor is slow, so high that it clears the ground.
pub(crate) fn clearance(
    poses: &[[DVec3; JOINTS]],
    stands: &[FootContact],
    ground: f64,
) -> Vec<[f64; 2]> {
    let mut least = vec![[f64::NEG_INFINITY; 2]; poses.len()];
    for (side, foot) in FEET.into_iter().enumerate() {
        let mut swings: Vec<bool> = { poses.iter() }
            .map(|pose| pose[Joint::Pelvis.index()].y - ground > UPRIGHT)
            .collect();
        for stand in stands.iter().filter(|stand| stand.joint == foot) {
            swings[stand.from..stand.until].fill(false);
        }
        for frame in (0..poses.len()).filter(|&frame| swings[frame]) {
            let velocity = velocity(poses, frame, foot);
            let speed = velocity.x.hypot(velocity.z);
            let share = ((speed - FAST[0]) / (FAST[1] - FAST[0])).clamp(0.0, 1.0);
            least[frame][side] = ground + CLEAR * share;
        }
    }
    least
}

/// Metres a second, from the frame before to the frame after.
fn velocity(poses: &[[DVec3; JOINTS]], frame: usize, joint: Joint) -> DVec3 {
    let (before, after) = (frame.saturating_sub(1), (frame + 1).min(poses.len() - 1));
    let way = poses[after][joint.index()] - poses[before][joint.index()];
    way / (after - before).max(1) as f64 * f64::from(FRAMES_PER_SECOND)
}

fn is_ankle(joint: Joint) -> bool {
    matches!(joint, Joint::LeftAnkle | Joint::RightAnkle)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body whose left foot stands for a second 1 cm high, steps 40 cm ahead within half a second, and stands again; the right one
    /// hangs in the air.
    fn step() -> Vec<[DVec3; JOINTS]> {
        let pose = |t: usize| {
            let mut pose = [DVec3::Y; JOINTS];
            let way = ((t as f64 - 20.0) / 10.0).clamp(0.0, 1.0);
            let lift = (way * std::f64::consts::PI).sin();
            pose[Joint::LeftFoot.index()] = DVec3::new(0.0, 0.01 + 0.1 * lift, 0.4 * way);
            pose[Joint::RightFoot.index()] = DVec3::new(0.2, 0.3, 0.0);
            pose
        };
        (0..50).map(pose).collect()
    }

    #[test]
    fn a_foot_stands_before_and_after_its_step_and_nothing_in_the_air_does() {
        let stands = stands(&step(), None, 0.0);
        let feet: Vec<Joint> = stands.iter().map(|stand| stand.joint).collect();
        assert_eq!(feet, [Joint::LeftFoot; 2]);
        assert_eq!((stands[0].from, stands[1].until), (0, 50));
        assert!(stands[0].until <= 23 && stands[1].from >= 28, "{stands:?}");
        assert!(stands[0].place[2] < 0.05 && stands[1].place[2] > 0.35);
        // On the ground, though the motion has them a centimetre above it.
        assert!(stands.iter().all(|stand| stand.place[1].abs() < 0.01));
    }

    #[test]
    fn contacts_of_the_features_are_heard() {
        let features = vec![[0.0; POSE_FEATURES]; 50];
        assert!(stands(&step(), Some(&features), 0.0).is_empty());
    }

    #[test]
    fn a_foot_that_swings_has_to_clear_the_ground_unless_the_body_is_down() {
        let poses = step();
        let stands = stands(&poses, None, 0.0);
        let least = clearance(&poses, &stands, 0.0);
        assert_eq!(least[5][0], f64::NEG_INFINITY);
        assert!(least[25][0] > 0.05);
        let lying = poses.iter().map(|pose| {
            let mut pose = *pose;
            pose[0].y = 0.1;
            pose
        });
        let least = clearance(&lying.collect::<Vec<_>>(), &stands, 0.0);
        assert!(
            least
                .iter()
                .flatten()
                .all(|least| *least == f64::NEG_INFINITY)
        );
    }
}
