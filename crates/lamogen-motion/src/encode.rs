//! Encodes joint positions as pose features, the inverse of [`joints`](crate::joints).

use glam::{DMat3, DQuat, DVec3};

use crate::features::{FOOT_CONTACT_JOINTS, POSE_FEATURES};
use crate::precise::points;
use crate::skeleton::{CHAINS, JOINTS, Joint};

/// The position of every joint at one frame, in metres.
type Pose = [[f32; 3]; JOINTS];

/// Standard deviation of the Gaussian that smooths the facing direction, in frames.
const FACING_DEVIATION: f64 = 20.0;
/// Half width of the kernel of that Gaussian, in frames.
const FACING_REACH: usize = 80;
/// A foot counts as standing if it moves by less than this between two frames, as a squared distance in m².
const STANDING_BELOW: f64 = 0.002;

/// Moves a motion to where HumanML3D has its motions: the lowest joint of the whole motion is on the ground, the
/// pelvis of the first frame is over the origin, and the first pose faces +Z (Guo et al. 2022).
pub fn canonical(poses: &[Pose]) -> Vec<Pose> {
    let moved = to_canonical(poses.iter().map(points).collect()).into_iter();
    moved
        .map(|pose| pose.map(|point| point.as_vec3().to_array()))
        .collect()
}

/// As [`canonical`], in 64 bits.
fn to_canonical(mut poses: Vec<[DVec3; JOINTS]>) -> Vec<[DVec3; JOINTS]> {
    let Some(first) = poses.first() else {
        return poses;
    };
    let lowest = poses.as_flattened().iter().map(|point| point.y);
    let start = first[Joint::Pelvis.index()];
    let origin = DVec3::new(start.x, lowest.fold(f64::INFINITY, f64::min), start.z);
    let facing = facing(first);
    let turn = DQuat::from_rotation_y(-facing.x.atan2(facing.z));
    for point in poses.as_flattened_mut() {
        *point = turn * (*point - origin);
    }
    poses
}

/// Returns the direction along the ground that a pose faces, from hips and shoulders.
pub(crate) fn facing(pose: &[DVec3; JOINTS]) -> DVec3 {
    let across = right_to_left(pose, Joint::LeftHip, Joint::RightHip)
        + right_to_left(pose, Joint::LeftShoulder, Joint::RightShoulder);
    let facing = across.normalize_or_zero().cross(DVec3::Y);
    facing.normalize_or_zero()
}

/// Computes the pose features of joint positions (Guo et al. 2022, section 5).
///
/// There is one row for every step from a frame to the next, so one row less than there are frames. Positions are
/// taken as they are; a network needs the features of [`canonical`] positions.
///
/// The features are those of HumanML3D's own code, with one difference: where a body turns past straight backwards,
/// that code reverses the step of the heading, and the decoded motion comes back turned. Here the step keeps its
/// direction.
///
/// The rotations among the features are those of HumanML3D: along every chain, the shortest turn from the rest
/// direction of a bone to its actual direction. They are not joint rotations of a rig;
/// [`Rotations`](crate::Rotations) are.
pub fn encode(poses: &[Pose]) -> Vec<[f32; POSE_FEATURES]> {
    feature_rows(&poses.iter().map(points).collect::<Vec<_>>())
}

/// Computes the pose features of the [`canonical`] positions, which are the features that a network understands.
/// The canonical positions are not rounded to 32 bits in between.
pub fn encode_canonical(poses: &[Pose]) -> Vec<[f32; POSE_FEATURES]> {
    feature_rows(&to_canonical(poses.iter().map(points).collect()))
}

/// As [`encode`], with as many rows as there are frames: the motion is continued by one frame at the speed of its
/// last step. The result is empty for fewer than two frames.
pub fn encode_every_frame(poses: &[Pose]) -> Vec<[f32; POSE_FEATURES]> {
    let [.., previous, last] = poses else {
        return Vec::new();
    };
    let next = std::array::from_fn(|joint| {
        std::array::from_fn(|axis| 2.0 * last[joint][axis] - previous[joint][axis])
    });
    encode(&[poses, &[next]].concat())
}

/// Returns one row of features for every step from a frame to the next.
fn feature_rows(poses: &[[DVec3; JOINTS]]) -> Vec<[f32; POSE_FEATURES]> {
    let headings = headings(poses);
    let steps = poses.windows(2).zip(headings.windows(2));
    steps
        .map(|(poses, headings)| feature_row(&poses[0], &poses[1], headings[0], headings[1]))
        .collect()
}

/// Returns the vector from the right joint to the left one.
fn right_to_left(pose: &[DVec3; JOINTS], left: Joint, right: Joint) -> DVec3 {
    pose[left.index()] - pose[right.index()]
}

/// Returns, for every frame, the rotation that makes the body face +Z.
fn headings(poses: &[[DVec3; JOINTS]]) -> Vec<DQuat> {
    // HumanML3D subtracts the vector across the shoulders from the one across the hips instead of adding them, so
    // the smoothed direction hardly depends on where the chest faces. Every model was trained on such data.
    let facing: Vec<DVec3> = poses
        .iter()
        .map(|pose| {
            let hips = right_to_left(pose, Joint::LeftHip, Joint::RightHip);
            let shoulders = right_to_left(pose, Joint::LeftShoulder, Joint::RightShoulder);
            DVec3::Y.cross((hips - shoulders).normalize_or_zero())
        })
        .collect();
    let turns = smooth(&facing)
        .into_iter()
        .enumerate()
        .map(|(frame, facing)| match frame {
            0 => DQuat::IDENTITY,
            _ => shortest_turn(facing.normalize_or_zero(), DVec3::Z),
        });
    turns.collect()
}

/// Smooths a series along time with a Gaussian. The first and the last value are repeated beyond the ends.
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

/// Returns the shortest turn from one direction to another. glam's function is not used, because it treats nearly
/// opposite directions as opposite ones.
fn shortest_turn(from: DVec3, to: DVec3) -> DQuat {
    let v = from.cross(to);
    let w = (from.length_squared() * to.length_squared()).sqrt() + from.dot(to);
    let length = (v.length_squared() + w * w).sqrt();
    match length > 1e-12 {
        true => DQuat::from_xyzw(v.x / length, v.y / length, v.z / length, w / length),
        false => DQuat::from_rotation_x(std::f64::consts::PI),
    }
}

/// Returns the features of a pose and of the step from it to the next one.
fn feature_row(
    pose: &[DVec3; JOINTS],
    next: &[DVec3; JOINTS],
    heading: DQuat,
    next_heading: DQuat,
) -> [f32; POSE_FEATURES] {
    let pelvis = pose[Joint::Pelvis.index()];
    let turn = next_heading * heading.inverse();
    // Both signs of a quaternion are the same rotation; the one that turns by less than 180 degrees is taken.
    let yaw = turn.y * if turn.w < 0.0 { -1.0 } else { 1.0 };
    let root_step = next_heading * (next[Joint::Pelvis.index()] - pelvis);
    let mut values = vec![
        yaw.clamp(-1.0, 1.0).asin(),
        root_step.x,
        root_step.z,
        pelvis.y,
    ];

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
        values.push(if moved.length_squared() < STANDING_BELOW {
            1.0
        } else {
            0.0
        });
    }
    std::array::from_fn(|feature| values[feature] as f32)
}

/// Returns HumanML3D's rotations, each at the joint in which its bone ends. Every chain starts from the heading.
fn chain_rotations(pose: &[DVec3; JOINTS], heading: DQuat) -> [DMat3; JOINTS] {
    let mut rotations = [DMat3::IDENTITY; JOINTS];
    for chain in CHAINS {
        let mut accumulated = heading;
        for bone in chain.windows(2) {
            let direction = (pose[bone[1].index()] - pose[bone[0].index()]).normalize_or_zero();
            let local = accumulated.inverse() * shortest_turn(rest_direction(bone[1]), direction);
            rotations[bone[1].index()] = DMat3::from_quat(local.normalize());
            accumulated *= local;
        }
    }
    rotations
}

/// Returns the rest direction that HumanML3D gives to the bone that ends in a joint.
fn rest_direction(joint: Joint) -> DVec3 {
    use Joint::*;
    match joint {
        LeftHip | LeftCollar => DVec3::X,
        RightHip | RightCollar => DVec3::NEG_X,
        Pelvis | Spine1 | Spine2 | Spine3 | Neck => DVec3::Y,
        LeftFoot | RightFoot | Head => DVec3::Z,
        _ => DVec3::NEG_Y,
    }
}
