//! From requests to motions.

use std::ops::ControlFlow;

use burn::tensor::{Int, Tensor, TensorData};
use lamogen_guide::{Batch, GuideError, Pass, Preset, Sampler, Step, noise};
use lamogen_laban::{COMPONENTS, LabanFeatures, LabanSeries, Scale};
use lamogen_model::{Denoiser, MotionDiffuse, Tokenizer};
use lamogen_motion::{Motion, Normalization, joints};

use crate::error::{Error, Failed, Failure, Partial, Stopped, Unfinished, Which};
use crate::groups::{Group, assign};
use crate::licence::Licence;
use crate::request::Request;

/// A text-to-motion model that Laban tags can steer.
pub struct LaMoGen<D = MotionDiffuse> {
    network: D,
    tokenizer: Tokenizer,
    normalization: Normalization,
    licence: Option<Licence>,
    preset: Preset,
    batch_size: usize,
}

/// A finished request.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Generation {
    /// How many tokens of the prompt did not fit the model and were left out.
    pub cut_tokens: usize,
    /// The factors that the tags stand for.
    pub scale: Scale,
    /// The motion of the text alone.
    pub baseline: Motion,
    /// The motion that follows the tags. Without tags or scale there is nothing to follow: the
    /// second pass is left out and this is the baseline.
    pub guided: Motion,
    /// Laban features of the baseline.
    pub baseline_laban: LabanSeries,
    /// Laban features of the guided motion.
    pub guided_laban: LabanSeries,
    /// Laban features to reach: the baseline's, scaled.
    pub target: LabanSeries,
    /// The Laban loss at every step of the guided pass.
    pub loss: Vec<f32>,
}

/// How far a call has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Steps made, over all passes and batches.
    pub done: usize,
    /// Steps in all.
    pub total: usize,
    /// The step just made.
    pub step: &'a Step<'a>,
}

impl<D: Denoiser> LaMoGen<D> {
    pub(crate) fn from_parts(
        network: D,
        tokenizer: Tokenizer,
        normalization: Normalization,
    ) -> Self {
        LaMoGen {
            network,
            tokenizer,
            normalization,
            licence: None,
            preset: Preset::default(),
            batch_size: 8,
        }
    }

    pub(crate) fn with_licence(self, licence: Option<Licence>) -> Self {
        LaMoGen { licence, ..self }
    }

    /// Sets what requests run with that say nothing else.
    pub fn with_preset(self, preset: Preset) -> Self {
        LaMoGen { preset, ..self }
    }

    /// Sets how many motions run together in [`generate_all`](Self::generate_all); 8 by default.
    /// More need more memory, and are faster on a GPU.
    ///
    /// # Panics
    ///
    /// If it is 0.
    pub fn with_batch_size(self, batch_size: usize) -> Self {
        assert!(batch_size > 0, "a batch has at least one motion");
        LaMoGen { batch_size, ..self }
    }

    /// The licence of the weights, if their file states one. PyTorch checkpoints do not.
    pub fn licence(&self) -> Option<&Licence> {
        self.licence.as_ref()
    }

    /// The network.
    pub fn network(&self) -> &D {
        &self.network
    }

    /// Generates a motion.
    ///
    /// # Errors
    ///
    /// If the request makes no sense, or numbers become infinite on the way.
    pub fn generate(&self, request: &Request) -> Result<Generation, Error> {
        self.generate_with(request, &mut |_| ControlFlow::Continue(()))
    }

    /// As [`generate`](Self::generate); `observer` sees every step and may stop the run.
    ///
    /// # Errors
    ///
    /// As [`generate`](Self::generate), and [`Error::Stopped`] with what there is if stopped.
    pub fn generate_with(
        &self,
        request: &Request,
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Result<Generation, Error> {
        let mut all = self.generate_all_with(std::slice::from_ref(request), observer)?;
        Ok(all.pop().expect("one request gives one motion"))
    }

    /// Generates several motions, those with the same steps and guidance options together. Each is
    /// the motion that [`generate`](Self::generate) gives.
    ///
    /// # Errors
    ///
    /// As [`generate`](Self::generate). All requests are checked before the first is run; a run that
    /// fails later keeps what was finished ([`Error::Failed`]).
    pub fn generate_all(&self, requests: &[Request]) -> Result<Vec<Generation>, Error> {
        self.generate_all_with(requests, &mut |_| ControlFlow::Continue(()))
    }

    /// As [`generate_all`](Self::generate_all); `observer` sees every step and may stop the run.
    ///
    /// # Errors
    ///
    /// As [`generate_all`](Self::generate_all), and [`Error::Stopped`] with what there is if
    /// stopped.
    pub fn generate_all_with(
        &self,
        requests: &[Request],
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Result<Vec<Generation>, Error> {
        let groups = self.groups(requests)?;
        let total = groups.iter().map(Group::cost).sum();
        let mut done = 0;
        let mut watch = |step: &Step<'_>| {
            done += 1;
            observer(&Progress { done, total, step })
        };
        let mut finished: Vec<(usize, Generation)> = Vec::new();
        for group in &groups {
            match self.run(group, requests, &mut watch) {
                Ok(generations) => finished.extend(generations),
                Err(mut error) => {
                    finished.sort_by_key(|&(request, _)| request);
                    match &mut error {
                        Error::Stopped(stopped) => stopped.partial.finished = finished,
                        Error::Failed(failed) => failed.partial.finished = finished,
                        Error::Request { .. } => {}
                    }
                    return Err(error);
                }
            }
        }
        finished.sort_by_key(|&(request, _)| request);
        Ok(finished.into_iter().map(|(_, motion)| motion).collect())
    }

    fn groups(&self, requests: &[Request]) -> Result<Vec<Group>, Error> {
        let mut groups = Vec::new();
        for (index, request) in requests.iter().enumerate() {
            assign(
                &mut groups,
                (index, request),
                &self.network,
                &self.tokenizer,
                (self.preset, self.batch_size),
            )
            .map_err(|reason| Error::Request {
                which: which(requests, index),
                reason,
            })?;
        }
        Ok(groups)
    }

    /// Runs a group; answers with its motions and their places among the requests.
    fn run(
        &self,
        group: &Group,
        requests: &[Request],
        watch: &mut dyn FnMut(&Step<'_>) -> ControlFlow<()>,
    ) -> Result<Vec<(usize, Generation)>, Error> {
        let mut watch = |step: &Step<'_>| watch(step);
        let interrupted = |error, baselines: &[Motion]| match error {
            GuideError::Stopped(stopped) => {
                Error::Stopped(Box::new(self.stopped(group, *stopped, baselines)))
            }
            error => failed(requests, group, error.motion(), error, baselines),
        };
        let batch = self.batch(group);
        let sampler = Sampler::new(&self.network, &self.normalization, group.steps)
            .map_err(|error| interrupted(error, &[]))?;
        let baseline = sampler
            .baseline(&batch, &mut watch)
            .map_err(|error| interrupted(error, &[]))?;
        let motions = |tensor: &Tensor<3>, pass, baselines: &[Motion]| {
            let jobs = group.jobs.iter().enumerate();
            let motion = jobs.map(|(index, job)| {
                self.motion(tensor, index, job.frames).map_err(|reason| {
                    let reason = Failure::Motion { pass, reason };
                    failed(requests, group, Some(index), reason, baselines)
                })
            });
            motion.collect::<Result<Vec<Motion>, Error>>()
        };
        let baselines = motions(&baseline, Pass::Baseline, &[])?;
        let series = |tensor: &Tensor<3>, index: usize| {
            let frames = group.jobs[index].frames;
            let rows = tensor.clone().narrow(0, index, 1).narrow(1, 0, frames);
            LabanSeries::from_tensor(rows.reshape([frames, COMPONENTS]))
        };
        if !group.is_guided {
            let features = self.measure(&baseline, group);
            let jobs = group.jobs.iter().zip(baselines).enumerate();
            let generations = jobs.map(|(index, (job, baseline))| {
                let laban = series(&features, index);
                let generation = Generation {
                    cut_tokens: job.cut,
                    scale: Scale::NEUTRAL,
                    guided: baseline.clone(),
                    baseline,
                    guided_laban: laban.clone(),
                    target: laban.clone(),
                    baseline_laban: laban,
                    loss: Vec::new(),
                };
                (job.request, generation)
            });
            return Ok(generations.collect());
        }
        let scales: Vec<Scale> = group.jobs.iter().filter_map(|job| job.scale).collect();
        let guided = sampler
            .guided(&batch, baseline, &scales, &group.guidance, &mut watch)
            .map_err(|error| interrupted(error, &baselines))?;
        let motions = motions(&guided.motion, Pass::Guided, &baselines)?;
        let jobs = group.jobs.iter().zip(baselines.into_iter().zip(motions));
        let generations = jobs.enumerate().map(|(index, (job, (baseline, motion)))| {
            let generation = Generation {
                cut_tokens: job.cut,
                scale: scales[index],
                guided: motion,
                baseline,
                guided_laban: series(&guided.features, index),
                target: series(&guided.target_features, index),
                baseline_laban: series(&guided.baseline_features, index),
                loss: guided.loss.iter().map(|losses| losses[index]).collect(),
            };
            (job.request, generation)
        });
        Ok(generations.collect())
    }

    /// Encoded prompts and start noise, padded to the longest motion.
    fn batch(&self, group: &Group) -> Batch<D::Context> {
        let device = self.network.device();
        let (size, features) = (group.jobs.len(), self.network.pose_features());
        let lengths: Vec<usize> = group.jobs.iter().map(|job| job.frames).collect();
        let frames = lengths.iter().copied().max().unwrap_or(0);
        let ids: Vec<i32> = group
            .jobs
            .iter()
            .flat_map(|job| &job.ids)
            .map(|&id| id as i32)
            .collect();
        let ids = TensorData::new(ids, [size, self.tokenizer.context_length()]);
        let noise: Vec<f32> = group
            .jobs
            .iter()
            .flat_map(|job| noise(job.seed, frames, features))
            .collect();
        let noise = TensorData::new(noise, [size, frames, features]);
        Batch {
            prompt: self
                .network
                .encode(Tensor::<2, Int>::from_data(ids, &device)),
            noise: Tensor::from_data(noise, &device),
            lengths,
        }
    }

    fn measure(&self, normalized: &Tensor<3>, group: &Group) -> Tensor<3> {
        let [_, frames, _] = normalized.dims();
        let lengths: Vec<usize> = group.jobs.iter().map(|job| job.frames).collect();
        let options = &group.guidance.laban;
        LabanFeatures::new(options, frames, &lengths, &normalized.device())
            .measure(joints(self.normalization.denormalize(normalized.clone())))
    }

    fn motion(
        &self,
        normalized: &Tensor<3>,
        index: usize,
        frames: usize,
    ) -> Result<Motion, lamogen_motion::MotionError> {
        let [_, _, features] = normalized.dims();
        let rows = normalized.clone().narrow(0, index, 1).narrow(1, 0, frames);
        let rows = self.normalization.denormalize(rows);
        Motion::from_features(rows.reshape([frames, features]))
    }

    fn stopped(
        &self,
        group: &Group,
        stopped: lamogen_guide::Stopped,
        baselines: &[Motion],
    ) -> Stopped {
        let mut partial = unfinished(group, baselines);
        for (index, (job, unfinished)) in group.jobs.iter().zip(&mut partial.unfinished).enumerate()
        {
            let prediction = self.motion(&stopped.prediction, index, job.frames);
            unfinished.prediction = prediction.ok();
            unfinished.loss = stopped.loss.iter().map(|losses| losses[index]).collect();
        }
        Stopped {
            pass: stopped.pass,
            index: stopped.index,
            steps: stopped.steps,
            partial,
        }
    }
}

fn which(requests: &[Request], index: usize) -> Which {
    Which {
        index,
        count: requests.len(),
        prompt: requests[index].prompt.clone(),
    }
}

/// What there is of a group whose baselines are finished, or not (empty).
fn unfinished(group: &Group, baselines: &[Motion]) -> Partial {
    let unfinished = group
        .jobs
        .iter()
        .enumerate()
        .map(|(index, job)| Unfinished {
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

/// A failure at a motion of a group, the first where it is not about one.
fn failed(
    requests: &[Request],
    group: &Group,
    motion: Option<usize>,
    reason: impl Into<Failure>,
    baselines: &[Motion],
) -> Error {
    Error::Failed(Box::new(Failed {
        which: which(requests, group.jobs[motion.unwrap_or(0)].request),
        reason: reason.into(),
        partial: unfinished(group, baselines),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_can_be_shared_between_threads() {
        fn shared<T: Send + Sync>() {}
        shared::<LaMoGen>();
        shared::<Generation>();
        shared::<Error>();
    }
}
