//! A body of capsules around the T-pose, so that every viewer shows the motion.

use glam::DVec3;
use lamogen_motion::{CHAINS, JOINTS, Joint, RestPose};

use super::capsule::Capsule;

/// A side of the body. Each side has its own colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BodySide {
    Right,
    Left,
    Middle,
}

/// One capsule of the body, and the joint that it moves with.
#[derive(Clone, Copy, Debug)]
pub(super) struct BodyCapsule {
    pub(super) joint: Joint,
    pub(super) side: BodySide,
    pub(super) capsule: Capsule,
}

/// A capsule of the trunk: the joint that it moves with; its two ends, each given by a joint and an offset along +X in
/// metres; and the radii at the ends in metres.
type TrunkCapsule = (Joint, [(Joint, f64); 2], [f64; 2]);
const TRUNK: [TrunkCapsule; 10] = {
    use Joint::*;
    [
        (Pelvis, [(LeftHip, 0.0), (RightHip, 0.0)], [0.088, 0.088]),
        (Pelvis, [(Pelvis, 0.05), (Spine1, 0.045)], [0.09, 0.085]),
        (Pelvis, [(Pelvis, -0.05), (Spine1, -0.045)], [0.09, 0.085]),
        (Spine1, [(Spine1, 0.045), (Spine2, 0.05)], [0.085, 0.09]),
        (Spine1, [(Spine1, -0.045), (Spine2, -0.05)], [0.085, 0.09]),
        (Spine2, [(Spine2, 0.05), (Spine3, 0.06)], [0.09, 0.095]),
        (Spine2, [(Spine2, -0.05), (Spine3, -0.06)], [0.09, 0.095]),
        (
            Spine3,
            [(Spine3, 0.06), (LeftCollar, 0.005)],
            [0.095, 0.075],
        ),
        (
            Spine3,
            [(Spine3, -0.06), (RightCollar, -0.005)],
            [0.095, 0.075],
        ),
        (
            Spine3,
            [(LeftCollar, 0.005), (RightCollar, -0.005)],
            [0.075, 0.075],
        ),
    ]
};

/// The height in metres of the body for which the radii in this file are given.
const REFERENCE_HEIGHT: f64 = 1.7;

impl BodySide {
    pub(super) const ALL: [BodySide; 3] = [BodySide::Right, BodySide::Left, BodySide::Middle];

    pub(super) const fn name(self) -> &'static str {
        match self {
            BodySide::Right => "right",
            BodySide::Left => "left",
            BodySide::Middle => "middle",
        }
    }

    /// Returns the colour in sRGB. As in the pictures of `lamogen-view`, the right side has a warm colour and the left side
    /// a cold one.
    pub(super) const fn colour(self) -> [u8; 3] {
        match self {
            BodySide::Right => [0xea, 0x58, 0x0c],
            BodySide::Left => [0x02, 0x84, 0xc7],
            BodySide::Middle => [0x6b, 0x72, 0x80],
        }
    }

    /// Returns the side of a joint.
    fn of(joint: Joint) -> BodySide {
        let is_in = |chain: usize| CHAINS[chain][1..].contains(&joint);
        match joint {
            _ if is_in(0) || is_in(3) => BodySide::Right,
            _ if is_in(1) || is_in(4) => BodySide::Left,
            _ => BodySide::Middle,
        }
    }
}

/// Returns the capsules of the body: one around each bone, one around each tip, and those of the trunk.
///
/// The joints are at the positions of [`t_pose_on_ground`].
pub(super) fn body_capsules(rest: &RestPose) -> Vec<BodyCapsule> {
    let positions = t_pose_on_ground(rest);
    capsules_around(rest, &positions)
}

/// Returns the positions of the joints in the T-pose, with the body standing on the ground and the pelvis above the
/// origin.
pub(super) fn t_pose_on_ground(rest: &RestPose) -> [DVec3; JOINTS] {
    let mut positions = [DVec3::ZERO; JOINTS];
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            positions[joint.index()] = positions[parent.index()] + to_vector(rest.offset(joint));
        }
    }
    let lowest = capsules_around(rest, &positions)
        .iter()
        .flat_map(|part| [0, 1].map(|end| part.capsule.ends[end].y - part.capsule.radii[end]))
        .fold(f64::INFINITY, f64::min);
    positions.map(|point| point - DVec3::Y * lowest)
}

/// Returns the capsules of the body around joints at these positions.
fn capsules_around(rest: &RestPose, positions: &[DVec3; JOINTS]) -> Vec<BodyCapsule> {
    let tips = rest.tips();
    let tips = tips.map(|(joint, tip)| (joint, positions[joint.index()] + to_vector(tip)));
    let heights = positions.iter().chain(tips.iter().map(|(_, end)| end));
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| {
        (low.min(point.y), high.max(point.y))
    });
    let size = (high - low) / REFERENCE_HEIGHT;

    let bones = Joint::ALL.into_iter().filter_map(|joint| {
        let parent = joint.parent()?;
        let capsule = Capsule {
            ends: [positions[parent.index()], positions[joint.index()]],
            radii: bone_radii(joint).map(|radius| radius * size),
        };
        Some(BodyCapsule {
            joint: parent,
            side: BodySide::of(joint),
            capsule,
        })
    });
    let ends = tips.map(|(joint, end)| {
        let start = positions[joint.index()];
        let radii = match joint {
            Joint::Head => [0.09, 0.09],
            Joint::LeftWrist | Joint::RightWrist => [0.03, 0.018],
            _ => [0.034, 0.026],
        }
        .map(|radius| radius * size);
        // The surface of the capsule, not the centre of its last sphere, ends at the tip.
        let along = (end - start).normalize_or_zero();
        let end = end - along * radii[1].min(start.distance(end));
        BodyCapsule {
            joint,
            side: BodySide::of(joint),
            capsule: Capsule {
                ends: [start, end],
                radii,
            },
        }
    });
    // Capsules around the spine alone would look like a pole: hips, waist and chest are wider than deep.
    let trunk = TRUNK.map(|(joint, ends, radii)| {
        let end = |(joint, aside): (Joint, f64)| positions[joint.index()] + DVec3::X * aside * size;
        BodyCapsule {
            joint,
            side: BodySide::Middle,
            capsule: Capsule {
                ends: ends.map(end),
                radii: radii.map(|radius| radius * size),
            },
        }
    });
    bones.chain(ends).chain(trunk).collect()
}

/// Returns the radii in metres at the start and the end of the bone that ends at a joint.
fn bone_radii(joint: Joint) -> [f64; 2] {
    use Joint::*;
    match joint {
        Pelvis => [0.0, 0.0],
        LeftHip | RightHip => [0.06, 0.078],
        Spine1 => [0.09, 0.085],
        Spine2 => [0.085, 0.09],
        Spine3 => [0.09, 0.095],
        LeftKnee | RightKnee => [0.08, 0.052],
        LeftAnkle | RightAnkle => [0.052, 0.036],
        LeftFoot | RightFoot => [0.04, 0.034],
        Neck => [0.09, 0.055],
        Head => [0.05, 0.048],
        LeftCollar | RightCollar => [0.06, 0.06],
        LeftShoulder | RightShoulder => [0.058, 0.055],
        LeftElbow | RightElbow => [0.05, 0.038],
        LeftWrist | RightWrist => [0.038, 0.028],
    }
}

fn to_vector(offset: [f32; 3]) -> DVec3 {
    DVec3::from(offset.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::example;

    #[test]
    fn the_body_stands_on_the_ground_with_all_its_bones_tips_and_trunk() {
        let rest = example::rotations().rest().clone();
        let capsules = body_capsules(&rest);
        assert_eq!(capsules.len(), JOINTS - 1 + 5 + TRUNK.len());
        let lowest = capsules
            .iter()
            .flat_map(|part| [0, 1].map(|end| part.capsule.ends[end].y - part.capsule.radii[end]))
            .fold(f64::INFINITY, f64::min);
        assert!(lowest.abs() < 1e-9, "{lowest}");
        let [x, _, z] = t_pose_on_ground(&rest)[Joint::Pelvis.index()].to_array();
        assert_eq!([x, z], [0.0, 0.0]);
    }

    #[test]
    fn sides_are_those_of_the_chains() {
        for joint in Joint::ALL {
            let expected = match joint.name().split('_').next() {
                Some("left") => BodySide::Left,
                Some("right") => BodySide::Right,
                _ => BodySide::Middle,
            };
            assert_eq!(BodySide::of(joint), expected, "{}", joint.name());
        }
    }
}
