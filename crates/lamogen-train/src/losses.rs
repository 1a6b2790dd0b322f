//! The losses of a denoiser's training.

use burn::tensor::Tensor;
use lamogen_model::{FrameMask, Prediction};
use lamogen_motion::{FOOT_CONTACT_JOINTS, FeatureGroup, JOINTS, Normalization, joints};
use serde::{Deserialize, Serialize};

/// The weights of the losses. The squared error of the network's prediction has the weight 1. The other losses measure the clean
/// motion that follows from the prediction; a weight of 0 turns them off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossWeights {
    /// The squared error of the change of normalised features from frame to frame. It is large for a motion that jumps between
    /// poses that are each correct.
    pub change: f64,
    /// The squared error of joint positions in metres (MDM, Tevet et al. 2022, equation 3).
    pub position: f64,
    /// The squared error of joint velocities in metres per frame (MDM, equation 5).
    pub velocity: f64,
    /// The squared velocity in metres per frame of feet that stand on the ground (MDM, equation 4).
    pub foot_contact: f64,
    /// The squared error of the normalised features of the root: how fast it turns and moves, and its height. These are 4 of 263
    /// features, but the path and the heading of the body are their sums over all frames: a bias too small to matter in the
    /// prediction's loss turns a walk by many degrees.
    #[serde(skip_serializing_if = "is_zero")]
    pub root: f64,
}

// serde passes a reference.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_zero(weight: &f64) -> bool {
    *weight == 0.0
}

impl LossWeights {
    /// Describes the first value that is not a weight; `None` if there is none.
    pub(crate) fn problem(&self) -> Option<String> {
        let all = [
            ("change", self.change),
            ("position", self.position),
            ("velocity", self.velocity),
            ("foot_contact", self.foot_contact),
            ("root", self.root),
        ];
        all.into_iter()
            .find(|(_, weight)| !(weight.is_finite() && *weight >= 0.0))
            .map(|(name, found)| {
                format!("denoising.losses.{name} must be 0 or above, found {found}")
            })
    }
}

/// The number of features of the root, which are the first of a frame.
const ROOT_FEATURES: usize = FeatureGroup::RootHeight.range().end;

/// Noisy motions, with the clean motions and the noise in them, from which the network's targets follow. Autodiff tracks none of
/// these tensors.
#[derive(Clone, Debug)]
pub(crate) struct NoisyMotions {
    /// The clean motions, normalised, `[batch, frames, features]`.
    pub(crate) clean: Tensor<3>,
    /// The noise in `noisy`.
    pub(crate) noise: Tensor<3>,
    /// The noisy motions, which the network sees.
    pub(crate) noisy: Tensor<3>,
    /// `ᾱ` of each motion's timestep, `[batch, 1, 1]`.
    pub(crate) alpha_cumprod: Tensor<3>,
    /// Which frames are not padding.
    pub(crate) mask: FrameMask,
}

/// The values of the losses, each one number.
pub(crate) struct LossValues {
    /// The weighted sum of all losses, which training minimises. Losses that are turned off are left out.
    pub(crate) total: Tensor<1>,
    /// The squared error of the network's prediction itself: clean motion, noise or `v`.
    pub(crate) prediction: Tensor<1>,
}

impl LossWeights {
    /// Computes the losses of a network's output `[batch, frames, features]`.
    pub(crate) fn evaluate(
        &self,
        output: Tensor<3>,
        motions: &NoisyMotions,
        prediction: Prediction,
        normalization: &Normalization,
    ) -> LossValues {
        let lengths = motions.mask.lengths();
        let frames: usize = lengths.iter().sum();
        let steps = frames - lengths.len();
        let keep = motions.mask.keep();
        // The mean over frames that are not padding, of `width` numbers each.
        let mean = |squares: Tensor<3>, frames: usize, width: usize, keep: &Option<Tensor<3>>| {
            let squares = match keep {
                Some(keep) => squares * keep.clone(),
                None => squares,
            };
            // Summed in stages: a single sum of millions of numbers adds them in a different order each time.
            squares.sum_dim(2).sum_dim(1).sum() / (frames * width) as f64
        };
        let [_, count, features] = output.dims();
        let error = output.clone() - motions.target(prediction);
        let squared = mean(error.square(), frames, features, &keep);
        let mut total = squared.clone();
        if *self == LossWeights::default() || count < 2 {
            return LossValues {
                prediction: squared,
                total,
            };
        }
        // A change counts if the frame that it leads to is not padding.
        let changes = keep
            .as_ref()
            .map(|keep| keep.clone().narrow(1, 1, count - 1));
        let change = |x: Tensor<3>| x.clone().narrow(1, 1, count - 1) - x.narrow(1, 0, count - 1);
        let clean = motions.predicted_clean(output, prediction);
        // At timesteps with little signal, an error of the predicted noise causes an error of the clean motion many times as large.
        let weight = |x: Tensor<3>| match prediction {
            Prediction::Sample | Prediction::V => x,
            Prediction::Epsilon => x * motions.alpha_cumprod.clone(),
        };
        if self.root > 0.0 {
            let error = (clean.clone() - motions.clean.clone()).square();
            let error = error.narrow(2, 0, ROOT_FEATURES);
            total = total + mean(weight(error), frames, ROOT_FEATURES, &keep) * self.root;
        }
        if self.change > 0.0 {
            let error = change(clean.clone()) - change(motions.clean.clone());
            let squared = mean(weight(error.square()), steps, features, &changes);
            total = total + squared * self.change;
        }
        if self.position > 0.0 || self.velocity > 0.0 || self.foot_contact > 0.0 {
            let [batch, _, _] = clean.dims();
            let positions = |clean: Tensor<3>| {
                let joints = joints(normalization.denormalize(clean));
                joints.reshape([batch, count, 3 * JOINTS])
            };
            let (found, expected) = (positions(clean), positions(motions.clean.clone()));
            if self.position > 0.0 {
                let error = (found.clone() - expected.clone()).square();
                total = total + mean(weight(error), frames, JOINTS, &keep) * self.position;
            }
            let velocity = change(found);
            if self.velocity > 0.0 {
                let error = (velocity.clone() - change(expected)).square();
                total = total + mean(weight(error), steps, JOINTS, &changes) * self.velocity;
            }
            if self.foot_contact > 0.0 {
                let range = FeatureGroup::FootContact.range();
                let contacts = normalization.denormalize(motions.clean.clone());
                let contacts = contacts
                    .narrow(2, range.start, range.len())
                    .narrow(1, 0, count - 1);
                let feet = FOOT_CONTACT_JOINTS.map(|joint| {
                    let foot = velocity.clone().narrow(2, 3 * joint as usize, 3);
                    foot.square().sum_dim(2)
                });
                let sliding = Tensor::cat(feet.to_vec(), 2) * contacts;
                let squared = mean(weight(sliding), steps, range.len(), &changes);
                total = total + squared * self.foot_contact;
            }
        }
        LossValues {
            prediction: squared,
            total,
        }
    }
}

impl NoisyMotions {
    /// Adds noise to clean motions: `√ᾱ · clean + √(1 - ᾱ) · noise`.
    pub(crate) fn new(
        clean: Tensor<3>,
        noise: Tensor<3>,
        alpha_cumprod: Tensor<3>,
        mask: FrameMask,
    ) -> Self {
        let rest: Tensor<3> = 1.0 - alpha_cumprod.clone();
        NoisyMotions {
            noisy: clean.clone() * alpha_cumprod.clone().sqrt() + noise.clone() * rest.sqrt(),
            clean,
            noise,
            alpha_cumprod,
            mask,
        }
    }

    /// Replaces the clean motions and keeps the noisy ones: the noise becomes the difference of the two.
    pub(crate) fn with_clean(self, clean: Tensor<3>) -> Self {
        let (signal, noise) = self.factors();
        NoisyMotions {
            noise: (self.noisy.clone() - clean.clone() * signal) / noise,
            clean,
            ..self
        }
    }

    /// Returns the output that the network should have.
    pub(crate) fn target(&self, prediction: Prediction) -> Tensor<3> {
        match prediction {
            Prediction::Sample => self.clean.clone(),
            Prediction::Epsilon => self.noise.clone(),
            Prediction::V => {
                let (signal, noise) = self.factors();
                self.noise.clone() * signal - self.clean.clone() * noise
            }
        }
    }

    /// Computes the clean motions that follow from a network's output.
    pub(crate) fn predicted_clean(&self, output: Tensor<3>, prediction: Prediction) -> Tensor<3> {
        let (signal, noise) = self.factors();
        match prediction {
            Prediction::Sample => output,
            Prediction::Epsilon => (self.noisy.clone() - output * noise) / signal,
            Prediction::V => self.noisy.clone() * signal - output * noise,
        }
    }

    /// Returns the factors of the clean motion and of the noise: `√ᾱ` and `√(1 - ᾱ)`.
    fn factors(&self) -> (Tensor<3>, Tensor<3>) {
        let noise: Tensor<3> = 1.0 - self.alpha_cumprod.clone();
        (self.alpha_cumprod.clone().sqrt(), noise.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use lamogen_motion::POSE_FEATURES;

    use super::*;

    #[test]
    fn the_root_loss_has_its_weight() {
        let device = Device::flex();
        let (frames, lengths) = (5, [5, 3]);
        let numbers = |value: &dyn Fn(usize) -> f32| {
            let values: Vec<f32> = (0..2 * frames * POSE_FEATURES).map(value).collect();
            Tensor::<3>::from_data(TensorData::new(values, [2, frames, POSE_FEATURES]), &device)
        };
        let clean = numbers(&|i| (i as f32 * 0.37).sin());
        let alphas = Tensor::<3>::from_data(TensorData::new(vec![0.5f32; 2], [2, 1, 1]), &device);
        let mask = FrameMask::new(&lengths, frames, &device);
        let motions = NoisyMotions::new(clean.clone(), clean.zeros_like(), alphas, mask);
        // Turning is off by 2 in every frame, padded ones included, and another feature by 1.
        let off = numbers(&|i| match i % POSE_FEATURES {
            0 => 2.0,
            200 => 1.0,
            _ => 0.0,
        });
        let normalization =
            Normalization::from_slices(&[0.0; POSE_FEATURES], &[1.0; POSE_FEATURES], &device)
                .unwrap();
        let total = |root: f64| {
            let losses = LossWeights {
                root,
                ..LossWeights::default()
            };
            let output = clean.clone() + off.clone();
            let values = losses.evaluate(output, &motions, Prediction::Sample, &normalization);
            values.total.into_scalar::<f32>()
        };
        let prediction = 5.0 / POSE_FEATURES as f32;
        assert!((total(0.0) - prediction).abs() < 1e-6);
        // One of the four features of the root is off by 2.
        assert!((total(3.0) - prediction - 3.0 * 4.0 / 4.0).abs() < 1e-5);
    }
}
