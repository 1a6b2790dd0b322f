//! The guided pass.

use burn::optim::{Adam, AdamConfig, AdamState, Optimizer};
use burn::tensor::Tensor;
use lamogen_laban::{COMPONENTS, Component, LabanFeatures, ScaleCurve, Target};
use lamogen_model::Denoiser;
use lamogen_motion::joints;

use crate::error::{GuideError, Quantity};
use crate::guidance::{Guidance, Update};
use crate::observer::{Observer, Pass, Step};
use crate::sampler::{Batch, Latent, Sampler};

/// What the guided pass gives.
#[derive(Clone, Debug)]
pub struct Guided {
    /// The motions, normalised, `[batch, frames, features]`.
    pub motion: Tensor<3>,
    /// Their Laban features, `[batch, frames, 4]`.
    pub features: Tensor<3>,
    /// Laban features of the baseline, `[batch, frames, 4]`.
    pub baseline_features: Tensor<3>,
    /// Laban features to reach, `[batch, frames, 4]`.
    pub target_features: Tensor<3>,
    /// The Laban loss of each motion at every step: `[step][motion]`.
    pub loss: Vec<Vec<f32>>,
}

/// The sentence embedding on its way.
struct Optimised {
    embedding: Tensor<2>,
    adam: Adam,
    state: Option<AdamState<2>>,
}

/// An evaluation with the gradient of its loss; nothing of it on the tape.
struct Gradient {
    output: Tensor<3>,
    /// Of each motion, summed over components.
    loss: Vec<f32>,
    /// With respect to the embedding.
    embedding: Tensor<2>,
}

/// What stays the same through the pass.
struct Goal<'s, 'a, D> {
    sampler: &'s Sampler<'a, D>,
    features: LabanFeatures,
    target: Target,
}

impl<D: Denoiser> Sampler<'_, D> {
    /// Pass 2: from the same noise towards the scaled Laban features of the baseline (paper,
    /// section "Step 2: Laban-Guided Generation").
    ///
    /// `baseline` is what [`baseline`](Sampler::baseline) gave for the same batch; there is one
    /// scale for each motion.
    ///
    /// # Errors
    ///
    /// If an option makes no sense, the observer stops the run, or a loss or gradient is not
    /// finite.
    ///
    /// # Panics
    ///
    /// If noise, lengths, prompts, baseline and scales are not of as many motions, or a length is 0 or
    /// beyond the noise's frames.
    pub fn guided(
        &self,
        batch: &Batch<D::Context>,
        baseline: Tensor<3>,
        scales: &[ScaleCurve],
        guidance: &Guidance,
        observer: &mut dyn Observer,
    ) -> Result<Guided, GuideError> {
        guidance.check()?;
        let [_, frames, _] = baseline.dims();
        let features =
            LabanFeatures::new(&guidance.laban, frames, &batch.lengths, &baseline.device());
        let baseline_features = features.measure(self.joints(baseline));
        let target = Target::new(
            baseline_features.clone(),
            &batch.lengths,
            scales,
            guidance.divisor,
            guidance.emphasis,
        );
        let goal = Goal {
            sampler: self,
            features,
            target,
        };
        let (motion, loss) = goal.pursue(batch, guidance, observer)?;
        Ok(Guided {
            features: goal.features.measure(self.joints(motion.clone())),
            target_features: goal.target.features(),
            motion,
            baseline_features,
            loss,
        })
    }

    fn joints(&self, normalized: Tensor<3>) -> Tensor<4> {
        joints(self.normalization.denormalize(normalized))
    }
}

impl<D: Denoiser> Goal<'_, '_, D> {
    fn pursue(
        &self,
        batch: &Batch<D::Context>,
        guidance: &Guidance,
        observer: &mut dyn Observer,
    ) -> Result<(Tensor<3>, Vec<Vec<f32>>), GuideError> {
        let sampler = self.sampler;
        let mut latent = sampler.start(batch);
        let mut optimised = Optimised::new(batch.prompt.embedding.clone(), guidance);
        let mut trace = Vec::new();
        for (index, step) in sampler.steps().iter().enumerate() {
            let mut gradient = self.gradient(&latent, index, &optimised.embedding)?;
            for _ in 1..guidance.updates_per_step {
                optimised.update(gradient.embedding, guidance.learning_rate);
                gradient = self.gradient(&latent, index, &optimised.embedding)?;
            }
            optimised.update(gradient.embedding.clone(), guidance.learning_rate);
            let output = match guidance.update {
                Update::Lagged => gradient.output,
                Update::Immediate => sampler.evaluate(&latent, index, optimised.embedding.clone()),
            };
            let prediction = sampler.clean(&latent, output.clone(), step);
            latent.x = sampler.advance(&latent, &prediction, output, step);
            trace.push(gradient.loss);
            let step = Step {
                pass: Pass::Guided,
                index,
                steps: sampler.steps().len(),
                timestep: step.timestep,
                loss: trace.last().map(Vec::as_slice),
                gradient: Some(&gradient.embedding),
                embedding: &optimised.embedding,
                prediction: &prediction,
            };
            if observer.step(&step).is_break() {
                return Err(GuideError::stopped(&step, &trace));
            }
        }
        Ok((latent.x, trace))
    }

    fn gradient(
        &self,
        latent: &Latent<'_, D::Context>,
        index: usize,
        embedding: &Tensor<2>,
    ) -> Result<Gradient, GuideError> {
        let linearized = self.sampler.linearize(latent, index, embedding.clone());
        let output = linearized.output.clone();
        let (leaf, loss) = self.loss(latent, index, &output);
        let values = host(loss.clone().inner());
        if let Some(place) = values.iter().position(|value| !value.is_finite()) {
            let (motion, component) = (place / COMPONENTS, Component::ALL[place % COMPONENTS]);
            return Err(self.not_finite(Quantity::Loss, component, index, motion));
        }
        let gradient = linearized.pull(slope(&leaf, loss.sum()));
        if let Some(motion) = first_not_finite(&gradient) {
            let component = self.blame(latent, index, embedding, motion);
            return Err(self.not_finite(Quantity::Gradient, component, index, motion));
        }
        Ok(Gradient {
            output,
            loss: values
                .chunks_exact(COMPONENTS)
                .map(|components| components.iter().sum())
                .collect(),
            embedding: gradient,
        })
    }

    /// The Laban loss `[batch, 4]` of the motion that an output speaks of, as a function of the output,
    /// which comes first.
    fn loss(
        &self,
        latent: &Latent<'_, D::Context>,
        index: usize,
        output: &Tensor<3>,
    ) -> (Tensor<3>, Tensor<2>) {
        let sampler = self.sampler;
        let leaf = output.clone().autodiff().require_grad();
        let clean = sampler.clean(latent, leaf.clone(), &sampler.steps()[index]);
        let features = self.features.measure(sampler.joints(clean));
        (leaf, self.target.loss(features))
    }

    /// The component whose gradient is not finite for a motion; the first where each is finite
    /// alone and only their sum is not.
    fn blame(
        &self,
        latent: &Latent<'_, D::Context>,
        index: usize,
        embedding: &Tensor<2>,
        motion: usize,
    ) -> Component {
        Component::ALL
            .into_iter()
            .find(|component| {
                let linearized = self.sampler.linearize(latent, index, embedding.clone());
                let (leaf, loss) = self.loss(latent, index, &linearized.output);
                let loss = loss.narrow(0, motion, 1).narrow(1, component.index(), 1);
                first_not_finite(&linearized.pull(slope(&leaf, loss.sum()))).is_some()
            })
            .unwrap_or(Component::Weight)
    }

    fn not_finite(
        &self,
        quantity: Quantity,
        component: Component,
        index: usize,
        motion: usize,
    ) -> GuideError {
        let steps = self.sampler.steps();
        GuideError::NotFinite {
            quantity,
            component,
            index,
            steps: steps.len(),
            timestep: steps[index].timestep,
            motion,
        }
    }
}

impl Optimised {
    fn new(embedding: Tensor<2>, guidance: &Guidance) -> Self {
        let [first, second] = guidance.betas;
        let adam = AdamConfig::new()
            .with_beta_1(first)
            .with_beta_2(second)
            // burn's own default is 1e-5.
            .with_epsilon(guidance.epsilon)
            .build();
        Optimised {
            embedding,
            adam,
            state: None,
        }
    }

    fn update(&mut self, gradient: Tensor<2>, learning_rate: f64) {
        let (embedding, state) = self.adam.step(
            learning_rate,
            self.embedding.clone(),
            gradient,
            self.state.take(),
        );
        self.embedding = embedding;
        self.state = state;
    }
}

/// The gradient of a loss with respect to a leaf: zeros where it does not depend on it.
fn slope(leaf: &Tensor<3>, loss: Tensor<1>) -> Tensor<3> {
    let gradient = match loss.is_tracked() {
        true => leaf.grad_remove(&mut loss.backward()),
        false => None,
    };
    gradient.unwrap_or_else(|| leaf.clone().inner().zeros_like())
}

/// The first row that holds infinities or NaN.
fn first_not_finite(rows: &Tensor<2>) -> Option<usize> {
    // Zero times anything finite is zero.
    let marks = host((rows.clone() * 0.0).sum_dim(1));
    marks.iter().position(|mark| !mark.is_finite())
}

fn host(tensor: Tensor<2>) -> Vec<f32> {
    tensor.try_into_vec_as().expect("floats convert to f32")
}
