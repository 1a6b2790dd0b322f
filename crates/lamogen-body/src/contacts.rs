//! Finds when each foot stands, and how high a swinging foot has to be.

use glam::DVec3;
use lamogen_motion::{
    FOOT_CONTACT_JOINTS, FRAMES_PER_SECOND, FeatureGroup, JOINTS, Joint, Motion, POSE_FEATURES,
};

/// Limits of height and speed within which the ankle or the ball of a foot stands. A contact begins within the first
/// number and lasts as long as the motion stays within the second.
#[derive(Clone, Copy, Debug)]
struct ContactLimits {
    /// In metres above the ground.
    height: [f64; 2],
    /// In metres a second.
    speed: [f64; 2],
}

const ANKLE_LIMITS: ContactLimits = ContactLimits {
    height: [0.10, 0.13],
    speed: [0.35, 0.6],
};
const BALL_LIMITS: ContactLimits = ContactLimits {
    height: [0.05, 0.07],
    speed: [0.5, 0.8],
};
/// The share of the pelvis's speed along the ground up to which the ball of a foot stands if the contact feature says so: the ground is
/// where a network lets a foot pass far more slowly than the body. Feet of runs that a network makes may move at more than a metre a
/// second as they stand, and a body whose feet never stand floats.
const STANDING_SHARE: f64 = 0.4;
/// Contacts with fewer frames than this are ignored.
const MIN_CONTACT_FRAMES: usize = 2;
/// A contact feature above this value says that the joint stands.
const CONTACT_THRESHOLD: f32 = 0.5;
/// The largest height above the ground at which the ball of a foot may stand, in metres.
const MAX_BALL_HEIGHT: f64 = 0.02;
/// The height above the ground that the ball of a fast foot must have, in metres.
pub(crate) const SWING_HEIGHT: f64 = 0.06;
/// Speeds of a foot along the ground, in metres a second. The required height is 0 up to the first, rises between them,
/// and is [`SWING_HEIGHT`] from the second on.
const SWING_SPEED: [f64; 2] = [0.3, 0.7];
/// The height of the pelvis above the ground, in metres, up to which a body sits, lies or crawls. The feet of such a body
/// may touch the ground as they move.
const UPRIGHT_HEIGHT: f64 = 0.5;

/// The balls of both feet.
pub(crate) const FEET: [Joint; 2] = [Joint::LeftFoot, Joint::RightFoot];

/// A run of frames in which the ankle or the ball of a foot stays in its place.
#[derive(Clone, Debug, PartialEq)]
pub struct FootContact {
    /// An ankle or a foot; the joint of a foot is its ball.
    pub joint: Joint,
    /// The first frame.
    pub from: usize,
    /// The frame after the last one.
    pub until: usize,
    /// The position at which the joint stands, in metres.
    pub position: [f64; 3],
}

/// Finds when the feet of a motion stand: where an ankle or the ball of a foot is low and slow.
pub fn foot_contacts(motion: &Motion) -> Vec<FootContact> {
    let poses: Vec<[DVec3; JOINTS]> = { motion.joints().iter() }
        .map(|pose| pose.map(|place| DVec3::from(place.map(f64::from))))
        .collect();
    find_contacts(&poses, None, crate::ground(motion))
}

/// Finds the contacts of ankles and balls of the feet with the ground.
///
/// A joint stands where it is low and slow and, if there are pose features, their contact feature says so. Heights are
/// above `ground`, in metres.
pub(crate) fn find_contacts(
    poses: &[[DVec3; JOINTS]],
    features: Option<&[[f32; POSE_FEATURES]]>,
    ground: f64,
) -> Vec<FootContact> {
    let mut contacts = Vec::new();
    for (index, joint) in FOOT_CONTACT_JOINTS.into_iter().enumerate() {
        let limits = if is_ankle(joint) {
            ANKLE_LIMITS
        } else {
            BALL_LIMITS
        };
        let is_within = |frame: usize, level: usize| {
            let of_body = match features {
                Some(_) if !is_ankle(joint) => {
                    let velocity = velocity(poses, frame, Joint::Pelvis);
                    STANDING_SHARE * velocity.x.hypot(velocity.z) / limits.speed[0]
                }
                _ => 1.0,
            };
            poses[frame][joint.index()].y - ground < limits.height[level]
                && velocity(poses, frame, joint).length() < limits.speed[level] * of_body.max(1.0)
        };
        let has_contact_feature = |frame: usize| {
            let feature = FeatureGroup::FootContact.range().start + index;
            features.is_none_or(|rows| rows[frame][feature] > CONTACT_THRESHOLD)
        };
        let mut standing: Vec<bool> = (0..poses.len())
            .map(|frame| is_within(frame, 0) && has_contact_feature(frame))
            .collect();
        // A contact is extended forward and backward in time as long as the wider limits hold.
        for frame in 1..poses.len() {
            standing[frame] |= standing[frame - 1] && is_within(frame, 1);
        }
        for frame in (1..poses.len()).rev() {
            standing[frame - 1] |= standing[frame] && is_within(frame - 1, 1);
        }
        let mut from = 0;
        for run in standing.chunk_by(|a, b| a == b) {
            let until = from + run.len();
            if run[0] && run.len() >= MIN_CONTACT_FRAMES {
                let positions = poses[from..until].iter().map(|pose| pose[joint.index()]);
                let position = positions.sum::<DVec3>() / run.len() as f64;
                contacts.push(FootContact {
                    joint,
                    from,
                    until,
                    position: position.to_array(),
                });
            }
            from = until;
        }
    }
    move_to_ground(&mut contacts, ground);
    contacts
}

/// Shifts all contacts vertically so that the lowest ball of a foot is on the ground, and lowers the other balls to at
/// most [`MAX_BALL_HEIGHT`] above it.
fn move_to_ground(contacts: &mut [FootContact], ground: f64) {
    let balls = { contacts.iter() }.filter(|contact| !is_ankle(contact.joint));
    let lowest = balls
        .map(|contact| contact.position[1])
        .fold(f64::INFINITY, f64::min);
    if lowest.is_finite() {
        for contact in contacts {
            contact.position[1] += ground - lowest;
            if !is_ankle(contact.joint) {
                contact.position[1] = contact.position[1].min(ground + MAX_BALL_HEIGHT);
            }
        }
    }
}

/// Returns the least height of the ball of each foot at every frame, in metres. A fast foot that does not stand must be
/// high enough to clear the ground. The height is negative infinity where a foot stands or the body is down.
pub(crate) fn least_foot_heights(
    poses: &[[DVec3; JOINTS]],
    contacts: &[FootContact],
    ground: f64,
) -> Vec<[f64; 2]> {
    let mut least = vec![[f64::NEG_INFINITY; 2]; poses.len()];
    for (side, foot) in FEET.into_iter().enumerate() {
        let mut swings: Vec<bool> = { poses.iter() }
            .map(|pose| pose[Joint::Pelvis.index()].y - ground > UPRIGHT_HEIGHT)
            .collect();
        for contact in contacts.iter().filter(|contact| contact.joint == foot) {
            swings[contact.from..contact.until].fill(false);
        }
        for frame in (0..poses.len()).filter(|&frame| swings[frame]) {
            let velocity = velocity(poses, frame, foot);
            let speed = velocity.x.hypot(velocity.z);
            let share =
                ((speed - SWING_SPEED[0]) / (SWING_SPEED[1] - SWING_SPEED[0])).clamp(0.0, 1.0);
            least[frame][side] = ground + SWING_HEIGHT * share;
        }
    }
    least
}

/// Returns the velocity of a joint in metres a second, measured from the frame before to the frame after.
fn velocity(poses: &[[DVec3; JOINTS]], frame: usize, joint: Joint) -> DVec3 {
    let (before, after) = (frame.saturating_sub(1), (frame + 1).min(poses.len() - 1));
    let displacement = poses[after][joint.index()] - poses[before][joint.index()];
    displacement / (after - before).max(1) as f64 * f64::from(FRAMES_PER_SECOND)
}

fn is_ankle(joint: Joint) -> bool {
    matches!(joint, Joint::LeftAnkle | Joint::RightAnkle)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the poses of a body that makes a step: the left foot stands 1 cm high for a second, moves 40 cm ahead
    /// within half a second, and stands again. The right foot is in the air throughout.
    fn step() -> Vec<[DVec3; JOINTS]> {
        let pose = |t: usize| {
            let mut pose = [DVec3::Y; JOINTS];
            let progress = ((t as f64 - 20.0) / 10.0).clamp(0.0, 1.0);
            let lift = (progress * std::f64::consts::PI).sin();
            pose[Joint::LeftFoot.index()] = DVec3::new(0.0, 0.01 + 0.1 * lift, 0.4 * progress);
            pose[Joint::RightFoot.index()] = DVec3::new(0.2, 0.3, 0.0);
            pose
        };
        (0..50).map(pose).collect()
    }

    #[test]
    fn a_foot_stands_before_and_after_its_step_and_nothing_in_the_air_does() {
        let contacts = find_contacts(&step(), None, 0.0);
        let feet: Vec<Joint> = contacts.iter().map(|contact| contact.joint).collect();
        assert_eq!(feet, [Joint::LeftFoot; 2]);
        assert_eq!((contacts[0].from, contacts[1].until), (0, 50));
        assert!(
            contacts[0].until <= 23 && contacts[1].from >= 28,
            "{contacts:?}"
        );
        assert!(contacts[0].position[2] < 0.05 && contacts[1].position[2] > 0.35);
        // The contacts are on the ground, although the feet of the motion are a centimetre above it.
        assert!(
            contacts
                .iter()
                .all(|contact| contact.position[1].abs() < 0.01)
        );
    }

    #[test]
    fn contacts_of_the_features_are_heard() {
        let features = vec![[0.0; POSE_FEATURES]; 50];
        assert!(find_contacts(&step(), Some(&features), 0.0).is_empty());
    }

    #[test]
    fn a_foot_that_a_network_lets_slide_under_a_fast_body_stands() {
        // The foot moves at a metre a second for a quarter of a second, low, and is fast and high before and after.
        let pose = |t: usize, speed: f64| {
            let mut pose = [DVec3::Y; JOINTS];
            let after = t as f64 - 20.0;
            pose[Joint::Pelvis.index()].z = speed * after / 20.0;
            let is_low = (0.0..=5.0).contains(&after);
            let height = if is_low { 0.02 } else { 0.2 };
            let way = after.clamp(0.0, 5.0) / 20.0 + (after - after.clamp(0.0, 5.0)) * 0.3;
            pose[Joint::LeftFoot.index()] = DVec3::new(0.0, height, way);
            pose
        };
        let contacts = |speed: f64, feature: Option<f32>| {
            let poses: Vec<[DVec3; JOINTS]> = (0..50).map(|t| pose(t, speed)).collect();
            let features = feature.map(|value| vec![[value; POSE_FEATURES]; 50]);
            find_contacts(&poses, features.as_deref(), 0.0).len()
        };
        assert_eq!(contacts(3.5, Some(1.0)), 1);
        // Not where the network says that it is in the air, where the body is as slow, or where there is no network to say so.
        assert_eq!(contacts(3.5, Some(0.0)), 0);
        assert_eq!(contacts(1.2, Some(1.0)), 0);
        assert_eq!(contacts(3.5, None), 0);
    }

    #[test]
    fn a_foot_that_swings_has_to_clear_the_ground_unless_the_body_is_down() {
        let poses = step();
        let contacts = find_contacts(&poses, None, 0.0);
        let least = least_foot_heights(&poses, &contacts, 0.0);
        assert_eq!(least[5][0], f64::NEG_INFINITY);
        assert!(least[25][0] > 0.05);
        let lying = poses.iter().map(|pose| {
            let mut pose = *pose;
            pose[0].y = 0.1;
            pose
        });
        let least = least_foot_heights(&lying.collect::<Vec<_>>(), &contacts, 0.0);
        assert!(
            least
                .iter()
                .flatten()
                .all(|least| *least == f64::NEG_INFINITY)
        );
    }
}
