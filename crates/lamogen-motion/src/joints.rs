//! Decodes pose features into joint positions, as a differentiable function of tensors.

use burn::tensor::Tensor;

use crate::features::FeatureGroup;
use crate::skeleton::JOINTS;

/// Computes the global joint positions of pose features (not normalised); differentiable.
///
/// The heading at a frame is the sum of the yaw steps before it. The root's path is the sum of its
/// velocities, each rotated by the heading; the other joints are placed relative to the root. The
/// features store *half* angles, so every rotation is by twice their sum (Guo et al. 2022,
/// `recover_from_ric`). Only the features of the root and the local positions are read: rotations,
/// velocities and contacts add nothing to the positions.
///
/// # Shapes
///
/// - `features`: `[batch, frames, features]`, of which the first 67 are read
/// - output: `[batch, frames, 22, 3]` in metres; the motion starts over the origin facing +Z
///
/// # Panics
///
/// If there are fewer than 67 features or no frame.
pub fn joints(features: Tensor<3>) -> Tensor<4> {
    let [batch, frames, width] = features.dims();
    let read = FeatureGroup::LocalPositions.range().end;
    assert!(
        width >= read && frames > 0,
        "joints need at least 1 frame of {read} features, got {frames} frames of {width}"
    );
    // All groups are cut out in one piece first, so that the gradient is padded to the full width once instead of
    // once per group.
    let features = features.narrow(2, 0, read);
    let group = |group: FeatureGroup| {
        let range = group.range();
        features.clone().narrow(2, range.start, range.len())
    };

    let heading = prefix_sum(earlier_frame(group(FeatureGroup::RootYaw))) * 2.0;
    let (cos, sin) = (heading.clone().cos(), heading.sin());

    let velocity = earlier_frame(group(FeatureGroup::RootVelocity));
    let (x, z) = turn(
        velocity.clone().narrow(2, 0, 1),
        velocity.narrow(2, 1, 1),
        &cos,
        &sin,
    );
    let (root_x, root_z) = (prefix_sum(x), prefix_sum(z));
    let root_y = group(FeatureGroup::RootHeight);

    let local = group(FeatureGroup::LocalPositions).reshape([batch, frames, JOINTS - 1, 3]);
    let axis = |axis: usize| {
        local
            .clone()
            .narrow(3, axis, 1)
            .reshape([batch, frames, JOINTS - 1])
    };
    let (x, z) = turn(axis(0), axis(2), &cos, &sin);

    Tensor::stack(
        vec![
            Tensor::cat(vec![root_x.clone(), x + root_x], 2),
            Tensor::cat(vec![root_y, axis(1)], 2),
            Tensor::cat(vec![root_z.clone(), z + root_z], 2),
        ],
        3,
    )
}

/// Rotates x and z about Y by an angle with the given cosine and sine.
fn turn(x: Tensor<3>, z: Tensor<3>, cos: &Tensor<3>, sin: &Tensor<3>) -> (Tensor<3>, Tensor<3>) {
    (
        x.clone() * cos.clone() - z.clone() * sin.clone(),
        x * sin.clone() + z * cos.clone(),
    )
}

/// Shifts values by one frame: each frame gets the value of the frame before, and the first one gets 0.
fn earlier_frame(x: Tensor<3>) -> Tensor<3> {
    let [batch, frames, width] = x.dims();
    let first = Tensor::zeros([batch, 1, width], &x.device());
    if frames == 1 {
        return first;
    }
    Tensor::cat(vec![first, x.narrow(1, 0, frames - 1)], 1)
}

/// Returns the cumulative sums along frames, exact to about the last bit.
///
/// Early in a pass the predicted motion spins and runs far, and a rounding error at every frame would
/// show in its accelerations. Each number is therefore split into a coarse part and a small rest, which
/// are summed separately. Sums of coarse parts are exact as long as they stay below 4096.
fn prefix_sum(x: Tensor<3>) -> Tensor<3> {
    const GRID: f32 = 4096.0;
    let coarse = (x.clone().detach() * GRID).round() / GRID;
    let rest = x - coarse.clone();
    coarse.cumsum(1) + rest.cumsum(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::POSE_FEATURES;
    use crate::skeleton::Joint;
    use burn::tensor::{Device, TensorData};

    /// Returns the features of a body whose joints are at (index of the joint, 1, 0) in the frame of its heading, and
    /// which turns by `yaw` and moves by `step` at every frame.
    fn walk(frames: usize, yaw: f32, step: [f32; 2]) -> Tensor<3> {
        let mut row = vec![0.0; POSE_FEATURES];
        row[0] = yaw;
        row[1] = step[0];
        row[2] = step[1];
        row[3] = 0.9;
        for joint in 1..JOINTS {
            row[4 + 3 * (joint - 1)] = joint as f32;
            row[5 + 3 * (joint - 1)] = 1.0;
        }
        let data = TensorData::new(row.repeat(frames), [1, frames, POSE_FEATURES]);
        Tensor::from_data(data, &Device::flex())
    }

    fn at(joints: &Tensor<4>, frame: usize, joint: Joint) -> [f32; 3] {
        let point = joints
            .clone()
            .narrow(1, frame, 1)
            .narrow(2, joint.index(), 1);
        point
            .into_data()
            .try_to_vec::<f32>()
            .unwrap()
            .try_into()
            .unwrap()
    }

    fn close(a: [f32; 3], b: [f32; 3]) {
        let distance = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>();
        assert!(distance < 1e-4, "{a:?} is not {b:?}");
    }

    #[test]
    fn a_straight_walk_adds_up_its_steps() {
        let joints = joints(walk(5, 0.0, [0.0, 0.1]));
        close(at(&joints, 0, Joint::Pelvis), [0.0, 0.9, 0.0]);
        close(at(&joints, 4, Joint::Pelvis), [0.0, 0.9, 0.4]);
        close(at(&joints, 4, Joint::LeftKnee), [4.0, 1.0, 0.4]);
    }

    #[test]
    fn half_angles_turn_the_body_by_twice_their_sum() {
        // Each step turns by π/4, twice the half angle of π/8: by 90 degrees after two steps and 180 after four.
        let joints = joints(walk(5, std::f32::consts::PI / 8.0, [0.0, 0.0]));
        close(at(&joints, 2, Joint::LeftHip), [0.0, 1.0, 1.0]);
        close(at(&joints, 4, Joint::LeftHip), [-1.0, 1.0, 0.0]);
    }

    #[test]
    fn sums_over_many_frames_lose_nothing() {
        let values: Vec<f32> = (0..196).map(|i| 3.0 + (i as f32).sin() * 0.7).collect();
        let data = TensorData::new(values.clone(), [1, 196, 1]);
        let sums = prefix_sum(Tensor::from_data(data, &Device::flex()));
        let mut exact = 0.0;
        for (value, sum) in values.into_iter().zip(sums.into_data().iter::<f32>()) {
            exact += f64::from(value);
            assert!((f64::from(sum) - exact).abs() <= f64::from(exact as f32 * f32::EPSILON / 2.0));
        }
    }

    #[test]
    fn one_frame_stands_at_the_origin() {
        let joints = joints(walk(1, 0.3, [5.0, 5.0]));
        close(at(&joints, 0, Joint::Pelvis), [0.0, 0.9, 0.0]);
    }

    #[test]
    fn gradients_reach_every_feature_that_is_read() {
        let features = walk(6, 0.2, [0.1, 0.3]).autodiff().require_grad();
        let weights: Vec<f32> = (0..6 * JOINTS * 3)
            .map(|i| 1.0 + 0.5 * (i as f32 * 1.7).sin())
            .collect();
        let weights = TensorData::new(weights, [1, 6, JOINTS, 3]);
        let weights = Tensor::<4>::from_data(weights, &Device::flex());
        let loss = (joints(features.clone()) * weights).sum();
        let gradient = features.grad(&loss.backward()).unwrap();
        let gradient = gradient.abs().sum_dim(1).into_data();
        for (feature, value) in gradient.as_slice::<f32>().unwrap().iter().enumerate() {
            assert_eq!(*value != 0.0, feature < 67, "feature {feature}: {value}");
        }
    }
}
