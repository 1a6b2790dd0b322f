//! Forward kinematics of batches of motions.

use burn::tensor::{Device, Int, Tensor, TensorData};
use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint, RestPose};
use rayon::prelude::*;

use crate::pose::{BoneOffsets, PARENTS, Pose, quaternion_gradient};

/// Added to the squared length of a quaternion, so that padding, whose quaternions may be 0, gives finite numbers.
const LENGTH_EPSILON: f32 = 1e-24;

/// Forward kinematics of a body: computes joint positions from root positions and local rotations.
///
/// Rotations are those of [`Rotations`](lamogen_motion::Rotations): quaternions `[x, y, z, w]` indexed by
/// [`Joint::index`], each in the frame of its parent, the pelvis in the world. They may have any length but 0.
/// Every frame is computed by itself, so that a padded frame does not affect any other frame.
#[derive(Clone, Debug)]
pub struct Kinematics {
    offsets: BoneOffsets,
}

/// Joint positions, together with what is needed to pull a gradient back to root and rotations.
#[derive(Debug)]
pub struct LinearizedKinematics {
    /// Joint positions `[batch, frames, 22, 3]` in metres; not tracked by autodiff.
    pub joints: Tensor<4>,
    poses: Vec<Pose>,
    /// The lengths of the quaternions that were given.
    lengths: Vec<[f64; JOINTS]>,
    local: Vec<[DQuat; JOINTS]>,
}

impl Kinematics {
    /// Makes the forward kinematics of a body.
    pub fn new(rest: &RestPose) -> Self {
        Kinematics {
            offsets: BoneOffsets::of(rest),
        }
    }

    /// Computes joint positions; differentiable, on any device.
    ///
    /// # Shapes
    ///
    /// - `root`: `[batch, frames, 3]`, the position of the pelvis in metres
    /// - `rotations`: `[batch, frames, 22, 4]`
    /// - output: `[batch, frames, 22, 3]` in metres
    ///
    /// # Panics
    ///
    /// If a shape is another.
    pub fn joints(&self, root: Tensor<3>, rotations: Tensor<4>) -> Tensor<4> {
        let [batch, frames, axes] = root.dims();
        assert_eq!(axes, 3, "expected a root of 3 coordinates, found {axes}");
        assert_eq!(rotations.dims(), [batch, frames, JOINTS, 4]);
        let device = root.device();
        let length = rotations.clone().square().sum_dim(3) + LENGTH_EPSILON;
        let local = rotations / length.sqrt();
        let mut positions = root.reshape([batch, frames, 1, 3]);
        let mut global = local.clone().narrow(2, Joint::Pelvis.index(), 1);
        // The joints placed so far, in their order in `positions` and `global`. Each round of the loop places all joints
        // whose parents are placed, so that there is one operation for each level of the skeleton.
        let mut placed = vec![Joint::Pelvis.index()];
        while placed.len() < JOINTS {
            let level: Vec<usize> = (1..JOINTS)
                .filter(|joint| !placed.contains(joint) && placed.contains(&PARENTS[*joint]))
                .collect();
            let index_of = |joint: usize| placed.iter().position(|&other| other == joint);
            let parents: Vec<usize> = { level.iter() }
                .map(|&joint| index_of(PARENTS[joint]).expect("parents are placed"))
                .collect();
            let parents = indices(&parents, &device);
            let parent_global = global.clone().select(2, parents.clone());
            let offsets: Vec<f32> = { level.iter() }
                .flat_map(|&joint| self.offsets.0[joint].as_vec3().to_array())
                .collect();
            let offsets = TensorData::new(offsets, [1, 1, level.len(), 3]);
            let offsets = Tensor::<4>::from_data(offsets, &device);
            let parent_positions = positions.clone().select(2, parents);
            let local = local.clone().select(2, indices(&level, &device));
            positions = Tensor::cat(
                vec![
                    positions,
                    parent_positions + rotate(&parent_global, &offsets),
                ],
                2,
            );
            global = Tensor::cat(vec![global, product(&parent_global, &local)], 2);
            placed.extend(level);
        }
        let mut order = [0; JOINTS];
        for (index, joint) in placed.into_iter().enumerate() {
            order[joint] = index;
        }
        positions.select(2, indices(&order, &device))
    }

    /// Computes joint positions whose gradient is derived by hand. The result agrees with [`joints`](Self::joints) and
    /// autodiff, and is several times as fast on a CPU. It is computed on the host, on all cores, in 64 bits.
    ///
    /// # Shapes
    ///
    /// As [`joints`](Self::joints).
    ///
    /// # Panics
    ///
    /// If a shape is another.
    pub fn linearize(&self, root: Tensor<3>, rotations: Tensor<4>) -> LinearizedKinematics {
        let [batch, frames, axes] = root.dims();
        assert_eq!(axes, 3, "expected a root of 3 coordinates, found {axes}");
        assert_eq!(rotations.dims(), [batch, frames, JOINTS, 4]);
        let device = root.device();
        let root: Vec<f32> = root.try_into_vec_as().expect("floats convert to f32");
        let rotations: Vec<f32> = rotations.try_into_vec_as().expect("floats convert to f32");
        let (roots, _) = root.as_chunks::<3>();
        let (quaternions, _) = rotations.as_chunks::<4>();
        let (quaternions, _) = quaternions.as_chunks::<JOINTS>();
        let placed = roots
            .par_iter()
            .zip(quaternions)
            .map(|(root, quaternions)| {
                let given = quaternions.map(|q| DQuat::from_array(q.map(f64::from)));
                let lengths =
                    given.map(|q| (q.length_squared() + f64::from(LENGTH_EPSILON)).sqrt());
                let local = std::array::from_fn(|joint| given[joint] / lengths[joint]);
                let pose = Pose::of(&self.offsets, DVec3::from(root.map(f64::from)), &local);
                (pose, lengths, local)
            });
        let placed: Vec<(Pose, [f64; JOINTS], [DQuat; JOINTS])> = placed.collect();
        let joints = placed.iter().flat_map(|(pose, ..)| pose.positions);
        let joints = joints.flat_map(|point| point.as_vec3().to_array());
        let joints = TensorData::new(joints.collect::<Vec<f32>>(), [batch, frames, JOINTS, 3]);
        let mut linearized = LinearizedKinematics {
            joints: Tensor::from_data(joints, &device),
            poses: Vec::with_capacity(placed.len()),
            lengths: Vec::with_capacity(placed.len()),
            local: Vec::with_capacity(placed.len()),
        };
        for (pose, lengths, local) in placed {
            linearized.poses.push(pose);
            linearized.lengths.push(lengths);
            linearized.local.push(local);
        }
        linearized
    }
}

impl LinearizedKinematics {
    /// Pulls a gradient back: computes the gradient with respect to root and rotations from one with respect to the joint
    /// positions.
    ///
    /// # Shapes
    ///
    /// - `gradient`: `[batch, frames, 22, 3]`
    /// - output: `[batch, frames, 3]` and `[batch, frames, 22, 4]`
    ///
    /// # Panics
    ///
    /// If `gradient` has another shape.
    pub fn pull(&self, gradient: Tensor<4>) -> (Tensor<3>, Tensor<4>) {
        let shape @ [batch, frames, ..] = self.joints.dims();
        assert_eq!(gradient.dims(), shape);
        let device = gradient.device();
        let gradient: Vec<f32> = gradient.try_into_vec_as().expect("floats convert to f32");
        let (gradients, _) = gradient.as_chunks::<3>();
        let (gradients, _) = gradients.as_chunks::<JOINTS>();
        let pulled = gradients.par_iter().enumerate().map(|(index, gradient)| {
            let gradient = gradient.map(|g| DVec3::from(g.map(f64::from)));
            let (root, turns) = self.poses[index].pull_back(&gradient);
            let rotations: [[f32; 4]; JOINTS] = std::array::from_fn(|joint| {
                let q = self.local[index][joint];
                quaternion_gradient(q, turns[joint])
                    .map(|g| (g / self.lengths[index][joint]) as f32)
            });
            (root.as_vec3().to_array(), rotations)
        });
        let (roots, rotations): (Vec<[f32; 3]>, Vec<[[f32; 4]; JOINTS]>) = pulled.unzip();
        let roots = TensorData::new(roots.into_flattened(), [batch, frames, 3]);
        let rotations = rotations.into_flattened().into_flattened();
        let rotations = TensorData::new(rotations, [batch, frames, JOINTS, 4]);
        (
            Tensor::from_data(roots, &device),
            Tensor::from_data(rotations, &device),
        )
    }
}

/// Copies indices to a device.
fn indices(values: &[usize], device: &Device) -> Tensor<1, Int> {
    let values: Vec<i32> = values.iter().map(|&value| value as i32).collect();
    Tensor::from_data(values.as_slice(), device)
}

/// Computes the products `a b` of quaternions `[…, 4]`.
fn product(a: &Tensor<4>, b: &Tensor<4>) -> Tensor<4> {
    let component = |q: &Tensor<4>, index: usize| q.clone().narrow(3, index, 1);
    let [ax, ay, az, aw] = [0, 1, 2, 3].map(|index| component(a, index));
    let [bx, by, bz, bw] = [0, 1, 2, 3].map(|index| component(b, index));
    let times = |a: &Tensor<4>, b: &Tensor<4>| a.clone() * b.clone();
    Tensor::cat(
        vec![
            times(&aw, &bx) + times(&ax, &bw) + times(&ay, &bz) - times(&az, &by),
            times(&aw, &by) - times(&ax, &bz) + times(&ay, &bw) + times(&az, &bx),
            times(&aw, &bz) + times(&ax, &by) - times(&ay, &bx) + times(&az, &bw),
            times(&aw, &bw) - times(&ax, &bx) - times(&ay, &by) - times(&az, &bz),
        ],
        3,
    )
}

/// Rotates vectors `[…, 3]` by quaternions `[…, 4]` of length 1: `v + 2 u × (u × v + w v)`, where `u` is the vector part
/// of the quaternion and `w` its scalar part.
fn rotate(q: &Tensor<4>, v: &Tensor<4>) -> Tensor<4> {
    let (u, w) = (q.clone().narrow(3, 0, 3), q.clone().narrow(3, 3, 1));
    let inner = cross(&u, v) + w * v.clone();
    v.clone() + cross(&u, &inner) * 2.0
}

/// Computes the cross products of vectors `[…, 3]`; the other dimensions of either tensor may be 1.
fn cross(a: &Tensor<4>, b: &Tensor<4>) -> Tensor<4> {
    let component = |v: &Tensor<4>, index: usize| v.clone().narrow(3, index, 1);
    let [ax, ay, az] = [0, 1, 2].map(|index| component(a, index));
    let [bx, by, bz] = [0, 1, 2].map(|index| component(b, index));
    let times = |a: &Tensor<4>, b: &Tensor<4>| a.clone() * b.clone();
    Tensor::cat(
        vec![
            times(&ay, &bz) - times(&az, &by),
            times(&az, &bx) - times(&ax, &bz),
            times(&ax, &by) - times(&ay, &bx),
        ],
        3,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 7;

    fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> Tensor<D> {
        Tensor::from_data(TensorData::new(values, shape), &Device::flex())
    }

    /// Returns roots and rotations of two motions in which all joints turn. The lengths of the quaternions are not 1.
    fn motions() -> (Tensor<3>, Tensor<4>) {
        let wave = |i: usize| (i as f32 * 0.7).sin() + 0.2 * (i as f32 * 1.9).cos();
        let root = (0..2 * FRAMES * 3).map(wave).collect();
        let rotations = (0..2 * FRAMES * JOINTS * 4).map(wave).collect();
        (
            tensor(root, [2, FRAMES, 3]),
            tensor(rotations, [2, FRAMES, JOINTS, 4]),
        )
    }

    fn largest<const D: usize>(tensor: Tensor<D>) -> f32 {
        tensor.abs().max().into_scalar()
    }

    #[test]
    fn without_rotations_the_body_stands_in_its_rest_pose() {
        let rest = RestPose::humanml3d();
        let identity = [0.0, 0.0, 0.0, 2.0].repeat(JOINTS);
        let joints = Kinematics::new(&rest).joints(
            tensor(vec![0.5, 1.0, -2.0], [1, 1, 3]),
            tensor(identity, [1, 1, JOINTS, 4]),
        );
        let joints: Vec<f32> = joints.try_into_vec_as().unwrap();
        let (joints, _) = joints.as_chunks::<3>();
        assert_eq!(joints[0], [0.5, 1.0, -2.0]);
        for joint in Joint::ALL {
            let Some(parent) = joint.parent() else {
                continue;
            };
            let ends = joints[joint.index()].iter().zip(joints[parent.index()]);
            for ((end, start), offset) in ends.zip(rest.offset(joint)) {
                assert!((end - start - offset).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn tensors_and_kernels_place_the_same_joints() {
        let kinematics = Kinematics::new(&RestPose::humanml3d());
        let (root, rotations) = motions();
        let tensors = kinematics.joints(root.clone(), rotations.clone());
        let kernels = kinematics.linearize(root, rotations);
        assert!(largest(tensors - kernels.joints) < 2e-6);
    }

    #[test]
    fn the_way_back_by_hand_is_that_of_autodiff() {
        let kinematics = Kinematics::new(&RestPose::humanml3d());
        let (root, rotations) = motions();
        let weights = (0..2 * FRAMES * JOINTS * 3).map(|i| (i as f32 * 0.37).cos());
        let weights = tensor(weights.collect(), [2, FRAMES, JOINTS, 3]);
        let (root_gradient, rotation_gradient) =
            { kinematics.linearize(root.clone(), rotations.clone()) }.pull(weights.clone());

        let [root, rotations] =
            [root.reshape([2, FRAMES, 1, 3]), rotations].map(|leaf| leaf.autodiff().require_grad());
        let joints = kinematics.joints(root.clone().reshape([2, FRAMES, 3]), rotations.clone());
        let gradients = (joints * weights.autodiff()).sum().backward();
        let error = root_gradient - root.grad(&gradients).unwrap().reshape([2, FRAMES, 3]);
        assert!(largest(error) < 1e-5);
        let expected = rotations.grad(&gradients).unwrap();
        assert!(largest(rotation_gradient - expected.clone()) < 1e-5 * largest(expected));
    }

    #[test]
    fn the_gradient_agrees_with_finite_differences() {
        let kinematics = Kinematics::new(&RestPose::humanml3d());
        let (root, rotations) = motions();
        let weights: Vec<f32> = (0..2 * FRAMES * JOINTS * 3)
            .map(|i| (i as f32 * 0.37).cos())
            .collect();
        let shape = [2, FRAMES, JOINTS, 3];
        let (_, gradient) = { kinematics.linearize(root.clone(), rotations.clone()) }
            .pull(tensor(weights.clone(), shape));
        let gradient: Vec<f32> = gradient.try_into_vec_as().unwrap();
        let values: Vec<f32> = rotations.try_into_vec_as().unwrap();
        let loss = |values: &[f32]| -> f64 {
            let rotations = tensor(values.to_vec(), [2, FRAMES, JOINTS, 4]);
            let joints = kinematics.linearize(root.clone(), rotations).joints;
            let joints: Vec<f32> = joints.try_into_vec_as().unwrap();
            let pairs = joints.iter().zip(&weights);
            pairs.map(|(x, w)| f64::from(*x) * f64::from(*w)).sum()
        };
        // The cases are the pelvis, a hip, the upper spine, an elbow, and a wrist, whose rotation moves no joint.
        for (frame, joint, part) in [(0, 0, 0), (3, 1, 2), (6, 9, 3), (9, 18, 1), (13, 20, 0)] {
            let index = (frame * JOINTS + joint) * 4 + part;
            let at = |offset: f32| {
                let mut moved = values.clone();
                moved[index] += offset;
                loss(&moved)
            };
            let step = 1e-3;
            let numeric = (at(step) - at(-step)) / (2.0 * f64::from(step));
            let error = (numeric - f64::from(gradient[index])).abs();
            assert!(error < 2e-3 * numeric.abs().max(1.0), "{joint}: {numeric}");
        }
    }

    #[test]
    fn padding_of_zeros_stays_finite() {
        let kinematics = Kinematics::new(&RestPose::humanml3d());
        let zeros = Tensor::<4>::zeros([1, 2, JOINTS, 4], &Device::flex());
        let root = Tensor::<3>::zeros([1, 2, 3], &Device::flex());
        let leaf = zeros.clone().autodiff().require_grad();
        let joints = kinematics.joints(root.clone(), leaf.clone());
        let gradient = leaf.grad(&joints.clone().sum().backward()).unwrap();
        for values in [joints.inner(), gradient] {
            assert!(largest(values).is_finite());
        }
        let linearized = kinematics.linearize(root, zeros);
        let ones = linearized.joints.ones_like();
        assert!(largest(linearized.pull(ones).1).is_finite());
    }
}
