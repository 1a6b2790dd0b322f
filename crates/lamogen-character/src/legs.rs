//! Feet that stand: the legs of a character bend so that its feet keep their places.

use glam::{DQuat, DVec3};
use lamogen_body::foot_contacts;
use lamogen_motion::{FRAMES_PER_SECOND, Joint, MAX_STRETCH, Motion, bend_limb, smooth_step};

use crate::easing::{fade, soften};
use crate::retarget::{CharacterPose, Retargeter};

/// The joints of a leg: hip, knee, ankle and the ball of the foot.
const LEGS: [[Joint; 4]; 2] = [
    [
        Joint::LeftHip,
        Joint::LeftKnee,
        Joint::LeftAnkle,
        Joint::LeftFoot,
    ],
    [
        Joint::RightHip,
        Joint::RightKnee,
        Joint::RightAnkle,
        Joint::RightFoot,
    ],
];

/// The time over which a foot is drawn to and from its place, in seconds.
const BLEND_SECONDS: f64 = 0.25;
/// The time over which the pelvis sinks for a foot that it is too high for, in seconds.
const SINK_SECONDS: f64 = 0.2;

/// The places of a leg's nodes in the skeleton.
struct LegNodes {
    hip: usize,
    knee: usize,
    ankle: usize,
    ball: Option<usize>,
}

/// Bends the legs so that feet that stand in the motion neither slide nor sink.
///
/// While a foot stands, the joint that stands keeps its mean position along the ground. Over the time before and after, the
/// foot is drawn to this position. The foot keeps its rotation. No foot sinks below where it is in the rest pose. If a leg
/// is too short, the pelvis sinks.
pub(crate) fn plant_feet(
    retargeter: &Retargeter<'_>,
    motion: &Motion,
    poses: &mut [CharacterPose],
) {
    let skeleton = retargeter.skeleton;
    let rate = f64::from(retargeter.rotations.frames_per_second());
    let contacts = foot_contacts(motion);
    let legs: Vec<(LegNodes, Vec<DVec3>)> = LEGS
        .into_iter()
        .filter_map(|[hip, knee, ankle, ball]| {
            let nodes = LegNodes {
                hip: skeleton.joint(hip)?,
                knee: skeleton.joint(knee)?,
                ankle: skeleton.joint(ankle)?,
                ball: skeleton.joint(ball),
            };
            let mut stands: Vec<Stand> = Vec::new();
            for contact in &contacts {
                let joint = match contact.joint {
                    joint if joint == ankle => nodes.ankle,
                    joint if joint == ball => nodes.ball.unwrap_or(nodes.ankle),
                    _ => continue,
                };
                let frame = |frame: usize| frame as f64 / f64::from(FRAMES_PER_SECOND) * rate;
                let from = frame(contact.from).ceil() as usize;
                let until = (frame(contact.until - 1).floor() as usize + 1).min(poses.len());
                if from < until {
                    stands.push(Stand::new(poses, joint, from..until));
                }
            }
            let shifts = shifts(retargeter, &nodes, &stands, poses, rate);
            Some((nodes, shifts))
        })
        .collect();
    let sinks = sinks(&legs, poses, rate);
    for (frame, pose) in poses.iter_mut().enumerate() {
        let sink = DVec3::Y * sinks[frame];
        let mut world: Vec<Option<DQuat>> = vec![None; pose.rotations.len()];
        for place in retargeter.driven_places() {
            world[place] = Some(pose.rotations[place]);
        }
        for (nodes, shifts) in &legs {
            let [hip, knee, ankle] =
                [nodes.hip, nodes.knee, nodes.ankle].map(|place| pose.positions[place]);
            let target = ankle + shifts[frame];
            if (target - ankle).length() < 1e-9 && sinks[frame] > -1e-9 {
                continue;
            }
            let [thigh, shin] = bend_limb([hip + sink, knee + sink, ankle + sink], target, None);
            world[nodes.hip] = Some(thigh * pose.rotations[nodes.hip]);
            world[nodes.knee] = Some(shin * pose.rotations[nodes.knee]);
        }
        let pelvis = skeleton.joint(Joint::Pelvis).expect("a pelvis");
        let place = pose.positions[pelvis] + sink;
        *pose = retargeter.place_nodes(&world, place);
    }
}

/// A time in which a joint of a foot stands.
struct Stand {
    joint: usize,
    frames: std::ops::Range<usize>,
    /// The mean position along the ground.
    place: DVec3,
}

impl Stand {
    fn new(poses: &[CharacterPose], joint: usize, frames: std::ops::Range<usize>) -> Stand {
        let positions = poses[frames.clone()]
            .iter()
            .map(|pose| pose.positions[joint]);
        let place = positions.sum::<DVec3>() / frames.len() as f64;
        Stand {
            joint,
            frames,
            place,
        }
    }
}

/// Returns how far a foot is moved at every frame, so that it stands where it stands and sinks nowhere.
fn shifts(
    retargeter: &Retargeter<'_>,
    nodes: &LegNodes,
    stands: &[Stand],
    poses: &[CharacterPose],
    rate: f64,
) -> Vec<DVec3> {
    // The ball says where a foot is while it stands, and the ankle where only the heel does.
    let known: Vec<Option<DVec3>> = (0..poses.len())
        .map(|frame| {
            let stands = stands.iter().filter(|stand| stand.frames.contains(&frame));
            let stand = stands.min_by_key(|stand| Some(stand.joint) != nodes.ball)?;
            let mut shift = stand.place - poses[frame].positions[stand.joint];
            shift.y = 0.0;
            Some(shift)
        })
        .collect();
    // The nearest frames before and after each frame at which the foot stands.
    let nearest = |nearest: &mut Option<usize>, frame: usize| {
        *nearest = known[frame].map(|_| frame).or(*nearest);
        Some(*nearest)
    };
    let last_known: Vec<Option<usize>> = (0..poses.len()).scan(None, nearest).collect();
    let mut next_known: Vec<Option<usize>> = (0..poses.len()).rev().scan(None, nearest).collect();
    next_known.reverse();
    let reach = BLEND_SECONDS * rate;
    let mut shifts: Vec<DVec3> = (0..poses.len())
        .map(|frame| {
            if let Some(shift) = known[frame] {
                return shift;
            }
            let before = last_known[frame].and_then(|at| Some((frame - at, known[at]?)));
            let after = next_known[frame].and_then(|at| Some((at - frame, known[at]?)));
            let faded = |neighbour: Option<(usize, DVec3)>| {
                let (distance, shift) = neighbour?;
                Some((distance, shift * fade(distance as f64 / reach)))
            };
            match (faded(before), faded(after)) {
                (None, None) => DVec3::ZERO,
                (Some((_, shift)), None) | (None, Some((_, shift))) => shift,
                (Some((before, first)), Some((after, second))) => {
                    // In a short step one place is left for the other; in a long one the foot is free between them.
                    let part = before as f64 / (before + after) as f64;
                    first * (1.0 - smooth_step(part)) + second * smooth_step(part)
                }
            }
        })
        .collect();
    let rest = |place: usize| retargeter.skeleton.nodes[place].world_position.y;
    for (shift, pose) in shifts.iter_mut().zip(poses) {
        let joints = [Some(nodes.ankle), nodes.ball].into_iter().flatten();
        // The ankle of a foot that points down is higher than in the rest pose, so the lowest joint decides.
        let depth = joints
            .map(|place| rest(place) - pose.positions[place].y)
            .fold(0.0, f64::max);
        shift.y = depth;
    }
    smooth_heights(&mut shifts, poses, rate);
    shifts
}

/// Lets the heights of shifts begin and end softly without lowering them.
fn smooth_heights(shifts: &mut [DVec3], poses: &[CharacterPose], rate: f64) {
    let reach = (SINK_SECONDS * rate / 2.0).round() as usize;
    let heights: Vec<f64> = shifts.iter().map(|shift| shift.y).collect();
    for (frame, height) in soften(&heights, reach)
        .into_iter()
        .enumerate()
        .take(poses.len())
    {
        shifts[frame].y = height;
    }
}

/// Returns how far the pelvis moves up at every frame, which is 0 or less: no leg has to be longer than it is.
fn sinks(legs: &[(LegNodes, Vec<DVec3>)], poses: &[CharacterPose], rate: f64) -> Vec<f64> {
    let depths = poses.iter().enumerate().map(|(frame, pose)| {
        let depth = |(nodes, shifts): &(LegNodes, Vec<DVec3>)| {
            let [hip, knee, ankle] =
                [nodes.hip, nodes.knee, nodes.ankle].map(|place| pose.positions[place]);
            let length = MAX_STRETCH * (hip.distance(knee) + knee.distance(ankle));
            let target = ankle + shifts[frame];
            let mut along = target - hip;
            let height = -along.y;
            along.y = 0.0;
            // How high the hip may be above the foot.
            let highest = (length * length - along.length_squared()).max(0.0).sqrt();
            match shifts[frame].length() > 1e-9 && height > 0.0 {
                true => (height - highest).max(0.0),
                false => 0.0,
            }
        };
        legs.iter().map(depth).fold(0.0, f64::max)
    });
    let depths: Vec<f64> = depths.collect();
    let reach = (SINK_SECONDS * rate / 2.0).round() as usize;
    soften(&depths, reach)
        .into_iter()
        .map(|depth| -depth)
        .collect()
}
