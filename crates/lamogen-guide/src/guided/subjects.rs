//! What may be moved towards the target: each says what a step does to it.
//!
//! ```text
//! Condition    e, or its scales and shifts ──network at a step──▶ clean motion ──▶ loss      at every DDIM step
//! Prediction              clean motion ──▶ loss                    at every DDIM step
//! Motion                  finished motion ──▶ loss                 again and again
//! Noise        z ──all steps of a pass──▶ finished motion ──▶ loss again and again
//! ```

use burn::tensor::Tensor;
use lamogen_model::Denoiser;

use super::objective::{Broken, Gradient, Objective, Way};
use super::optimised::Optimised;
use crate::guidance::{Guidance, GuidanceVariable, UpdateTiming};
use crate::sampler::{Batch, Latent, Sampler, mix};

/// What a step made.
pub(super) struct Made {
    /// Of each motion, before the step's last update.
    pub(super) loss: Vec<f32>,
    /// With respect to the embedding or modulation, where that is moved.
    pub(super) gradient: Option<Tensor<2>>,
    /// The clean motions as they are now seen, normalised.
    pub(super) prediction: Tensor<3>,
}

/// What a guided pass moves.
pub(super) trait Subject {
    /// How many steps there are.
    fn steps(&self) -> usize;

    /// The timestep that the network sees at a step; 0 where it sees none, or all.
    fn timestep(&self, index: usize) -> usize;

    /// Makes a step.
    fn step(&mut self, index: usize) -> Result<Made, Broken>;

    /// The sentence embedding as it is now.
    fn embedding(&self) -> &Tensor<2>;

    /// The motions after the last step, normalised.
    fn finish(self: Box<Self>) -> Tensor<3>;
}

/// What the network is told of the sentence: its embedding (the paper's method), or the scales and shifts that this becomes in
/// the stylization layers.
pub(super) struct Condition<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    latent: Latent<'s, D::Context>,
    optimised: Optimised<2>,
    told: Told,
    guidance: &'s Guidance,
}

/// Which part of a latent is moved.
#[derive(Clone, Copy, Debug)]
pub(super) enum Told {
    Embedding,
    Modulation,
}

impl<'s, 'a, D: Denoiser> Condition<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        told: Told,
        guidance: &'s Guidance,
    ) -> Self {
        let latent = sampler.start(batch);
        let start = match told {
            Told::Embedding => latent.embedding.clone(),
            Told::Modulation => {
                let shape = [batch.lengths.len(), sampler.model.modulations()];
                Tensor::zeros(shape, &latent.embedding.device())
            }
        };
        let mut condition = Condition {
            sampler,
            objective,
            latent,
            optimised: Optimised::new(start, guidance),
            told,
            guidance,
        };
        condition.tell();
        condition
    }

    fn move_down(&mut self, gradient: Tensor<2>, index: usize) {
        let rate = self.guidance.rate(index, self.steps());
        self.optimised.update(gradient, rate);
        self.tell();
    }

    /// Hands what is moved to the network.
    fn tell(&mut self) {
        let value = self.optimised.value.clone();
        match self.told {
            Told::Embedding => self.latent.embedding = value,
            Told::Modulation => self.latent.modulation = Some(value),
        }
    }

    fn gradient(&self, index: usize) -> Result<Gradient<2>, Broken> {
        let Condition {
            sampler, latent, ..
        } = self;
        let step = &sampler.steps()[index];
        self.objective.gradient(|| {
            let linearized = sampler.linearize(latent, index);
            Way {
                leaf: linearized.output.clone(),
                clean: Box::new(|output| sampler.clean(latent, output, step)),
                pull: Box::new(|gradient| linearized.pull(gradient)),
            }
        })
    }
}

impl<D: Denoiser> Subject for Condition<'_, '_, D> {
    fn steps(&self) -> usize {
        self.sampler.steps().len()
    }

    fn timestep(&self, index: usize) -> usize {
        self.sampler.steps()[index].timestep
    }

    fn step(&mut self, index: usize) -> Result<Made, Broken> {
        let mut found = self.gradient(index)?;
        for _ in 1..self.guidance.updates_per_step {
            self.move_down(found.gradient, index);
            found = self.gradient(index)?;
        }
        self.move_down(found.gradient.clone(), index);
        let output = match self.guidance.update {
            UpdateTiming::Lagged => found.leaf,
            UpdateTiming::Immediate => self.sampler.evaluate(&self.latent, index),
        };
        let step = &self.sampler.steps()[index];
        let prediction = self.sampler.clean(&self.latent, output.clone(), step);
        self.latent.x = { self.sampler }.advance(&self.latent, &prediction, output, step);
        Ok(Made {
            loss: found.loss,
            gradient: Some(found.gradient),
            prediction,
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.latent.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.latent.x
    }
}

/// The clean motion that is predicted at each step (the paper's rival "classifier guidance"); or nothing, where that is not updated.
pub(super) struct Prediction<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    latent: Latent<'s, D::Context>,
    guidance: &'s Guidance,
    updates: usize,
}

impl<'s, 'a, D: Denoiser> Prediction<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        guidance: &'s Guidance,
    ) -> Self {
        Prediction {
            sampler,
            objective,
            latent: sampler.start(batch),
            guidance,
            updates: match guidance.variable {
                GuidanceVariable::Nothing => 0,
                _ => guidance.updates_per_step,
            },
        }
    }
}

impl<D: Denoiser> Subject for Prediction<'_, '_, D> {
    fn steps(&self) -> usize {
        self.sampler.steps().len()
    }

    fn timestep(&self, index: usize) -> usize {
        self.sampler.steps()[index].timestep
    }

    fn step(&mut self, index: usize) -> Result<Made, Broken> {
        let (sampler, latent) = (self.sampler, &mut self.latent);
        let step = &sampler.steps()[index];
        let output = sampler.evaluate(latent, index);
        let mut prediction = sampler.clean(latent, output.clone(), step);
        // The noise stays what the network saw.
        let noise = sampler.noise(latent, latent.x.clone(), &prediction, output, step);
        let mut loss = match self.updates {
            0 => self.objective.loss_of(prediction.clone()),
            _ => Vec::new(),
        };
        let rate = self.guidance.rate(index, sampler.steps().len());
        for _ in 0..self.updates {
            let found = { self.objective }.gradient(|| itself(&prediction))?;
            prediction = prediction - found.gradient * rate;
            loss = found.loss;
        }
        latent.x = mix(&prediction, noise, step);
        Ok(Made {
            loss,
            gradient: None,
            prediction,
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.latent.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.latent.x
    }
}

/// The finished motion (the paper's rival "raw frame update").
pub(super) struct Motion<'s, 'a> {
    objective: &'s Objective<'a>,
    optimised: Optimised<3>,
    embedding: &'s Tensor<2>,
    iterations: usize,
    guidance: &'s Guidance,
}

impl<'s, 'a> Motion<'s, 'a> {
    pub(super) fn new(
        objective: &'s Objective<'a>,
        baseline: Tensor<3>,
        embedding: &'s Tensor<2>,
        iterations: usize,
        guidance: &'s Guidance,
    ) -> Self {
        Motion {
            objective,
            optimised: Optimised::new(baseline, guidance),
            embedding,
            iterations,
            guidance,
        }
    }
}

impl Subject for Motion<'_, '_> {
    fn steps(&self) -> usize {
        self.iterations
    }

    fn timestep(&self, _: usize) -> usize {
        0
    }

    fn step(&mut self, index: usize) -> Result<Made, Broken> {
        let found = { self.objective }.gradient(|| itself(&self.optimised.value))?;
        let rate = self.guidance.rate(index, self.iterations);
        self.optimised.update(found.gradient, rate);
        Ok(Made {
            loss: found.loss,
            gradient: None,
            prediction: self.optimised.value.clone(),
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        self.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        self.optimised.value
    }
}

/// The start noise, through all steps of a pass (Karunratanakul et al. 2024).
pub(super) struct Noise<'s, 'a, D: Denoiser> {
    sampler: &'s Sampler<'a, D>,
    objective: &'s Objective<'a>,
    batch: &'s Batch<D::Context>,
    optimised: Optimised<3>,
    /// 1 where a frame is part of its motion, else 0; none where no motion is padded.
    keep: Option<Tensor<3>>,
    /// How long the noise of each motion is, `[batch, 1, 1]`: it stays so.
    length: Tensor<3>,
    iterations: usize,
    guidance: &'s Guidance,
}

impl<'s, 'a, D: Denoiser> Noise<'s, 'a, D> {
    pub(super) fn new(
        sampler: &'s Sampler<'a, D>,
        objective: &'s Objective<'a>,
        batch: &'s Batch<D::Context>,
        iterations: usize,
        guidance: &'s Guidance,
    ) -> Self {
        let keep = sampler.start(batch).mask.keep();
        Noise {
            length: length(&batch.noise, &keep),
            keep,
            optimised: Optimised::new(batch.noise.clone(), guidance),
            sampler,
            objective,
            batch,
            iterations,
            guidance,
        }
    }

    /// A whole pass from a noise, with the way back to it.
    fn pass(&self) -> Way<'_, 3> {
        let sampler = self.sampler;
        let mut latent = sampler.start(self.batch);
        latent.x = self.optimised.value.clone();
        let mut back: Vec<Box<dyn FnOnce(Tensor<3>) -> Tensor<3> + '_>> = Vec::new();
        for (index, step) in sampler.steps().iter().enumerate() {
            let seen = sampler.linearize_motion(&latent, &self.batch.prompt.context, index);
            let (x, output) = (latent.x.clone(), seen.output.clone());
            let prediction = sampler.clean(&latent, output.clone(), step);
            let next = sampler.advance(&latent, &prediction, output.clone(), step);
            let here = latent.clone();
            back.push(Box::new(move |gradient: Tensor<3>| {
                let [x, output] = [x, output].map(|leaf| leaf.autodiff().require_grad());
                let clean = sampler.clean_at(&here, x.clone(), output.clone(), step);
                let noise = sampler.noise(&here, x.clone(), &clean, output.clone(), step);
                let next = mix(&clean, noise, step);
                let mut gradients = (next * gradient.autodiff()).sum().backward();
                let [of_x, of_output] = [x, output].map(|leaf| {
                    let gradient = leaf.grad_remove(&mut gradients);
                    gradient.unwrap_or_else(|| leaf.inner().zeros_like())
                });
                of_x + seen.pull(of_output)
            }));
            latent.x = next;
        }
        Way {
            leaf: latent.x,
            clean: Box::new(|motion| motion),
            pull: Box::new(move |gradient| {
                let steps = back.into_iter().rev();
                steps.fold(gradient, |gradient, step| step(gradient))
            }),
        }
    }
}

impl<D: Denoiser> Subject for Noise<'_, '_, D> {
    fn steps(&self) -> usize {
        self.iterations
    }

    fn timestep(&self, _: usize) -> usize {
        0
    }

    fn step(&mut self, index: usize) -> Result<Made, Broken> {
        let found = { self.objective }.gradient(|| self.pass())?;
        let rate = self.guidance.rate(index, self.iterations);
        self.optimised.update(found.gradient, rate);
        // Adam would let it grow, and noise of another size is none that the network knows.
        let noise = self.optimised.value.clone();
        self.optimised.value = noise.clone() * (self.length.clone() / length(&noise, &self.keep));
        Ok(Made {
            loss: found.loss,
            gradient: None,
            prediction: found.leaf,
        })
    }

    fn embedding(&self) -> &Tensor<2> {
        &self.batch.prompt.embedding
    }

    fn finish(self: Box<Self>) -> Tensor<3> {
        let batch = Batch {
            noise: self.optimised.value,
            ..self.batch.clone()
        };
        let passed = self.sampler.baseline(&batch, &mut ());
        passed.expect("nobody watches who could stop it")
    }
}

/// The way of motions to themselves.
fn itself<'w>(motion: &Tensor<3>) -> Way<'w, 3> {
    Way {
        leaf: motion.clone(),
        clean: Box::new(|motion| motion),
        pull: Box::new(|gradient| gradient),
    }
}

/// Euclidean length of each motion's numbers, `[batch, 1, 1]`.
fn length(noise: &Tensor<3>, keep: &Option<Tensor<3>>) -> Tensor<3> {
    let squares = noise.clone().square().sum_dim(2);
    let squares = match keep {
        Some(keep) => squares * keep.clone(),
        None => squares,
    };
    squares.sum_dim(1).sqrt()
}
