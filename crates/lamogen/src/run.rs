//! Running one batch: from start noise to finished motions.

mod body_fitter;

use std::ops::ControlFlow;

use burn::tensor::{Tensor, TensorData};
use lamogen_guide::{
    Batch, ClassifierFree, Continuation, GuideError, KnownFrames, LabanComparison, Looped, Pass,
    PlaceOutcome, Rig, Sampler, Step, StepNoise, TermComparison, Tiled, noise,
};
use lamogen_laban::{COMPONENTS, Goals, LabanSeries};
use lamogen_model::{Denoiser, MotionWindow, SamplingMethod, TokenBatch, Tokens};
use lamogen_motion::{Motion, MotionError, Rotations, close_path};

use body_fitter::{BodyFitter, FinalMotions};

use crate::baseline_cache::{Baseline, BaselineKey};
use crate::error::{
    Error, FailedRun, PartialResults, PassError, RequestIndex, StoppedRun, UnfinishedRequest,
};
use crate::generation::{
    GeneratedSentence, Generation, LaMoGen, NetworkMotions, PartLaban, TermValues,
};
use crate::groups::{GenerationJob, JobGroup};
use crate::kept::{KeptFrames, kept_motion};
use crate::licence::Licence;
use crate::neighbours::KnownStarts;
use crate::request::Request;
use crate::standing::standing;

/// A function that is called after every step and may stop the run.
type StepObserver<'o> = &'o mut dyn FnMut(&Step<'_>) -> ControlFlow<()>;

/// The motions of a batch after the first pass.
pub(crate) struct Baselines {
    /// The normalised pose features of the network, `(motions, frames, features)`.
    normalized: Tensor<3>,
    /// The network's motions.
    network: Vec<Motion>,
    /// The motions that are measured and guided: those of the rigid body, or the network's.
    pub(crate) motions: Vec<Motion>,
}

/// The network of a model as a batch needs it.
type BatchNetwork<'n, D> = Tiled<'n, Looped<'n, ClassifierFree<'n, D>>>;

/// What a pass needs: the sampler, and the encoded batch.
struct Sampling<'s, 'n, D: Denoiser> {
    sampler: Sampler<'s, BatchNetwork<'n, D>>,
    batch: Batch<<BatchNetwork<'n, D> as Denoiser>::Context>,
}

/// The run of a model on one batch of requests.
pub(crate) struct BatchRun<'a, D> {
    model: &'a LaMoGen<D>,
    group: &'a JobGroup,
    requests: &'a [Request],
}

impl<'a, D: Denoiser> BatchRun<'a, D> {
    pub(crate) fn new(model: &'a LaMoGen<D>, group: &'a JobGroup, requests: &'a [Request]) -> Self {
        BatchRun {
            model,
            group,
            requests,
        }
    }

    /// Generates the motions of the batch. Each comes with the place of its request among the requests.
    pub(crate) fn generations(
        &self,
        observer: StepObserver<'_>,
    ) -> Result<Vec<(usize, Generation)>, Error> {
        // The baselines are checked before the guided pass, so that an unusable baseline is not reported as an error of
        // guidance.
        if !self.group.is_guided || self.continues_guided() {
            let baselines = self.baselines(observer)?;
            return self.generations_from(baselines, observer);
        }
        // Both passes begin alike, so that prompts and known frames are prepared once.
        self.with_sampling(Pass::Baseline, |sampling| {
            let baselines = match self.cached_baselines() {
                Some(baselines) => baselines,
                None => self.first_pass(sampling, observer)?,
            };
            self.second_pass(sampling, baselines, observer)
        })
    }

    /// Whether the guided pass continues other frames than the first pass.
    fn continues_guided(&self) -> bool {
        let mut starts = self.group.jobs.iter().filter_map(|job| job.start.as_ref());
        starts.any(KnownStarts::differ)
    }

    /// Makes the first pass.
    pub(crate) fn baselines(&self, observer: StepObserver<'_>) -> Result<Baselines, Error> {
        match self.cached_baselines() {
            Some(baselines) => Ok(baselines),
            None => self.with_sampling(Pass::Baseline, |sampling| {
                self.first_pass(sampling, observer)
            }),
        }
    }

    /// Makes the second pass, from the motions of the first.
    pub(crate) fn generations_from(
        &self,
        baselines: Baselines,
        observer: StepObserver<'_>,
    ) -> Result<Vec<(usize, Generation)>, Error> {
        if !self.group.is_guided {
            let generations = self.text_alone(baselines.motions, baselines.network);
            return Ok(self.kept(generations));
        }
        self.with_sampling(Pass::Guided, |sampling| {
            self.second_pass(sampling, baselines, observer)
        })
    }

    /// Returns the baselines of an earlier run that are those of this one, if the model keeps them.
    fn cached_baselines(&self) -> Option<Baselines> {
        let kept = self.model.baseline_cache.get(&self.baseline_key()?)?;
        Some(Baselines {
            normalized: kept.normalized,
            network: vec![self.labelled(kept.network, 0)],
            motions: vec![self.labelled(kept.motion, 0)],
        })
    }

    fn first_pass(
        &self,
        sampling: &Sampling<'_, '_, D>,
        mut observer: StepObserver<'_>,
    ) -> Result<Baselines, Error> {
        let normalized = sampling
            .sampler
            .baseline(&sampling.batch, &mut observer)
            .map_err(|error| self.interrupted(error, &[]))?;
        let network = self.motions(&normalized, Pass::Baseline, &[])?;
        let motions = BodyFitter {
            run: self,
            rig: self.rig(Pass::Baseline),
            embedding: &sampling.batch.prompt.embedding,
            observer,
        }
        .baselines(&network, &normalized)?;
        if let (Some(key), [network], [motion]) = (self.baseline_key(), &network[..], &motions[..])
        {
            let kept = Baseline {
                normalized: normalized.clone(),
                network: network.clone(),
                motion: motion.clone(),
            };
            self.model.baseline_cache.insert(key, kept);
        }
        Ok(Baselines {
            normalized,
            network,
            motions,
        })
    }

    fn second_pass(
        &self,
        sampling: &Sampling<'_, '_, D>,
        baselines: Baselines,
        mut observer: StepObserver<'_>,
    ) -> Result<Vec<(usize, Generation)>, Error> {
        let Baselines {
            normalized,
            network: network_baselines,
            motions: baselines,
        } = baselines;
        let jobs = self.group.jobs.iter();
        let goals: Vec<Goals> = { jobs }
            .map(|job| job.goals.clone().unwrap_or_else(Goals::anything))
            .collect();
        let guided = sampling
            .sampler
            .guided(
                &sampling.batch,
                normalized,
                &goals,
                &self.group.guidance,
                &mut observer,
            )
            .map_err(|error| self.interrupted(error, &baselines))?;
        let network_guided = self.motions(&guided.motion, Pass::Guided, &baselines)?;
        let fitter = BodyFitter {
            run: self,
            rig: self.rig(Pass::Guided),
            embedding: &sampling.batch.prompt.embedding,
            observer,
        };
        let FinalMotions {
            motions,
            whole,
            parts,
            terms,
        } = { fitter }.guided(&network_guided, &baselines, &goals, &guided)?;

        let network_motions = network_baselines.into_iter().zip(network_guided);
        let motions = baselines.into_iter().zip(motions).zip(network_motions);
        let jobs = self.group.jobs.iter().zip(motions).enumerate();
        let generations = jobs.map(|(index, (job, ((baseline, motion), network)))| {
            let generation = Generation {
                sentences: self.sentences(job),
                cut_tokens: job.cut_tokens(),
                unseen_words: self.unseen_words(job.request),
                stand_in: self.stand_in(job.request),
                goals: goals[index].clone(),
                places: self.place_outcomes(&motion),
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
                steps: self.group.steps,
                loss: guided.loss.iter().map(|losses| losses[index]).collect(),
            };
            (job.request, generation)
        });
        Ok(self.kept(generations.collect()))
    }

    /// Measures the places of a motion, before what is known beside it is removed.
    fn place_outcomes(&self, motion: &Motion) -> Vec<PlaceOutcome> {
        let guidance = &self.group.guidance;
        guidance
            .places
            .outcomes_from(guidance.place_origin.as_ref(), motion)
    }

    /// Prepares a pass, and makes it.
    fn with_sampling<T>(
        &self,
        pass: Pass,
        run: impl FnOnce(&Sampling<'_, '_, D>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let LaMoGen {
            network,
            tokenizer,
            text_scale,
            ..
        } = self.model;
        let wordless = tokenizer.unconditional();
        let network = ClassifierFree::new(network, *text_scale, &wordless)
            .map_err(|error| self.interrupted(error, &[]))?;
        let lengths = self.group.is_looped.then(|| self.lengths());
        let network = Looped::new(&network, lengths.as_deref());
        let tiling = self.group.jobs.iter().find_map(|job| job.tiling.as_ref());
        let whole_network = &network;
        let network = Tiled::new(whole_network, tiling);
        let batch = self.batch(&network, pass);
        let batch = match batch.known.clone() {
            Some(known) => Batch {
                known: Some(self.with_noise(known, whole_network, &wordless)?),
                ..batch
            },
            None => batch,
        };
        let sampler = self.sampler(&network)?.with_loops(self.group.is_looped);
        run(&Sampling { sampler, batch })
    }

    /// Returns the fit to the body after a pass.
    fn rig(&self, pass: Pass) -> Rig<'a> {
        let device = self.model.network.device();
        Rig::new(&self.group.guidance, &device).with_start(self.held_frames(pass))
    }

    /// Returns all that the baseline of the batch depends on, if it is to be kept: a batch of one motion of a model that keeps
    /// baselines.
    fn baseline_key(&self) -> Option<BaselineKey> {
        let ([job], true) = (&self.group.jobs[..], self.model.baseline_cache.is_on()) else {
            return None;
        };
        Some(BaselineKey {
            sentences: { job.segments.iter() }
                .map(|segment| (segment.tokens.clone(), segment.frames))
                .collect(),
            start: { job.start_of(Pass::Baseline) }
                .map(|start| (start.features.clone(), start.rotations.clone())),
            end: job.end.clone(),
            frames: job.frames,
            seed: job.seed,
            steps: self.group.steps,
            is_looped: self.group.is_looped,
            body: self.group.guidance.body,
            fit: self.group.guidance.fit,
            text_scale: self.model.text_scale,
            temporal_smoothing: self.model.temporal_smoothing,
            sampling_method: self.model.sampling_method,
        })
    }

    /// Returns the motion of the text alone of a batch of one, without the known frames before and after it, where it goes on.
    pub(crate) fn kept_baseline(&self, motion: &Motion) -> Motion {
        let job = &self.group.jobs[0];
        match job.kept == (0..job.frames) {
            true => motion.clone(),
            false => kept_motion(motion, &job.kept, job.start_of(Pass::Baseline)),
        }
    }

    /// Removes the known frames before and after the motions.
    fn kept(&self, generations: Vec<(usize, Generation)>) -> Vec<(usize, Generation)> {
        let device = self.model.network.device();
        let jobs = generations.into_iter().zip(&self.group.jobs);
        jobs.map(|((request, generation), job)| {
            let frames = KeptFrames {
                frames: &job.kept,
                goals: self.group.reported_goals(job),
                starts: job.start.as_ref(),
                options: &self.group.guidance.laban,
                device: &device,
            };
            match job.kept == (0..job.frames) {
                true => (request, generation),
                false => (request, frames.of(generation)),
            }
        })
        .collect()
    }

    /// Returns the words of a request's sentences that occur in no caption that the model was trained on.
    pub(crate) fn unseen_words(&self, request: usize) -> Vec<String> {
        let Some(known) = &self.model.known_words else {
            return Vec::new();
        };
        let mut words = Vec::new();
        for sentence in self.requests[request].sentences() {
            for word in known.unknown_words(&sentence.prompt) {
                if !words.contains(&word) {
                    words.push(word);
                }
            }
        }
        words
    }

    /// Returns the sentence that replaced one of a request's, if one did.
    pub(crate) fn stand_in(&self, request: usize) -> Option<String> {
        let stand_in = |request: &Request| self.model.stand_in(&request.prompt);
        let sentence = self.requests[request].sentences().find_map(stand_in);
        sentence.map(str::to_owned)
    }

    /// Returns the sentences of a job with their frames.
    pub(crate) fn sentences(&self, job: &GenerationJob) -> Vec<GeneratedSentence> {
        let mut start = 0;
        let sentences = self.requests[job.request].sentences().zip(&job.segments);
        sentences
            .map(|(request, segment)| {
                let frames = start..start + segment.frames;
                start = frames.end;
                GeneratedSentence {
                    prompt: request.prompt.clone(),
                    frames,
                    goals: segment.goals.clone().unwrap_or_default(),
                }
            })
            .collect()
    }

    /// Returns the results of a batch without goals: the baseline is the guided motion too.
    fn text_alone(
        &self,
        motions: Vec<Motion>,
        network_motions: Vec<Motion>,
    ) -> Vec<(usize, Generation)> {
        let device = self.model.network.device();
        let options = &self.group.guidance.laban;
        let motions = motions.into_iter().zip(network_motions);
        let jobs = self.group.jobs.iter().zip(motions);
        jobs.map(|(job, (motion, network))| {
            let laban = LabanSeries::of(&motion, options, &device);
            let generation = Generation {
                sentences: self.sentences(job),
                cut_tokens: job.cut_tokens(),
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
                places: Vec::new(),
                steps: self.group.steps,
                loss: Vec::new(),
            };
            (job.request, generation)
        })
        .collect()
    }

    /// Encodes the prompts and draws the start noise, padded to the longest motion.
    fn batch<N: Denoiser>(&self, network: &N, pass: Pass) -> Batch<N::Context> {
        let device = network.device();
        let jobs = &self.group.jobs;
        let (size, features) = (jobs.len(), network.pose_features());
        let lengths = self.lengths();
        let frames = lengths.iter().copied().max().unwrap_or(0);
        // Windows are made whole, and what is beyond a motion's length is left out.
        let frames =
            { network.window() }.map_or(frames, |window| frames.next_multiple_of(window.frames));
        let tokens = jobs.iter().flat_map(|job| match &job.tiling {
            // A motion in tiles has a prompt for each.
            Some(tiling) => {
                let tiles = tiling.tiles().iter();
                tiles
                    .map(|tile| &job.segments[tile.sentence].tokens)
                    .collect()
            }
            None => vec![job.tokens_at(0)],
        });
        let tokens = TokenBatch::new(tokens, &device);
        let noise: Vec<f32> = jobs
            .iter()
            .flat_map(|job| noise(job.seed, frames, features))
            .collect();
        let noise = TensorData::new(noise, [size, frames, features]);
        Batch {
            prompt: network.encode(&tokens),
            noise: Tensor::from_data(noise, &device),
            lengths,
            step_noise: match self.model.sampling_method {
                SamplingMethod::Ddim => None,
                SamplingMethod::Ddpm => {
                    let seeds = jobs.iter().map(|job| job.seed).collect();
                    Some(StepNoise::Seeded(seeds))
                }
            },
            continuation: { network.window() }
                .map(|window| self.continuation(network, window, pass)),
            known: self.known_frames(pass),
        }
    }

    /// Returns the frames of a motion that are known before it is generated, if there are any. Such a motion runs alone.
    fn known_frames(&self, pass: Pass) -> Option<KnownFrames> {
        let job =
            { self.group.jobs.first() }.filter(|job| job.kept.start > 0 || !job.end.is_empty())?;
        let start = job.start_of(pass).map_or(&[][..], |start| &start.features);
        Some(KnownFrames::new(
            job.frames,
            start,
            &job.end,
            &self.model.normalization,
            &self.model.network.device(),
        ))
    }

    /// Makes the sampler of a network with the model's habits.
    fn sampler<'n, N: Denoiser>(&'n self, network: &'n N) -> Result<Sampler<'n, N>, Error> {
        Sampler::new(network, &self.model.normalization, self.group.steps)
            .and_then(|sampler| sampler.with_temporal_smoothing(self.model.temporal_smoothing))
            .map_err(|error| self.interrupted(error, &[]))
    }

    /// Adds to known frames the noise that the network makes them of, for a text without words.
    fn with_noise<N: Denoiser>(
        &self,
        known: KnownFrames,
        network: &N,
        wordless: &Tokens,
    ) -> Result<KnownFrames, Error> {
        let sampler = self.sampler(network)?;
        let device = self.model.network.device();
        let noisy = known.clips().map(|clip| {
            let clip = clip?;
            let batch = Batch {
                prompt: network.encode(&TokenBatch::new([wordless], &device)),
                noise: clip.zeros_like(),
                lengths: vec![clip.dims()[1]],
                step_noise: None,
                continuation: None,
                known: None,
            };
            Some(sampler.invert(&batch, &clip))
        });
        Ok(known.with_noise(noisy))
    }

    /// Returns the frames that a body's fit leaves as they are.
    fn held_frames(&self, pass: Pass) -> Option<Rotations> {
        let job = self.group.jobs.first().filter(|job| job.kept.start > 0)?;
        job.start_of(pass).map(|start| start.rotations.clone())
    }

    /// Encodes the sentences of further windows and the frames that the motions continue.
    fn continuation<N: Denoiser>(
        &self,
        network: &N,
        window: MotionWindow,
        pass: Pass,
    ) -> Continuation<N::Context> {
        let (jobs, device) = (&self.group.jobs, network.device());
        let windows = { jobs.iter() }
            .map(|job| match job.segments.len() {
                1 => 1,
                _ => job.frames.div_ceil(window.frames),
            })
            .max();
        let prompts = (1..windows.unwrap_or(1)).map(|place| {
            // The sentence of a window is that of its middle.
            let middle = place * window.frames + window.frames / 2;
            let tokens = jobs.iter().map(|job| job.tokens_at(middle));
            network.encode(&TokenBatch::new(tokens, &device))
        });
        let prefixes = jobs.iter().flat_map(|job| match job.start_of(pass) {
            Some(start) => start.features.clone(),
            None => standing(window.prefix),
        });
        let prefixes: Vec<f32> = prefixes.flatten().collect();
        let shape = [jobs.len(), window.prefix, network.pose_features()];
        let prefix = Tensor::from_data(TensorData::new(prefixes, shape), &device);
        Continuation {
            prefix: self.model.normalization.normalize(prefix),
            prompts: prompts.collect(),
        }
    }

    fn lengths(&self) -> Vec<usize> {
        self.group.jobs.iter().map(|job| job.frames).collect()
    }

    /// Decodes one motion of `normalized`, the pose features of the batch with shape `(motions, frames, features)`.
    fn motion(&self, normalized: &Tensor<3>, index: usize) -> Result<Motion, MotionError> {
        let [_, made, features] = normalized.dims();
        // A run that was stopped has not made all windows.
        let frames = self.group.jobs[index].frames.min(made);
        let rows = normalized.clone().narrow(0, index, 1).narrow(1, 0, frames);
        let rows = self.model.normalization.denormalize(rows);
        let mut motion = Motion::from_features(rows.reshape([frames, features]))?;
        if self.group.is_looped
            && let Some(rows) = motion.features()
        {
            let mut rows = rows.to_vec();
            let travel = close_path(&mut rows);
            motion = Motion::from_pose_features(rows)?.with_loop_travel(Some(travel));
        }
        Ok(self.labelled(motion, index))
    }

    /// Adds to a motion of the batch what its files contain beside it.
    fn labelled(&self, motion: Motion, index: usize) -> Motion {
        motion
            .with_copyright(self.copyright())
            .with_root_motion(self.group.jobs[index].root_motion)
    }

    /// Returns the terms under which the model's motions may be used, if they are known.
    fn copyright(&self) -> Option<String> {
        self.model.licence().map(Licence::notice)
    }

    /// Decodes all motions of `normalized`, the pose features of the batch. `baselines` are empty until the first pass
    /// is finished; they become part of an error.
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

    /// Makes motions of a rigid body from rotations of its joints.
    fn rigid_motions(
        &self,
        rotations: Vec<Rotations>,
        pass: Pass,
        baselines: &[Motion],
    ) -> Result<Vec<Motion>, Error> {
        let motions = rotations.into_iter().enumerate();
        let motions = motions.map(|(index, rotations)| {
            Motion::from_rotations(rotations)
                .map(|motion| self.labelled(motion, index))
                .map_err(|reason| self.failed(index, PassError::Motion { pass, reason }, baselines))
        });
        motions.collect()
    }

    /// Returns the Laban features of one motion of a batch; `features` have the shape `(motions, frames, 4)`.
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

    /// Returns the Laban features of the parts of the body for which a motion has goals.
    fn parts(
        &self,
        goals: &Goals,
        whole: &LabanComparison,
        parts: &[LabanComparison],
        index: usize,
    ) -> Vec<PartLaban> {
        let all = &self.group.guidance.laban.end_effectors;
        let part_terms = goals.terms(all).into_iter().skip(1);
        let part_features = part_terms.map(|term| {
            let mut parts = parts.iter();
            let part = parts.find(|part| part.end_effectors == term.end_effectors);
            let part = part.unwrap_or(whole);
            PartLaban {
                end_effectors: term.end_effectors,
                baseline: self.series(&part.baseline, index),
                target: self.series(&part.target, index),
                guided: self.series(&part.guided, index),
            }
        });
        part_features.collect()
    }

    /// Converts the error of a pass. `baselines` are empty until the first pass is finished.
    fn interrupted(&self, error: GuideError, baselines: &[Motion]) -> Error {
        match error {
            GuideError::Stopped(stopped) => {
                let position = (stopped.pass, stopped.index, stopped.steps);
                self.stopped(position, baselines, &stopped.loss, |index| {
                    self.motion(&stopped.prediction, index).ok()
                })
            }
            error => {
                let index = error.motion().unwrap_or(0);
                self.failed(index, error.into(), baselines)
            }
        }
    }

    /// Makes the error of a stopped pass. It contains the baselines, if they are finished, and the losses and the
    /// prediction of every motion.
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

    /// Makes the error of a pass that failed at one motion of the batch.
    fn failed(&self, index: usize, reason: PassError, baselines: &[Motion]) -> Error {
        Error::Failed(Box::new(FailedRun {
            which: RequestIndex::new(self.requests, self.group.jobs[index].request),
            reason,
            partial: self.partial(baselines),
        }))
    }

    /// Returns the partial results of this batch; those of earlier batches are added later.
    fn partial(&self, baselines: &[Motion]) -> PartialResults {
        let jobs = self.group.jobs.iter().enumerate();
        let unfinished = jobs.map(|(index, job)| UnfinishedRequest {
            request: job.request,
            baseline: baselines.get(index).cloned(),
            prediction: None,
            finished: None,
            loss: Vec::new(),
        });
        PartialResults {
            finished: Vec::new(),
            unfinished: unfinished.collect(),
        }
    }
}
