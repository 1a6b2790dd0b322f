//! One batch from start noise to finished motions.

use std::ops::ControlFlow;

use burn::tensor::{Int, Tensor, TensorData};
use lamogen_guide::{
    Batch, ClassifierFree, FitProgress, GuideError, Guided, LabanComparison, Pass, Rig, Sampler,
    Step, TermComparison, noise,
};
use lamogen_laban::{COMPONENTS, Goals, LabanSeries};
use lamogen_model::Denoiser;
use lamogen_motion::{Motion, MotionError, Rotations};

use crate::error::{
    Error, FailedRun, PartialResults, PassError, RequestIndex, StoppedRun, UnfinishedRequest,
};
use crate::generation::{Generation, LaMoGen, NetworkMotions, PartLaban, TermValues};
use crate::groups::Group;
use crate::request::Request;

/// Sees every step and may stop the run.
type Watch<'w> = &'w mut dyn FnMut(&Step<'_>) -> ControlFlow<()>;

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
        mut watch: Watch<'_>,
    ) -> Result<Vec<(usize, Generation)>, Error> {
        let LaMoGen {
            network,
            tokenizer,
            normalization,
            text_scale,
            ..
        } = self.model;
        let unconditional = tokenizer.unconditional().ids;
        let network = ClassifierFree::new(network, *text_scale, &unconditional)
            .map_err(|error| self.interrupted(error, &[]))?;
        let batch = self.batch(&network);
        let sampler = Sampler::new(&network, normalization, self.group.steps)
            .and_then(|sampler| sampler.with_temporal_smoothing(self.model.temporal_smoothing))
            .map_err(|error| self.interrupted(error, &[]))?;
        let baseline = sampler
            .baseline(&batch, &mut watch)
            .map_err(|error| self.interrupted(error, &[]))?;
        // A baseline that is no motion must not be blamed on guidance.
        let networks = self.motions(&baseline, Pass::Baseline, &[])?;
        let embedding = batch.prompt.embedding.clone();
        let mut body = OnBody {
            run: self,
            rig: Rig::new(&self.group.guidance, &network.device()),
            embedding: &embedding,
            watch,
        };
        let baselines = body.baselines(&networks, &baseline)?;
        if !self.group.is_guided {
            return Ok(self.text_alone(baselines, networks));
        }
        let jobs = self.group.jobs.iter();
        let goals: Vec<Goals> = { jobs }
            .map(|job| job.goals.clone().unwrap_or_else(Goals::anything))
            .collect();
        let guided = sampler
            .guided(
                &batch,
                baseline,
                &goals,
                &self.group.guidance,
                &mut body.watch,
            )
            .map_err(|error| self.interrupted(error, &baselines))?;
        let network_guided = self.motions(&guided.motion, Pass::Guided, &baselines)?;
        let Made {
            motions,
            whole,
            parts,
            terms,
        } = body.guided(&network_guided, &baselines, &goals, &guided)?;

        let networks = networks.into_iter().zip(network_guided);
        let motions = baselines.into_iter().zip(motions).zip(networks);
        let jobs = self.group.jobs.iter().zip(motions).enumerate();
        let generations = jobs.map(|(index, (job, ((baseline, motion), network)))| {
            let generation = Generation {
                cut_tokens: job.cut,
                unseen_words: self.unseen_words(job.request),
                stand_in: self.stand_in(job.request),
                goals: goals[index].clone(),
                guided: motion,
                baseline,
                network: NetworkMotions {
                    baseline: network.0,
                    guided: network.1,
                },
                guided_laban: self.series(&whole.guided, index),
                target: self.series(&whole.target, index),
                baseline_laban: self.series(&whole.baseline, index),
                parts: self.parts(&goals[index], &whole, &parts, index),
                terms: terms.iter().map(|term| self.term(term, index)).collect(),
                loss: guided.loss.iter().map(|losses| losses[index]).collect(),
            };
            (job.request, generation)
        });
        Ok(generations.collect())
    }

    /// Words of a request's prompt that the model has not met.
    fn unseen_words(&self, request: usize) -> Vec<String> {
        let known = self.model.known_words.as_ref();
        known.map_or(Vec::new(), |known| {
            known.unseen(&self.requests[request].prompt)
        })
    }

    /// What a request's prompt was read as.
    fn stand_in(&self, request: usize) -> Option<String> {
        let prompt = &self.requests[request].prompt;
        self.model.stand_in(prompt).map(str::to_owned)
    }

    /// What there is without tags: the baseline is all.
    fn text_alone(&self, motions: Vec<Motion>, networks: Vec<Motion>) -> Vec<(usize, Generation)> {
        let device = self.model.network.device();
        let options = &self.group.guidance.laban;
        let jobs = self
            .group
            .jobs
            .iter()
            .zip(motions.into_iter().zip(networks));
        jobs.map(|(job, (motion, network))| {
            let laban = LabanSeries::of(&motion, options, &device);
            let generation = Generation {
                cut_tokens: job.cut,
                unseen_words: self.unseen_words(job.request),
                stand_in: self.stand_in(job.request),
                goals: Goals::default(),
                guided: motion.clone(),
                baseline: motion,
                network: NetworkMotions {
                    baseline: network.clone(),
                    guided: network,
                },
                guided_laban: laban.clone(),
                target: laban.clone(),
                baseline_laban: laban,
                parts: Vec::new(),
                terms: Vec::new(),
                loss: Vec::new(),
            };
            (job.request, generation)
        })
        .collect()
    }

    /// Encoded prompts and start noise, padded to the longest motion.
    fn batch<N: Denoiser>(&self, network: &N) -> Batch<N::Context> {
        let tokenizer = &self.model.tokenizer;
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
                .map_err(|reason| self.failed(index, PassError::Motion { pass, reason }, baselines))
        };
        (0..self.group.jobs.len()).map(motion).collect()
    }

    /// Motions of a rigid body.
    fn rigid(
        &self,
        rotations: Vec<Rotations>,
        pass: Pass,
        baselines: &[Motion],
    ) -> Result<Vec<Motion>, Error> {
        let motions = rotations.into_iter().enumerate();
        let motions = motions.map(|(index, rotations)| {
            Motion::from_rotations(rotations)
                .map_err(|reason| self.failed(index, PassError::Motion { pass, reason }, baselines))
        });
        motions.collect()
    }

    fn series(&self, features: &Tensor<3>, index: usize) -> LabanSeries {
        let frames = self.group.jobs[index].frames;
        let rows = features.clone().narrow(0, index, 1).narrow(1, 0, frames);
        LabanSeries::from_tensor(rows.reshape([frames, COMPONENTS]))
    }

    /// Returns the values of a loss term for one motion.
    fn term(&self, term: &TermComparison, index: usize) -> TermValues {
        let frames = self.group.jobs[index].frames;
        let rows = |values: &Tensor<3>| -> Vec<Vec<f32>> {
            let [_, _, width] = values.dims();
            let rows = values.clone().narrow(0, index, 1).narrow(1, 0, frames);
            let rows: Vec<f32> = rows.try_into_vec_as().expect("floats convert to f32");
            rows.chunks_exact(width).map(<[f32]>::to_vec).collect()
        };
        TermValues {
            name: term.name.clone(),
            value_names: term.value_names.clone(),
            baseline: rows(&term.baseline),
            target: rows(&term.target),
            weight: rows(&term.weight),
            guided: rows(&term.guided),
        }
    }

    /// Laban features of the parts that a motion asks something of.
    fn parts(
        &self,
        goals: &Goals,
        whole: &LabanComparison,
        parts: &[LabanComparison],
        index: usize,
    ) -> Vec<PartLaban> {
        let all = &self.group.guidance.laban.end_effectors;
        let own = goals.terms(all).into_iter().skip(1);
        let own = own.map(|term| {
            let found = parts.iter();
            let mut found = found.filter(|part| part.end_effectors == term.end_effectors);
            let part = found.next().unwrap_or(whole);
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
                let at = (stopped.pass, stopped.index, stopped.steps);
                self.stopped(at, baselines, &stopped.loss, |index| {
                    self.motion(&stopped.prediction, index).ok()
                })
            }
            error => {
                let index = error.motion().unwrap_or(0);
                self.failed(index, error.into(), baselines)
            }
        }
    }

    /// What a stopped pass leaves: the baselines, if they are finished, and what else there is of every motion.
    fn stopped(
        &self,
        (pass, index, steps): (Pass, usize, usize),
        baselines: &[Motion],
        loss: &[Vec<f32>],
        prediction: impl Fn(usize) -> Option<Motion>,
    ) -> Error {
        let mut partial = self.partial(baselines);
        for (place, unfinished) in partial.unfinished.iter_mut().enumerate() {
            unfinished.prediction = prediction(place);
            unfinished.loss = loss.iter().map(|losses| losses[place]).collect();
        }
        Error::Stopped(Box::new(StoppedRun {
            pass,
            index,
            steps,
            partial,
        }))
    }

    fn failed(&self, index: usize, reason: PassError, baselines: &[Motion]) -> Error {
        Error::Failed(Box::new(FailedRun {
            which: RequestIndex::new(self.requests, self.group.jobs[index].request),
            reason,
            partial: self.partial(baselines),
        }))
    }

    fn partial(&self, baselines: &[Motion]) -> PartialResults {
        let jobs = self.group.jobs.iter().enumerate();
        let unfinished = jobs.map(|(index, job)| UnfinishedRequest {
            request: job.request,
            baseline: baselines.get(index).cloned(),
            prediction: None,
            loss: Vec::new(),
        });
        PartialResults {
            finished: Vec::new(),
            unfinished: unfinished.collect(),
        }
    }
}

/// What follows each pass of the network: its motions on a rigid body, where that is asked for.
struct OnBody<'r, 'w, D> {
    run: &'r Run<'r, D>,
    rig: Rig<'r>,
    embedding: &'r Tensor<2>,
    watch: Watch<'w>,
}

/// The guided motions of a group, and what they reached.
struct Made {
    motions: Vec<Motion>,
    whole: LabanComparison,
    parts: Vec<LabanComparison>,
    terms: Vec<TermComparison>,
}

impl<D: Denoiser> OnBody<'_, '_, D> {
    /// The motions of the first pass, which the network gave as `normalized`.
    fn baselines(
        &mut self,
        networks: &[Motion],
        normalized: &Tensor<3>,
    ) -> Result<Vec<Motion>, Error> {
        if !self.run.group.is_rigid() {
            return Ok(networks.to_vec());
        }
        let mut last = 0;
        let mut watch = watching(self.embedding, normalized, &mut self.watch, &mut last);
        let (rotations, is_stopped) = self.rig.fit(networks, &mut watch);
        drop(watch);
        let motions = self.run.rigid(rotations, Pass::Baseline, &[])?;
        match is_stopped {
            true => {
                let steps = self.run.group.guidance.fit.allowed(false);
                let at = (Pass::Body, last, steps);
                Err(self.run.stopped(at, &motions, &[], |_| None))
            }
            false => Ok(motions),
        }
    }

    /// The motions of the second pass.
    fn guided(
        &mut self,
        networks: &[Motion],
        baselines: &[Motion],
        goals: &[Goals],
        guided: &Guided,
    ) -> Result<Made, Error> {
        if !self.run.group.is_rigid() {
            return Ok(Made {
                motions: networks.to_vec(),
                whole: guided.whole.clone(),
                parts: guided.parts.clone(),
                terms: guided.terms.clone(),
            });
        }
        let mut last = 0;
        let mut watch = watching(self.embedding, &guided.motion, &mut self.watch, &mut last);
        let made = self.rig.guide(networks, baselines, goals, &mut watch);
        drop(watch);
        let made = made.map_err(|error| self.run.interrupted(error, baselines))?;
        let motions = self.run.rigid(made.rotations, Pass::Guided, baselines)?;
        match made.is_stopped {
            true => {
                let steps = self.run.group.guidance.fit.allowed(true);
                let at = (Pass::Body, last, steps);
                let prediction = |index: usize| motions.get(index).cloned();
                Err(self.run.stopped(at, baselines, &guided.loss, prediction))
            }
            false => Ok(Made {
                motions,
                whole: made.whole,
                parts: made.parts,
                terms: made.terms,
            }),
        }
    }
}

/// What sees a fit as steps of a run; `last` is told the number of the step just made.
fn watching<'s>(
    embedding: &'s Tensor<2>,
    prediction: &'s Tensor<3>,
    watch: &'s mut dyn FnMut(&Step<'_>) -> ControlFlow<()>,
    last: &'s mut usize,
) -> impl FnMut(FitProgress) -> ControlFlow<()> + 's {
    move |progress| {
        *last = progress.done - 1;
        watch(&Step {
            pass: Pass::Body,
            index: progress.done - 1,
            steps: progress.total,
            timestep: 0,
            loss: None,
            gradient: None,
            embedding,
            prediction,
        })
    }
}
