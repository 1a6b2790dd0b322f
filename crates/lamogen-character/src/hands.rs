//! Relaxed hands: straight fingers are bent a little.

use glam::{DQuat, DVec3};
use lamogen_motion::Joint;

use crate::skeleton::CharacterSkeleton;

/// The angles by which the bones of a finger are bent, from the palm outwards, in degrees.
const BEND: [f64; 3] = [18.0, 24.0, 18.0];
/// The angle between the bones of a finger, in degrees, up to which it is straight.
const STRAIGHT: f64 = 8.0;
/// Words of the names of fingers, from the index finger to the little one. The thumb stays as it is.
const FINGERS: [&[&str]; 4] = [&["index"], &["middle"], &["ring"], &["little", "pinky"]];

/// Returns the local rotation of each bone of a finger that is bent, by its place in the skeleton.
///
/// Fingers are found by their names below the hands. They are bent about the line across the palm, from the index finger to the
/// little one. A hand is left as it is if one of its fingers is bent already, or if it has fewer than two fingers.
pub(crate) fn relaxed_fingers(skeleton: &CharacterSkeleton) -> Vec<(usize, DQuat)> {
    let mut bent = Vec::new();
    for (wrist, side) in [(Joint::LeftWrist, 1.0), (Joint::RightWrist, -1.0)] {
        let Some(hand) = skeleton.joint(wrist) else {
            continue;
        };
        let fingers: Vec<Vec<usize>> = { FINGERS.iter() }
            .map(|words| finger_bones(skeleton, hand, words))
            .filter(|bones| bones.len() >= 2)
            .collect();
        let (Some(first), Some(last)) = (fingers.first(), fingers.last()) else {
            continue;
        };
        let place = |place: usize| skeleton.nodes[place].world_position;
        let across = (place(last[0]) - place(first[0])) * side;
        let Some(axis) = across.try_normalize() else {
            continue;
        };
        if fingers.iter().any(|bones| is_bent(skeleton, bones)) {
            continue;
        }
        for bones in fingers {
            for (bone, degrees) in bones.into_iter().zip(BEND) {
                let node = &skeleton.nodes[bone];
                // The axis in the bone's own frame, about which the bone turns before its rest rotation.
                let own = node.world_rotation.inverse() * axis;
                let turn = DQuat::from_axis_angle(own, degrees.to_radians());
                bent.push((bone, (node.rotation * turn).normalize()));
            }
        }
    }
    bent
}

/// Returns the middle of the knuckles of a hand in the rest pose; `None` if the hand has fewer than two fingers.
pub(crate) fn knuckles(skeleton: &CharacterSkeleton, hand: usize) -> Option<DVec3> {
    let bones = FINGERS.iter().filter_map(|words| {
        let first = *finger_bones(skeleton, hand, words).first()?;
        Some(skeleton.nodes[first].world_position)
    });
    let places: Vec<DVec3> = bones.collect();
    (places.len() >= 2).then(|| places.iter().sum::<DVec3>() / places.len() as f64)
}

/// Returns the bones of a finger, from the palm outwards.
fn finger_bones(skeleton: &CharacterSkeleton, hand: usize, words: &[&str]) -> Vec<usize> {
    let is_named = |place: usize| {
        let name = skeleton.nodes[place].name.to_lowercase();
        words.iter().any(|word| name.contains(word)) && !name.contains("metacarpal")
    };
    let is_below = |place: usize, above: usize| skeleton.ancestors(place).any(|node| node == above);
    let mut bones: Vec<usize> = Vec::new();
    for place in hand + 1..skeleton.nodes.len() {
        let above = bones.last().copied().unwrap_or(hand);
        if is_named(place) && is_below(place, above) {
            bones.push(place);
        }
    }
    bones
}

/// Whether two bones of a finger do not lie in one line.
fn is_bent(skeleton: &CharacterSkeleton, bones: &[usize]) -> bool {
    let place = |bone: usize| skeleton.nodes[bone].world_position;
    let directions: Vec<DVec3> = { bones.windows(2) }
        .filter_map(|pair| (place(pair[1]) - place(pair[0])).try_normalize())
        .collect();
    directions
        .windows(2)
        .any(|pair| pair[0].angle_between(pair[1]).to_degrees() > STRAIGHT)
}
