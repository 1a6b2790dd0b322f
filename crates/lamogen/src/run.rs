//! One batch from start noise to finished motions.

use std::ops::ControlFlow;

use burn::tensor::{Int, Tensor, TensorData};
use lamogen_guide::{Batch, GuideError, Guided, Pass, Sampler, Step, noise};
use lamogen_laban::{COMPONENTS, Goals, LabanFeatures, LabanSeries};
use lamogen_model::Denoiser;
use lamogen_motion::{Motion, MotionError, joints};

use crate::error::{Error, Failed, Failure, Partial, Stopped, Unfinished, Which};
use crate::generation::{Generation, LaMoGen, PartLaban};
use crate::groups::Group;
use crate::request::Request;

/// A group of requests that a model works on.
pub(crate) struct Run<'a, D> {
    model: &'a LaMoGen<D>,
    group: &'a Group,
    requests: &'a [Request],
}

impl<'a, D: Denoiser> Run<'a, D> {
    pub(crate) fn new(model: &'a LaMoGen<D>, group: &'a Group, requests: &'a [Request]) -> Self {
        Run {
            model,
            group,
            requests,
        }
    }

    /// The group's motions, with their places among the requests.
    pub(crate) fn generations(
        &self,
        mut watch: &mut dyn FnMut(&Step<'_>) -> ControlFlow<()>,
    ) -> Result<Vec<(usize, Generation)>, Error> {
        let LaMoGen {
            network,
            normalization,
            ..
        } = self.model;
        let batch = self.batch();
        let sampler = Sampler::new(network, normalization, self.group.steps)
            .and_then(|sampler| sampler.with_coherence(self.model.coherence))
            .map_err(|error| self.interrupted(error, &[]))?;
        let baseline = sampler
            .baseline(&batch, &mut watch)
            .map_err(|error| self.interrupted(error, &[]))?;
        // A baseline that is no motion must not be blamed on guidance.
        let baselines = self.motions(&baseline, Pass::Baseline, &[])?;
        if !self.group.is_guided {
            return Ok(self.text_alone(&baseline, baselines));
        }
        let jobs = self.group.jobs.iter();
        let goals: Vec<Goals> = jobs.filter_map(|job| job.goals.clone()).collect();
        let guided = sampler
            .guided(&batch, baseline, &goals, &self.group.guidance, &mut watch)
            .map_err(|error| self.interrupted(error, &baselines))?;
        let motions = self.motions(&guided.motion, Pass::Guided, &baselines)?;

        let jobs = self
            .group
            .jobs
            .iter()
            .zip(baselines.into_iter().zip(motions));
        let generations = jobs.enumerate().map(|(index, (job, (baseline, motion)))| {
            let generation = Generation {
                cut_tokens: job.cut,
                goals: goals[index].clone(),
                guided: motion,
                baseline,
                guided_laban: self.series(&guided.whole.guided, index),
                target: self.series(&guided.whole.target, index),
                baseline_laban: self.series(&guided.whole.baseline, index),
                parts: self.parts(&goals[index], &guided, index),
                loss: guided.loss.iter().map(|losses| losses[index]).collect(),
            };
            (job.request, generation)
        });
        Ok(generations.collect())
    }

    /// What there is without tags: the baseline is all.
    fn text_alone(&self, normalized: &Tensor<3>, motions: Vec<Motion>) -> Vec<(usize, Generation)> {
        let [_, frames, _] = normalized.dims();
        let options = &self.group.guidance.laban;
        let denormalized = self.model.normalization.denormalize(normalized.clone());
        let features = LabanFeatures::new(options, frames, &self.lengths(), &normalized.device())
            .measure(joints(denormalized));
        let jobs = self.group.jobs.iter().zip(motions).enumerate();
        jobs.map(|(index, (job, motion))| {
            let laban = self.series(&features, index);
            let generation = Generation {
                cut_tokens: job.cut,
                goals: Goals::default(),
                guided: motion.clone(),
                baseline: motion,
                guided_laban: laban.clone(),
                target: laban.clone(),
                baseline_laban: laban,
                parts: Vec::new(),
                loss: Vec::new(),
            };
            (job.request, generation)
        })
        .collect()
    }

    /// Encoded prompts and start noise, padded to the longest motion.
    fn batch(&self) -> Batch<D::Context> {
        let LaMoGen {
            network, tokenizer, ..
        } = self.model;
        let device = network.device();
        let jobs = &self.group.jobs;
        let (size, features) = (jobs.len(), network.pose_features());
        let lengths = self.lengths();
        let frames = lengths.iter().copied().max().unwrap_or(0);
        let ids: Vec<i32> = jobs
            .iter()
            .flat_map(|job| &job.ids)
            .map(|&id| id as i32)
            .collect();
        let ids = TensorData::new(ids, [size, tokenizer.context_length()]);
        let noise: Vec<f32> = jobs
            .iter()
            .flat_map(|job| noise(job.seed, frames, features))
            .collect();
        let noise = TensorData::new(noise, [size, frames, features]);
        Batch {
            prompt: network.encode(Tensor::<2, Int>::from_data(ids, &device)),
            noise: Tensor::from_data(noise, &device),
            lengths,
        }
    }

    fn lengths(&self) -> Vec<usize> {
        self.group.jobs.iter().map(|job| job.frames).collect()
    }

    fn motion(&self, normalized: &Tensor<3>, index: usize) -> Result<Motion, MotionError> {
        let [_, _, features] = normalized.dims();
        let frames = self.group.jobs[index].frames;
        let rows = normalized.clone().narrow(0, index, 1).narrow(1, 0, frames);
        let rows = self.model.normalization.denormalize(rows);
        Motion::from_features(rows.reshape([frames, features]))
    }

    fn motions(
        &self,
        normalized: &Tensor<3>,
        pass: Pass,
        baselines: &[Motion],
    ) -> Result<Vec<Motion>, Error> {
        let motion = |index| {
            self.motion(normalized, index)
                .map_err(|reason| self.failed(index, Failure::Motion { pass, reason }, baselines))
        };
        (0..self.group.jobs.len()).map(motion).collect()
    }

    fn series(&self, features: &Tensor<3>, index: usize) -> LabanSeries {
        let frames = self.group.jobs[index].frames;
        let rows = features.clone().narrow(0, index, 1).narrow(1, 0, frames);
        LabanSeries::from_tensor(rows.reshape([frames, COMPONENTS]))
    }

    /// Laban features of the parts that a motion asks something of.
    fn parts(&self, goals: &Goals, guided: &Guided, index: usize) -> Vec<PartLaban> {
        let all = &self.group.guidance.laban.end_effectors;
        let own = goals.terms(all).into_iter().skip(1);
        let own = own.map(|term| {
            let found = guided.parts.iter();
            let mut found = found.filter(|part| part.end_effectors == term.end_effectors);
            let part = found.next().unwrap_or(&guided.whole);
            PartLaban {
                end_effectors: term.end_effectors,
                baseline: self.series(&part.baseline, index),
                target: self.series(&part.target, index),
                guided: self.series(&part.guided, index),
            }
        });
        own.collect()
    }

    /// The end of a pass before its time. `baselines` are empty until the first pass is finished.
    fn interrupted(&self, error: GuideError, baselines: &[Motion]) -> Error {
        match error {
            GuideError::Stopped(stopped) => {
                Error::Stopped(Box::new(self.stopped(*stopped, baselines)))
            }
            error => {
                let index = error.motion().unwrap_or(0);
                self.failed(index, error.into(), baselines)
            }
        }
    }

    fn stopped(&self, stopped: lamogen_guide::Stopped, baselines: &[Motion]) -> Stopped {
        let mut partial = self.partial(baselines);
        for (index, unfinished) in partial.unfinished.iter_mut().enumerate() {
            unfinished.prediction = self.motion(&stopped.prediction, index).ok();
            unfinished.loss = stopped.loss.iter().map(|losses| losses[index]).collect();
        }
        Stopped {
            pass: stopped.pass,
            index: stopped.index,
            steps: stopped.steps,
            partial,
        }
    }

    fn failed(&self, index: usize, reason: Failure, baselines: &[Motion]) -> Error {
        Error::Failed(Box::new(Failed {
            which: Which::new(self.requests, self.group.jobs[index].request),
            reason,
            partial: self.partial(baselines),
        }))
    }

    fn partial(&self, baselines: &[Motion]) -> Partial {
        let jobs = self.group.jobs.iter().enumerate();
        let unfinished = jobs.map(|(index, job)| Unfinished {
            request: job.request,
            baseline: baselines.get(index).cloned(),
            prediction: None,
            loss: Vec::new(),
        });
        Partial {
            finished: Vec::new(),
            unfinished: unfinished.collect(),
        }
    }
}
