//! From joint positions to pose features: the way back from [`joints`](crate::joints).

use glam::{DMat3, DQuat, DVec3};

use crate::features::{FOOT_CONTACT_JOINTS, POSE_FEATURES};
use crate::precise::points;
use crate::skeleton::{CHAINS, JOINTS, Joint};

/// Where every joint is at one frame, in metres.
type Pose = [[f32; 3]; JOINTS];

/// Standard deviation and reach of the smoothing of the facing direction, in frames.
const FACING_DEVIATION: f64 = 20.0;
const FACING_REACH: usize = 80;
/// A foot stands if it moves less than this between two frames, in m².
const STANDING: f64 = 0.002;

/// Puts a motion where HumanML3D has it: the lowest joint of the whole motion on the ground, the first
/// pelvis over the origin, the first pose facing +Z (Guo et al. 2022).
pub fn canonical(poses: &[Pose]) -> Vec<Pose> {
    let placed = place(poses.iter().map(points).collect()).into_iter();
    placed
        .map(|pose| pose.map(|point| point.as_vec3().to_array()))
        .collect()
}

fn place(mut poses: Vec<[DVec3; JOINTS]>) -> Vec<[DVec3; JOINTS]> {
    let Some(first) = poses.first() else {
        return poses;
    };
    let lowest = poses.as_flattened().iter().map(|point| point.y);
    let start = first[Joint::Pelvis.index()];
    let origin = DVec3::new(start.x, lowest.fold(f64::INFINITY, f64::min), start.z);
    let across = across(first, Joint::LeftHip, Joint::RightHip)
        + across(first, Joint::LeftShoulder, Joint::RightShoulder);
    let facing = across
        .normalize_or_zero()
        .cross(DVec3::Y)
        .normalize_or_zero();
    let turn = DQuat::from_rotation_y(-facing.x.atan2(facing.z));
    for point in poses.as_flattened_mut() {
        *point = turn * (*point - origin);
    }
    poses
}

/// The pose features of joint positions, a row for every step from a frame to the next: one row less than
/// there are frames (Guo et al. 2022, section 5). Positions are taken as they are; features that a network
/// shall understand are those of [`canonical`] positions.
///
/// They are what HumanML3D's own code gives, but for one thing: where a body turns past straight backwards,
/// that code lets the step of the heading point the other way, and the motion comes back turned. Here the
/// step keeps its side.
///
/// Rotations are those of HumanML3D: along every chain the shortest turn from the rest direction of a bone
/// to the bone. They are no joint rotations of a rig; [`Rotations`](crate::Rotations) are.
pub fn encode(poses: &[Pose]) -> Vec<[f32; POSE_FEATURES]> {
    rows(&poses.iter().map(points).collect::<Vec<_>>())
}

/// The pose features that a network understands: those of the [`canonical`] positions, which are not rounded in
/// between.
pub fn encode_canonical(poses: &[Pose]) -> Vec<[f32; POSE_FEATURES]> {
    rows(&place(poses.iter().map(points).collect()))
}

/// As [`encode`], with as many rows as there are frames: after the last frame the motion goes on as before it. None for fewer than two frames.
pub fn encode_every_frame(poses: &[Pose]) -> Vec<[f32; POSE_FEATURES]> {
    let [.., before, last] = poses else {
        return Vec::new();
    };
    let next = std::array::from_fn(|joint| {
        std::array::from_fn(|axis| 2.0 * last[joint][axis] - before[joint][axis])
    });
    encode(&[poses, &[next]].concat())
}

fn rows(poses: &[[DVec3; JOINTS]]) -> Vec<[f32; POSE_FEATURES]> {
    let headings = headings(poses);
    let steps = poses.windows(2).zip(headings.windows(2));
    steps
        .map(|(poses, headings)| row(&poses[0], &poses[1], headings[0], headings[1]))
        .collect()
}

/// From the right to the left.
fn across(pose: &[DVec3; JOINTS], left: Joint, right: Joint) -> DVec3 {
    pose[left.index()] - pose[right.index()]
}

/// The turn at every frame that makes the body face +Z.
fn headings(poses: &[[DVec3; JOINTS]]) -> Vec<DQuat> {
    // The published data counts the shoulders the other way around than the hips, so what is smoothed
    // hardly depends on where the chest faces. Every model was trained so.
    let facing: Vec<DVec3> = poses
        .iter()
        .map(|pose| {
            let hips = across(pose, Joint::LeftHip, Joint::RightHip);
            let shoulders = across(pose, Joint::LeftShoulder, Joint::RightShoulder);
            DVec3::Y.cross((hips - shoulders).normalize_or_zero())
        })
        .collect();
    let turns = smooth(&facing)
        .into_iter()
        .enumerate()
        .map(|(frame, facing)| match frame {
            0 => DQuat::IDENTITY,
            _ => between(facing.normalize_or_zero(), DVec3::Z),
        });
    turns.collect()
}

/// Gaussian smoothing along time; beyond the ends the first and the last value go on.
fn smooth(series: &[DVec3]) -> Vec<DVec3> {
    let reach = FACING_REACH as i64;
    let kernel: Vec<f64> = (-reach..=reach)
        .map(|offset| (-0.5 * (offset as f64 / FACING_DEVIATION).powi(2)).exp())
        .collect();
    let sum: f64 = kernel.iter().sum();
    let last = series.len() as i64 - 1;
    (0..=last)
        .map(|frame| {
            let taps = (frame - reach..).map(|tap| series[tap.clamp(0, last) as usize]);
            kernel
                .iter()
                .zip(taps)
                .map(|(weight, value)| value * (weight / sum))
                .sum()
        })
        .collect()
}

/// The shortest turn from one direction to another. Not glam's, which takes nearly opposite directions for
/// opposite ones.
fn between(from: DVec3, to: DVec3) -> DQuat {
    let v = from.cross(to);
    let w = (from.length_squared() * to.length_squared()).sqrt() + from.dot(to);
    let length = (v.length_squared() + w * w).sqrt();
    match length > 1e-12 {
        true => DQuat::from_xyzw(v.x / length, v.y / length, v.z / length, w / length),
        false => DQuat::from_rotation_x(std::f64::consts::PI),
    }
}

fn row(
    pose: &[DVec3; JOINTS],
    next: &[DVec3; JOINTS],
    heading: DQuat,
    next_heading: DQuat,
) -> [f32; POSE_FEATURES] {
    let pelvis = pose[Joint::Pelvis.index()];
    let turn = next_heading * heading.inverse();
    // The two quaternions of a turn differ in sign: the one is taken that turns less than half around.
    let yaw = turn.y * if turn.w < 0.0 { -1.0 } else { 1.0 };
    let walked = next_heading * (next[Joint::Pelvis.index()] - pelvis);
    let mut values = vec![yaw.clamp(-1.0, 1.0).asin(), walked.x, walked.z, pelvis.y];

    let ground = DVec3::new(pelvis.x, 0.0, pelvis.z);
    for &point in &pose[1..] {
        values.extend((heading * (point - ground)).to_array());
    }
    for rotation in &chain_rotations(pose, heading)[1..] {
        values.extend(rotation.x_axis.to_array());
        values.extend(rotation.y_axis.to_array());
    }
    for (from, to) in pose.iter().zip(next) {
        values.extend((heading * (*to - *from)).to_array());
    }
    for joint in FOOT_CONTACT_JOINTS {
        let moved = next[joint.index()] - pose[joint.index()];
        values.push(if moved.length_squared() < STANDING {
            1.0
        } else {
            0.0
        });
    }
    std::array::from_fn(|feature| values[feature] as f32)
}

/// HumanML3D's rotations, each at the joint where its bone ends. Every chain starts from the heading.
fn chain_rotations(pose: &[DVec3; JOINTS], heading: DQuat) -> [DMat3; JOINTS] {
    let mut rotations = [DMat3::IDENTITY; JOINTS];
    for chain in CHAINS {
        let mut turned = heading;
        for bone in chain.windows(2) {
            let direction = (pose[bone[1].index()] - pose[bone[0].index()]).normalize_or_zero();
            let local = turned.inverse() * between(rest(bone[1]), direction);
            rotations[bone[1].index()] = DMat3::from_quat(local.normalize());
            turned *= local;
        }
    }
    rotations
}

/// The direction that HumanML3D gives the bone that ends in a joint before it is turned.
fn rest(joint: Joint) -> DVec3 {
    use Joint::*;
    match joint {
        LeftHip | LeftCollar => DVec3::X,
        RightHip | RightCollar => DVec3::NEG_X,
        Pelvis | Spine1 | Spine2 | Spine3 | Neck => DVec3::Y,
        LeftFoot | RightFoot | Head => DVec3::Z,
        _ => DVec3::NEG_Y,
    }
}
