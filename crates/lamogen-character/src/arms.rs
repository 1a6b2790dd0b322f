//! Hands that touch: the arms of a character bend so that its hands meet, and touch its body, where those of the motion do.

use glam::{DQuat, DVec3};
use lamogen_motion::{ARMS, Joint, MAX_STRETCH, bend_limb};

use crate::body_part::{BodyPart, PartPlace, SourcePose, body_parts};
use crate::easing::{fade, soften};
use crate::hands::knuckles;
use crate::retarget::{CharacterPose, Retargeter};

/// The distance between the palms, in metres, within which hands touch each other, and the one from which on they do not.
const HAND_DISTANCES: [f64; 2] = [0.12, 0.25];
/// The distance of a palm from the surface of the body, in metres, within which it touches, and the one from which on it does
/// not.
const BODY_DISTANCES: [f64; 2] = [0.04, 0.08];
/// The speed of a palm along a part of the body, in metres a second, up to which it touches, and the one from which on it only
/// passes by.
const BODY_SPEEDS: [f64; 2] = [0.4, 1.0];
/// The length of a hand from the wrist to the knuckles in units of the forearm.
const HAND_LENGTH: f64 = 0.33;
/// The time over which a hand is drawn to and from its place, in seconds.
const BLEND_SECONDS: f64 = 0.25;
/// The angle between hand and forearm, in degrees, above which the hand turns with the forearm.
const MAX_WRIST_BEND: f64 = 60.0;
/// The part of its length up to which an arm is stretched as far as its target asks. From there on it comes to its full length ever
/// more slowly, because the elbow of an arm that becomes straight is fast.
const FREE_STRETCH: f64 = 0.95;
/// The part of its length to which an arm is shortened at most, as an elbow bends by about 150°.
const MIN_STRETCH: f64 = 0.3;
/// The angle in degrees by which the line from shoulder to wrist turns freely, and the one by which it turns at most.
const MAX_SWING: [f64; 2] = [45.0, 75.0];
/// How often the place of two hands between two bodies is moved into the reach of both arms.
const REACH_STEPS: usize = 8;
/// How often hands are placed, because a hand may touch the other arm, which moves as well.
const PASSES: usize = 2;

/// The places of an arm's nodes in the skeleton.
struct ArmNodes {
    shoulder: usize,
    elbow: usize,
    wrist: usize,
    /// The middle of the knuckles relative to the wrist, in the axes of the hand's node and in metres.
    palm: DVec3,
}

impl ArmNodes {
    fn palm(&self, pose: &CharacterPose) -> DVec3 {
        pose.positions[self.wrist] + pose.rotations[self.wrist] * self.palm
    }

    /// Returns the farthest distance of the wrist from the shoulder.
    fn reach(&self, pose: &CharacterPose) -> f64 {
        let [shoulder, elbow, wrist] = self.positions(pose);
        MAX_STRETCH * (shoulder.distance(elbow) + elbow.distance(wrist))
    }

    fn positions(&self, pose: &CharacterPose) -> [DVec3; 3] {
        [self.shoulder, self.elbow, self.wrist].map(|place| pose.positions[place])
    }
}

/// What the hands of the motion touch at one frame.
struct Touches {
    source: SourcePose,
    /// The vector from the left palm to the right one.
    between: DVec3,
    /// The place of each palm at each part of the body.
    places: [Vec<PartPlace>; 2],
}

/// How much hands touch at every frame, from 0 to 1.
struct TouchWeights {
    hands: Vec<f64>,
    /// For each hand and each part of the body; none for a part that the hand never touches.
    parts: [Vec<Option<Vec<f64>>>; 2],
}

/// Bends the arms so that hands that touch each other or the body in the motion do so on the character.
///
/// A hand is drawn to the place at the character's body that corresponds to that at the motion's body, and hands that are near
/// each other to the same distance in units of the hand's length. Over the time before and after, hands are drawn to these places.
/// Hands keep their rotation, unless the wrist would be bent too far.
pub(crate) fn place_hands(retargeter: &Retargeter<'_>, poses: &mut [CharacterPose]) {
    let Some(arms) = arm_nodes(retargeter) else {
        return;
    };
    let parts = body_parts(retargeter);
    let lengths = [0, 1].map(|arm| source_hand_length(retargeter, arm));
    let joints = retargeter.rotations.joints();
    let touches: Vec<Touches> = { joints.iter().enumerate() }
        .map(|(frame, positions)| {
            let source = SourcePose {
                positions: positions.map(|place| DVec3::from(place.map(f64::from))),
                turns: retargeter.global_rotations(frame),
            };
            let palms = [0, 1].map(|arm| source_palm(retargeter, &source, arm, lengths[arm]));
            Touches {
                between: palms[1] - palms[0],
                places: palms.map(|palm| {
                    let places = parts.iter().map(|part| part.place_of(palm, &source));
                    places.collect()
                }),
                source,
            }
        })
        .collect();
    let rate = f64::from(retargeter.rotations.frames_per_second());
    let weights = touch_weights(&parts, &touches, rate);
    let hand_scale = { arms.iter().zip(lengths) }
        .map(|(arm, length)| arm.palm.length() / length)
        .sum::<f64>()
        / 2.0;
    for (frame, pose) in poses.iter_mut().enumerate() {
        let is_touching =
            weights.hands[frame] > 0.0 || { weights.parts.iter().flatten().flatten() }
                .any(|weights| weights[frame] > 0.0);
        if !is_touching {
            continue;
        }
        let free = pose.clone();
        for _ in 0..PASSES {
            let mut targets = [0, 1].map(|hand| {
                let palm = arms[hand].palm(&free);
                let (mut shift, mut total) = (DVec3::ZERO, 0.0);
                for (part, weights) in weights.parts[hand].iter().enumerate() {
                    let weight = weights.as_ref().map_or(0.0, |weights| weights[frame]);
                    if weight > 0.0 {
                        let touch = &touches[frame];
                        let place = &touch.places[hand][part];
                        let skeleton = retargeter.skeleton;
                        let target = parts[part].point_at(place, &touch.source, pose, skeleton);
                        shift += weight * (target - palm);
                        total += weight;
                    }
                }
                palm + shift / f64::max(total, 1.0)
            });
            let weight = weights.hands[frame];
            if weight > 0.0 {
                let between = retargeter.skeleton.facing * touches[frame].between * hand_scale;
                let middle = targets[0].midpoint(targets[1]);
                let middle = reachable_middle(middle, between, &arms, &free);
                let met = [middle - between / 2.0, middle + between / 2.0];
                for (target, met) in targets.iter_mut().zip(met) {
                    *target = target.lerp(met, weight);
                }
            }
            *pose = reach(retargeter, &arms, &free, targets, &touches[frame].source);
        }
    }
}

/// Returns the nodes of both arms; `None` if one is not whole.
fn arm_nodes(retargeter: &Retargeter<'_>) -> Option<[ArmNodes; 2]> {
    let skeleton = retargeter.skeleton;
    let arm = |[shoulder, elbow, wrist]: [Joint; 3]| {
        let nodes = [shoulder, elbow, wrist].map(|joint| skeleton.joint(joint));
        let [Some(shoulder), Some(elbow), Some(wrist)] = nodes else {
            return None;
        };
        let at = |place: usize| skeleton.nodes[place].world_position;
        let forearm = at(wrist) - at(elbow);
        let palm = match knuckles(skeleton, wrist) {
            Some(knuckles) => knuckles - at(wrist),
            None => forearm * HAND_LENGTH,
        };
        Some(ArmNodes {
            shoulder,
            elbow,
            wrist,
            palm: skeleton.nodes[wrist].world_rotation.inverse() * palm,
        })
    };
    let [left, right] = ARMS.map(arm);
    Some([left?, right?])
}

/// Returns the length of a hand of the motion's body from the wrist to the knuckles.
fn source_hand_length(retargeter: &Retargeter<'_>, arm: usize) -> f64 {
    let [_, elbow, wrist] = ARMS[arm].map(|joint| retargeter.source_rest[joint.index()]);
    HAND_LENGTH * elbow.distance(wrist)
}

/// Returns the middle of the knuckles of the motion's body.
fn source_palm(retargeter: &Retargeter<'_>, pose: &SourcePose, arm: usize, length: f64) -> DVec3 {
    let [_, elbow, wrist] = ARMS[arm].map(Joint::index);
    let forearm = retargeter.source_rest[wrist] - retargeter.source_rest[elbow];
    pose.positions[wrist] + pose.turns[wrist] * forearm.normalize_or_zero() * length
}

/// Returns how much hands touch what at every frame.
fn touch_weights(parts: &[BodyPart], touches: &[Touches], rate: f64) -> TouchWeights {
    let reach = (BLEND_SECONDS / 2.0 * rate).round() as usize;
    let weight =
        |value: f64, [all, none]: [f64; 2]| fade(((value - all) / (none - all)).clamp(0.0, 1.0));
    let hands: Vec<f64> = { touches.iter() }
        .map(|touch| weight(touch.between.length(), HAND_DISTANCES))
        .collect();
    let parts = [0, 1].map(|hand| {
        let weights = parts.iter().enumerate().map(|(index, part)| {
            if part.arm == Some(hand) {
                return None;
            }
            let places: Vec<&PartPlace> = { touches.iter() }
                .map(|touch| &touch.places[hand][index])
                .collect();
            let weights: Vec<f64> = (0..places.len())
                .map(|frame| {
                    let (before, after) = (frame.saturating_sub(1), frame + 1);
                    let after = after.min(places.len() - 1);
                    let seconds = (after - before).max(1) as f64 / rate;
                    let speed = places[after].distance_from(places[before]) / seconds;
                    let distance = places[frame].distance;
                    weight(distance, BODY_DISTANCES) * weight(speed, BODY_SPEEDS)
                })
                .collect();
            let is_touched = weights.iter().any(|weight| *weight > 0.0);
            is_touched.then(|| soften(&weights, reach))
        });
        weights.collect()
    });
    TouchWeights {
        hands: soften(&hands, reach),
        parts,
    }
}

/// Moves the middle between two hands so that both arms reach their hand's place, if there is such a middle.
fn reachable_middle(
    middle: DVec3,
    between: DVec3,
    arms: &[ArmNodes; 2],
    pose: &CharacterPose,
) -> DVec3 {
    let mut middle = middle;
    for step in 0..REACH_STEPS {
        let hand = step % 2;
        let arm = &arms[hand];
        let side = if hand == 0 { -0.5 } else { 0.5 };
        let wrist = middle + side * between - pose.rotations[arm.wrist] * arm.palm;
        let from_shoulder = wrist - pose.positions[arm.shoulder];
        let excess = from_shoulder.length() - arm.reach(pose);
        if excess > 0.0 {
            middle -= from_shoulder.normalize() * excess;
        }
    }
    middle
}

/// Bends both arms so that the palms come to their targets.
fn reach(
    retargeter: &Retargeter<'_>,
    arms: &[ArmNodes; 2],
    free: &CharacterPose,
    targets: [DVec3; 2],
    source: &SourcePose,
) -> CharacterPose {
    let mut world: Vec<Option<DQuat>> = vec![None; free.rotations.len()];
    for place in retargeter.driven_places() {
        world[place] = Some(free.rotations[place]);
    }
    for (hand, (arm, target)) in arms.iter().zip(targets).enumerate() {
        if target.distance(arm.palm(free)) < 1e-9 {
            continue;
        }
        // In the T-pose of the motion's body an elbow that bends goes backwards.
        let turn = source.turns[ARMS[hand][0].index()];
        let pole = retargeter.skeleton.facing * (turn * DVec3::NEG_Z);
        let [upper, forearm, hand] = bend_arm(arm, free, target, pole);
        world[arm.shoulder] = Some(upper * free.rotations[arm.shoulder]);
        world[arm.elbow] = Some(forearm * free.rotations[arm.elbow]);
        world[arm.wrist] = Some(hand * free.rotations[arm.wrist]);
    }
    let pelvis = retargeter.skeleton.joint(Joint::Pelvis).expect("a pelvis");
    retargeter.place_nodes(&world, free.positions[pelvis])
}

/// Returns the rotations in the world of upper arm, forearm and hand that bring the palm to a target.
fn bend_arm(arm: &ArmNodes, pose: &CharacterPose, target: DVec3, pole: DVec3) -> [DQuat; 3] {
    let positions = arm.positions(pose);
    let forearm = positions[2] - positions[1];
    let palm = pose.rotations[arm.wrist] * arm.palm;
    let limit = MAX_WRIST_BEND.to_radians().max(palm.angle_between(forearm));
    let mut hand = DQuat::IDENTITY;
    let mut bent = [DQuat::IDENTITY; 2];
    // Where the wrist has to be depends on how the hand turns, and this on where the forearm comes to lie.
    for _ in 0..4 {
        let wrist = within_reach(positions, target - hand * palm);
        bent = bend_limb(positions, wrist, Some(pole));
        let excess = palm.angle_between(bent[1] * forearm) - limit;
        let axis = palm.cross(bent[1] * forearm).try_normalize();
        hand = match axis {
            Some(axis) if excess > 0.0 => DQuat::from_axis_angle(axis, excess),
            _ => DQuat::IDENTITY,
        };
    }
    [bent[0], bent[1], hand]
}

/// Moves the target of a wrist to where the arm can bring it: neither to its full length at once, nor nearer to the shoulder than an
/// elbow bends, nor to quite another direction.
fn within_reach([shoulder, elbow, wrist]: [DVec3; 3], target: DVec3) -> DVec3 {
    let length = shoulder.distance(elbow) + elbow.distance(wrist);
    let free = wrist.distance(shoulder) / length;
    let asked = target.distance(shoulder) / length;
    // An arm that is as straight or as bent already need not change.
    let stretched = soft_limit(asked, FREE_STRETCH, MAX_STRETCH)
        .max(asked.min(free))
        .max(free.min(MIN_STRETCH));
    let directions = [wrist - shoulder, target - shoulder].map(DVec3::try_normalize);
    let [Some(old), Some(new)] = directions else {
        return wrist;
    };
    let angle = old.angle_between(new);
    let [most, all] = MAX_SWING.map(f64::to_radians);
    let direction = match old.cross(new).try_normalize() {
        Some(axis) if angle > most => {
            DQuat::from_axis_angle(axis, soft_limit(angle, most, all)) * old
        }
        _ => new,
    };
    shoulder + direction * (stretched * length)
}

/// Returns a value that is the same up to a first limit, and from there on comes ever more slowly to a second one.
fn soft_limit(value: f64, first: f64, second: f64) -> f64 {
    let rest = second - first;
    match value > first {
        true => first + rest * (1.0 - (-(value - first) / rest).exp()),
        false => value,
    }
}
