//! Places as terms of the loss.

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::{JOINTS, Joint};

use super::frame_at;
use super::ground_path::GroundPath;
use super::key_pose::KeyPose;
use super::reach::Reach;
use super::root_plan::Directions;
use crate::loss_term::{LossTarget, LossTerm};

/// The distance from a place of a path, in metres, that costs as much in the network's pass as a Laban feature that is off by
/// 100 % at one frame. On the body places count far more (`PLACE_EMPHASIS` of the rig).
const PATH_TOLERANCE: f32 = 0.5;
/// The distance of a part of the body from the position that it reaches, in metres, that costs as much.
const REACH_TOLERANCE: f32 = 0.2;
/// The difference of two directions, as the distance of unit vectors, that costs as much at each frame.
const FACING_TOLERANCE: f32 = 10.0;
/// The distance of each joint of a pose, in metres, that costs as much.
const POSE_TOLERANCE: f32 = 0.5;

/// The places of a path: x and z of the pelvis.
#[derive(Debug)]
pub(super) struct PathTerm {
    /// The place at each frame that has one.
    places: Vec<Option<[f32; 2]>>,
}

/// The direction in which the body faces: x and z of a unit vector.
#[derive(Debug)]
pub(super) struct FacingTerm(Directions);

/// The pose of the body at one frame: the positions of all joints, relative to where the body stands and faces.
#[derive(Debug)]
pub(super) struct PoseTerm {
    pose: KeyPose,
    frame: usize,
}

/// The position of a part of the body at one frame.
#[derive(Debug)]
pub(super) struct ReachTerm {
    reach: Reach,
    frame: usize,
}

impl PathTerm {
    pub(super) fn new(path: &GroundPath, frames: usize) -> PathTerm {
        let mut places = vec![None; frames];
        for point in path.waypoints() {
            places[frame_at(point.seconds, frames)] = Some(point.place);
        }
        PathTerm { places }
    }
}

impl FacingTerm {
    pub(super) fn new(directions: Directions) -> FacingTerm {
        FacingTerm(directions)
    }
}

impl PoseTerm {
    pub(super) fn new(pose: KeyPose, frames: usize) -> PoseTerm {
        PoseTerm {
            frame: frame_at(pose.seconds(), frames),
            pose,
        }
    }
}

impl ReachTerm {
    pub(super) fn new(reach: Reach, frames: usize) -> ReachTerm {
        ReachTerm {
            frame: frame_at(reach.seconds(), frames),
            reach,
        }
    }
}

impl LossTerm for PathTerm {
    fn name(&self) -> String {
        "path".into()
    }

    fn value_name(&self, value: usize) -> String {
        format!("{} of the pelvis", ["x", "z"][value])
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        along_ground(position(&joints, Joint::Pelvis))
    }

    fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        let (values, weights) = { self.places.iter() }
            .map(|place| match place {
                Some(place) => (*place, 1.0 / PATH_TOLERANCE),
                None => ([0.0; 2], 0.0),
            })
            .unzip();
        by_frame(values, weights, &baseline)
    }
}

impl LossTerm for FacingTerm {
    fn name(&self) -> String {
        "facing".into()
    }

    fn value_name(&self, value: usize) -> String {
        format!("{} of the direction that the body faces", ["x", "z"][value])
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        Tensor::cat(forward(&joints).to_vec(), 2)
    }

    fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        let Directions { angles, weights } = &self.0;
        let values = angles
            .iter()
            .map(|angle| [angle.sin() as f32, angle.cos() as f32]);
        let weights = weights
            .iter()
            .map(|weight| *weight as f32 / FACING_TOLERANCE);
        by_frame(values.collect(), weights.collect(), &baseline)
    }
}

impl LossTerm for PoseTerm {
    fn name(&self) -> String {
        format!("pose at {} s", self.pose.seconds())
    }

    fn value_name(&self, value: usize) -> String {
        let joint = Joint::ALL[value / 3].name();
        format!(
            "{} of the {joint} in the {}",
            ["x", "y", "z"][value % 3],
            self.name()
        )
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        let [batch, frames, ..] = joints.dims();
        let [forward_x, forward_z] = forward(&joints).map(|part| part.unsqueeze_dim::<4>(3));
        let axis = |axis| joints.clone().narrow(3, axis, 1);
        let from_pelvis = |from| axis(from) - axis(from).narrow(2, Joint::Pelvis.index(), 1);
        let (x, z) = (from_pelvis(0), from_pelvis(2));
        let left = x.clone() * forward_z.clone() - z.clone() * forward_x.clone();
        let ahead = x * forward_x + z * forward_z;
        Tensor::cat(vec![left, axis(1), ahead], 3).reshape([batch, frames, 3 * JOINTS])
    }

    fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        let [_, frames, _] = baseline.dims();
        let joints = self.pose.joints().as_flattened();
        LossTarget::constant(joints, 1.0 / POSE_TOLERANCE, &baseline.device())
            .at_frame(self.frame, frames)
    }
}

impl LossTerm for ReachTerm {
    fn name(&self) -> String {
        format!("{} at {} s", self.reach.part().name(), self.reach.seconds())
    }

    fn value_name(&self, value: usize) -> String {
        format!("{} of the {}", ["x", "y", "z"][value], self.name())
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        position(&joints, self.reach.part().joint())
    }

    fn target(&self, baseline: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        let [_, frames, _] = baseline.dims();
        let position = self.reach.position();
        LossTarget::constant(&position, 1.0 / REACH_TOLERANCE, &baseline.device())
            .at_frame(self.frame, frames)
    }
}

/// Returns x and z of the direction in which the body faces, a unit vector; each is `[batch, frames, 1]`.
fn forward(joints: &Tensor<4>) -> [Tensor<3>; 2] {
    let at = |joint| position(joints, joint);
    let across = at(Joint::LeftHip) - at(Joint::RightHip) + at(Joint::LeftShoulder)
        - at(Joint::RightShoulder);
    // Forward is a quarter turn to the right of the direction from right to left.
    let (x, z) = (-across.clone().narrow(2, 2, 1), across.narrow(2, 0, 1));
    // The small number keeps the gradient of the root finite.
    let length = (x.clone().square() + z.clone().square() + 1e-6).sqrt();
    [x, z].map(|part| part / length.clone())
}

/// Returns the positions of a joint, `[batch, frames, 3]`.
fn position(joints: &Tensor<4>, joint: Joint) -> Tensor<3> {
    joints.clone().narrow(2, joint.index(), 1).squeeze_dim(2)
}

/// Returns x and z of positions, `[batch, frames, 2]`.
fn along_ground(positions: Tensor<3>) -> Tensor<3> {
    let axis = |axis| positions.clone().narrow(2, axis, 1);
    Tensor::cat(vec![axis(0), axis(2)], 2)
}

/// Makes the target of two values with a weight at each frame. Frames past those given have the weight 0.
fn by_frame(mut values: Vec<[f32; 2]>, mut weights: Vec<f32>, baseline: &Tensor<3>) -> LossTarget {
    let [_, frames, _] = baseline.dims();
    let device: Device = baseline.device();
    values.resize(frames, [0.0; 2]);
    weights.resize(frames, 0.0);
    let values = TensorData::new(values.into_flattened(), [1, frames, 2]);
    LossTarget {
        values: Tensor::from_data(values, &device),
        weight: Tensor::from_data(TensorData::new(weights, [1, frames, 1]), &device),
    }
}
