//! What a network is trained to make small.

use burn::tensor::Tensor;
use lamogen_model::{FrameMask, Prediction};
use lamogen_motion::{FOOT_CONTACT_JOINTS, FeatureGroup, JOINTS, Normalization, joints};
use serde::{Deserialize, Serialize};

/// Weights of the losses. The squared error of what the network predicts counts 1; the others are
/// about the clean motion that the prediction speaks of, and 0 turns them off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossWeights {
    /// Squared error of the change from frame to frame, of normalised features: what a motion that jumps between poses, each
    /// right in itself, has much of.
    pub change: f64,
    /// Squared error of joint positions in metres (MDM, Tevet et al. 2022, equation 3).
    pub position: f64,
    /// Squared error of joint velocities in metres per frame (there, equation 5).
    pub velocity: f64,
    /// Squared velocity in metres per frame of feet that stand on the ground (there, equation 4).
    pub foot_contact: f64,
    /// Squared error of the root's features (how fast it turns, moves and how high it is), normalised. They are 4 of 263, and where a body
    /// goes and how far it turns is the sum of all of theirs: a bias that the prediction's loss hardly sees turns a walk by many degrees.
    #[serde(skip_serializing_if = "is_zero")]
    pub root: f64,
}

// serde hands a reference.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_zero(weight: &f64) -> bool {
    *weight == 0.0
}

impl LossWeights {
    /// Which of them is no weight.
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

/// Features of the root, the first ones of a frame.
const ROOT: usize = FeatureGroup::RootHeight.range().end;

/// Noisy motions and what the network should make of them. Nothing of it is tracked.
#[derive(Clone, Debug)]
pub(crate) struct Truth {
    /// Clean motions, normalised, `[batch, frames, features]`.
    pub(crate) clean: Tensor<3>,
    /// The noise in `noisy`.
    pub(crate) noise: Tensor<3>,
    /// What the network sees.
    pub(crate) noisy: Tensor<3>,
    /// `ᾱ` of each motion's timestep, `[batch, 1, 1]`.
    pub(crate) alpha_cumprod: Tensor<3>,
    pub(crate) mask: FrameMask,
}

/// The parts of a loss, each one number; those that are turned off are left out.
pub(crate) struct Parts {
    /// What is made small.
    pub(crate) total: Tensor<1>,
    /// Squared error of what the network predicts, in its own terms.
    pub(crate) prediction: Tensor<1>,
}

impl LossWeights {
    /// The losses of a network's output `[batch, frames, features]`.
    pub(crate) fn of(
        &self,
        output: Tensor<3>,
        truth: &Truth,
        prediction: Prediction,
        normalization: &Normalization,
    ) -> Parts {
        let lengths = truth.mask.lengths();
        let frames: usize = lengths.iter().sum();
        let steps = frames - lengths.len();
        let keep = truth.mask.keep();
        // Sums over frames that count, divided by how many numbers were summed up.
        let mean = |squares: Tensor<3>, frames: usize, width: usize, keep: &Option<Tensor<3>>| {
            let squares = match keep {
                Some(keep) => squares * keep.clone(),
                None => squares,
            };
            // In parts: a sum of millions of numbers at once runs in another order each time.
            squares.sum_dim(2).sum_dim(1).sum() / (frames * width) as f64
        };
        let [_, count, features] = output.dims();
        let error = output.clone() - truth.target(prediction);
        let squared = mean(error.square(), frames, features, &keep);
        let mut total = squared.clone();
        if *self == LossWeights::default() || count < 2 {
            return Parts {
                prediction: squared,
                total,
            };
        }
        // A change leads to a frame that counts.
        let changes = keep
            .as_ref()
            .map(|keep| keep.clone().narrow(1, 1, count - 1));
        let change = |x: Tensor<3>| x.clone().narrow(1, 1, count - 1) - x.narrow(1, 0, count - 1);
        let clean = truth.clean_of(output, prediction);
        // Where little of the clean motion is left, an error of the noise is an error of the clean motion many times as large.
        let weight = |x: Tensor<3>| match prediction {
            Prediction::Sample | Prediction::V => x,
            Prediction::Epsilon => x * truth.alpha_cumprod.clone(),
        };
        if self.root > 0.0 {
            let error = (clean.clone() - truth.clean.clone()).square();
            let error = error.narrow(2, 0, ROOT);
            total = total + mean(weight(error), frames, ROOT, &keep) * self.root;
        }
        if self.change > 0.0 {
            let error = change(clean.clone()) - change(truth.clean.clone());
            let squared = mean(weight(error.square()), steps, features, &changes);
            total = total + squared * self.change;
        }
        if self.position > 0.0 || self.velocity > 0.0 || self.foot_contact > 0.0 {
            let [batch, _, _] = clean.dims();
            let flat = |clean: Tensor<3>| {
                let joints = joints(normalization.denormalize(clean));
                joints.reshape([batch, count, 3 * JOINTS])
            };
            let (found, expected) = (flat(clean), flat(truth.clean.clone()));
            if self.position > 0.0 {
                let error = (found.clone() - expected.clone()).square();
                total = total + mean(weight(error), frames, JOINTS, &keep) * self.position;
            }
            let moved = change(found);
            if self.velocity > 0.0 {
                let error = (moved.clone() - change(expected)).square();
                total = total + mean(weight(error), steps, JOINTS, &changes) * self.velocity;
            }
            if self.foot_contact > 0.0 {
                let range = FeatureGroup::FootContact.range();
                let contacts = normalization.denormalize(truth.clean.clone());
                let contacts = contacts
                    .narrow(2, range.start, range.len())
                    .narrow(1, 0, count - 1);
                let feet = FOOT_CONTACT_JOINTS.map(|joint| {
                    let foot = moved.clone().narrow(2, 3 * joint as usize, 3);
                    foot.square().sum_dim(2)
                });
                let sliding = Tensor::cat(feet.to_vec(), 2) * contacts;
                let squared = mean(weight(sliding), steps, range.len(), &changes);
                total = total + squared * self.foot_contact;
            }
        }
        Parts {
            prediction: squared,
            total,
        }
    }
}

impl Truth {
    /// Noise added to clean motions: `√ᾱ · clean + √(1 - ᾱ) · noise`.
    pub(crate) fn new(
        clean: Tensor<3>,
        noise: Tensor<3>,
        alpha_cumprod: Tensor<3>,
        mask: FrameMask,
    ) -> Self {
        let rest: Tensor<3> = 1.0 - alpha_cumprod.clone();
        Truth {
            noisy: clean.clone() * alpha_cumprod.clone().sqrt() + noise.clone() * rest.sqrt(),
            clean,
            noise,
            alpha_cumprod,
            mask,
        }
    }

    /// The same noisy motions, with other clean ones behind them.
    pub(crate) fn with_clean(self, clean: Tensor<3>) -> Self {
        let (signal, rest) = self.shares();
        Truth {
            noise: (self.noisy.clone() - clean.clone() * signal) / rest,
            clean,
            ..self
        }
    }

    /// What the network should return.
    pub(crate) fn target(&self, prediction: Prediction) -> Tensor<3> {
        match prediction {
            Prediction::Sample => self.clean.clone(),
            Prediction::Epsilon => self.noise.clone(),
            Prediction::V => {
                let (signal, rest) = self.shares();
                self.noise.clone() * signal - self.clean.clone() * rest
            }
        }
    }

    /// The clean motion that an output speaks of.
    pub(crate) fn clean_of(&self, output: Tensor<3>, prediction: Prediction) -> Tensor<3> {
        let (signal, rest) = self.shares();
        match prediction {
            Prediction::Sample => output,
            Prediction::Epsilon => (self.noisy.clone() - output * rest) / signal,
            Prediction::V => self.noisy.clone() * signal - output * rest,
        }
    }

    /// `√ᾱ` and `√(1 - ᾱ)`.
    fn shares(&self) -> (Tensor<3>, Tensor<3>) {
        let rest: Tensor<3> = 1.0 - self.alpha_cumprod.clone();
        (self.alpha_cumprod.clone().sqrt(), rest.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use lamogen_motion::POSE_FEATURES;

    use super::*;

    #[test]
    fn the_root_counts_as_much_as_it_is_told() {
        let device = Device::flex();
        let (frames, lengths) = (5, [5, 3]);
        let numbers = |value: &dyn Fn(usize) -> f32| {
            let values: Vec<f32> = (0..2 * frames * POSE_FEATURES).map(value).collect();
            Tensor::<3>::from_data(TensorData::new(values, [2, frames, POSE_FEATURES]), &device)
        };
        let clean = numbers(&|i| (i as f32 * 0.37).sin());
        let alphas = Tensor::<3>::from_data(TensorData::new(vec![0.5f32; 2], [2, 1, 1]), &device);
        let mask = FrameMask::new(&lengths, frames, &device);
        let truth = Truth::new(clean.clone(), clean.zeros_like(), alphas, mask);
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
            let parts = losses.of(output, &truth, Prediction::Sample, &normalization);
            parts.total.into_scalar::<f32>()
        };
        let prediction = 5.0 / POSE_FEATURES as f32;
        assert!((total(0.0) - prediction).abs() < 1e-6);
        // Of four features one is off by 2.
        assert!((total(3.0) - prediction - 3.0 * 4.0 / 4.0).abs() < 1e-5);
    }
}
