//! A body of capsules around the T-pose, so that any viewer shows the motion at once.

use glam::DVec3;
use lamogen_motion::{CHAINS, JOINTS, Joint, RestPose};

use super::capsule::Capsule;

/// The sides of the body, which have a colour each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Right,
    Left,
    Middle,
}

/// One capsule of the body and the joint that carries it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limb {
    pub(super) joint: Joint,
    pub(super) side: Side,
    pub(super) capsule: Capsule,
}

/// The joint that carries a piece of the trunk, from where to where it reaches, in metres aside of joints, and its
/// radii in metres.
type Flesh = (Joint, [(Joint, f64); 2], [f64; 2]);
const TRUNK: [Flesh; 10] = {
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

/// Height in metres of the body that the thicknesses below are those of.
const HEIGHT: f64 = 1.7;

impl Side {
    pub(super) const ALL: [Side; 3] = [Side::Right, Side::Left, Side::Middle];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Side::Right => "right",
            Side::Left => "left",
            Side::Middle => "middle",
        }
    }

    /// Its colour in sRGB, as in the pictures of `lamogen-view`: right warm, left cold.
    pub(super) const fn colour(self) -> [u8; 3] {
        match self {
            Side::Right => [0xea, 0x58, 0x0c],
            Side::Left => [0x02, 0x84, 0xc7],
            Side::Middle => [0x6b, 0x72, 0x80],
        }
    }

    fn of(joint: Joint) -> Side {
        let holds = |chain: usize| CHAINS[chain][1..].contains(&joint);
        match joint {
            _ if holds(0) || holds(3) => Side::Right,
            _ if holds(1) || holds(4) => Side::Left,
            _ => Side::Middle,
        }
    }
}

/// The body's limbs: one around each bone, one around each tip, and the trunk.
///
/// Positions are those of [`standing`].
pub(super) fn limbs(rest: &RestPose) -> Vec<Limb> {
    let place = standing(rest);
    around(rest, &place)
}

/// Where the joints of the T-pose are when the body stands on the ground, its pelvis above the origin.
pub(super) fn standing(rest: &RestPose) -> [DVec3; JOINTS] {
    let mut place = [DVec3::ZERO; JOINTS];
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            place[joint.index()] = place[parent.index()] + offset(rest.offset(joint));
        }
    }
    let lowest = around(rest, &place)
        .iter()
        .flat_map(|limb| [0, 1].map(|end| limb.capsule.ends[end].y - limb.capsule.radii[end]))
        .fold(f64::INFINITY, f64::min);
    place.map(|point| point - DVec3::Y * lowest)
}

fn around(rest: &RestPose, place: &[DVec3; JOINTS]) -> Vec<Limb> {
    let tips = rest.tips();
    let tips = tips.map(|(joint, tip)| (joint, place[joint.index()] + offset(tip)));
    let heights = place.iter().chain(tips.iter().map(|(_, end)| end));
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| {
        (low.min(point.y), high.max(point.y))
    });
    let size = (high - low) / HEIGHT;

    let bones = Joint::ALL.into_iter().filter_map(|joint| {
        let parent = joint.parent()?;
        let capsule = Capsule {
            ends: [place[parent.index()], place[joint.index()]],
            radii: thickness(joint).map(|radius| radius * size),
        };
        Some(Limb {
            joint: parent,
            side: Side::of(joint),
            capsule,
        })
    });
    let ends = tips.map(|(joint, end)| {
        let start = place[joint.index()];
        let radii = match joint {
            Joint::Head => [0.09, 0.09],
            Joint::LeftWrist | Joint::RightWrist => [0.03, 0.018],
            _ => [0.034, 0.026],
        }
        .map(|radius| radius * size);
        // The limb ends where its skin does.
        let along = (end - start).normalize_or_zero();
        let end = end - along * radii[1].min(start.distance(end));
        Limb {
            joint,
            side: Side::of(joint),
            capsule: Capsule {
                ends: [start, end],
                radii,
            },
        }
    });
    // A spine alone is a pole; hips, waist and chest are wider than deep.
    let trunk = TRUNK.map(|(joint, ends, radii)| {
        let end = |(joint, aside): (Joint, f64)| place[joint.index()] + DVec3::X * aside * size;
        Limb {
            joint,
            side: Side::Middle,
            capsule: Capsule {
                ends: ends.map(end),
                radii: radii.map(|radius| radius * size),
            },
        }
    });
    bones.chain(ends).chain(trunk).collect()
}

/// Radii in metres where the bone that ends in a joint starts and ends.
fn thickness(joint: Joint) -> [f64; 2] {
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

fn offset(offset: [f32; 3]) -> DVec3 {
    DVec3::from(offset.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::example;

    #[test]
    fn the_body_stands_on_the_ground_with_all_its_bones_tips_and_trunk() {
        let rest = example::rotations().rest().clone();
        let limbs = limbs(&rest);
        assert_eq!(limbs.len(), JOINTS - 1 + 5 + TRUNK.len());
        let lowest = limbs
            .iter()
            .flat_map(|limb| [0, 1].map(|end| limb.capsule.ends[end].y - limb.capsule.radii[end]))
            .fold(f64::INFINITY, f64::min);
        assert!(lowest.abs() < 1e-9, "{lowest}");
        let [x, _, z] = standing(&rest)[Joint::Pelvis.index()].to_array();
        assert_eq!([x, z], [0.0, 0.0]);
    }

    #[test]
    fn sides_are_those_of_the_chains() {
        for joint in Joint::ALL {
            let expected = match joint.name().split('_').next() {
                Some("left") => Side::Left,
                Some("right") => Side::Right,
                _ => Side::Middle,
            };
            assert_eq!(Side::of(joint), expected, "{}", joint.name());
        }
    }
}
