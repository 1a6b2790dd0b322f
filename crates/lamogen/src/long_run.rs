//! Running one long motion, a stretch at a time, so that the memory that is needed does not grow with its length.
//!
//! ```text
//! stretches ──first pass, each from the end of the one before──▶ the motion of the text alone ──▶ peaks and means as factors
//!           ──second pass, each from the end of the one before──▶ the guided motion
//! ```

use std::ops::{ControlFlow, Range};

use lamogen_guide::{Itinerary, Step};
use lamogen_laban::{EndEffectors, Goals, LabanSeries};
use lamogen_model::Denoiser;
use lamogen_motion::Motion;

use crate::error::{Error, FinishedStretches, RequestIndex, UnfinishedRequest};
use crate::generation::{GeneratedSentence, Generation, LaMoGen, NetworkMotions, PartLaban};
use crate::groups::{JobGroup, requested_goals};
use crate::neighbours::StretchEnd;
use crate::request::Request;
use crate::run::{Baselines, BatchRun};
use crate::stretches::{
    Section, Sentence, ahead, itinerary, joined, section_places, stretch_request,
};

/// The largest number of frames of a stretch: fifteen seconds. Longer motions of a rigid body are made in stretches.
pub(crate) const LONGEST_STRETCH: usize = 300;

/// The run of a model on a request of a long motion.
pub(crate) struct LongRun<'a, D> {
    model: &'a LaMoGen<D>,
    group: &'a JobGroup,
    requests: &'a [Request],
    /// The place of the request.
    index: usize,
    stretches: Vec<Vec<Section>>,
    itinerary: Itinerary,
}

impl<'a, D: Denoiser> LongRun<'a, D> {
    /// Returns the run of a group of one long motion; `None` for all other groups.
    pub(crate) fn new(
        model: &'a LaMoGen<D>,
        group: &'a JobGroup,
        requests: &'a [Request],
    ) -> Option<Self> {
        let [job] = &group.jobs[..] else { return None };
        if !group.is_stretched() {
            return None;
        }
        let places = group.guidance.places.clone();
        let itinerary = itinerary(&requests[job.request], places);
        Some(LongRun {
            model,
            group,
            requests,
            index: job.request,
            stretches: group.stretches(&itinerary),
            itinerary,
        })
    }

    /// Generates the motion.
    pub(crate) fn generation(
        &self,
        observer: &mut dyn FnMut(&Step<'_>) -> ControlFlow<()>,
    ) -> Result<Generation, Error> {
        let mut sentences = self.sentences();
        let text_alone: Vec<Sentence> = { sentences.iter().cloned() }
            .map(|sentence| Sentence {
                goals: None,
                ..sentence
            })
            .collect();
        let mut baselines: Vec<Baselines> = Vec::new();
        let mut baseline: Vec<Motion> = Vec::new();
        for stretch in 0..self.stretches.len() {
            let end = { baseline.last() }.map(|motion| StretchEnd::of(motion, motion, false));
            let made = self.with_stretch((stretch, None), &text_alone, end, |run| {
                let made = run.baselines(observer)?;
                let motion = run.kept_baseline(&made.motions[0]);
                Ok((made, motion))
            });
            let (made, motion) = made.map_err(|error| self.unfinished(error, None, &baseline))?;
            baselines.push(made);
            baseline.push(motion);
        }
        let whole = joined(&baseline);
        let measured = self.series(&whole, None);
        let mut start = 0;
        for sentence in &mut sentences {
            let section = measured.section(start..start + sentence.frames);
            start += sentence.frames;
            sentence.goals = { sentence.goals.take() }.map(|goals| goals.for_baseline(&section));
        }
        let mut made: Vec<Generation> = Vec::new();
        for (stretch, baselines) in baselines.into_iter().enumerate() {
            let end = made.last().map(|before| {
                let changes_goals = self.changes_goals(stretch, &sentences);
                StretchEnd::of(&before.baseline, &before.guided, changes_goals)
            });
            let itinerary = Some(&self.itinerary);
            let generation = self.with_stretch((stretch, itinerary), &sentences, end, |run| {
                run.generations_from(baselines, observer)
            });
            let generation = generation.map_err(|error| {
                let guided: Vec<Motion> = made.iter().map(|made| made.guided.clone()).collect();
                self.unfinished(error, Some(&whole), &guided)
            })?;
            made.extend(generation.into_iter().map(|(_, generation)| generation));
        }
        Ok(self.joined(whole, measured, made))
    }

    /// Returns the sentences of the motion. If any has goals, all have: a sentence without any keeps the motion of the text. If none
    /// has, places ask for nothing of the components.
    fn sentences(&self) -> Vec<Sentence> {
        let request = &self.requests[self.index];
        let job = &self.group.jobs[0];
        let goals = |request: &Request| {
            let goals = requested_goals(request).expect("goals of a checked request");
            let others = match job.goals {
                Some(_) => Goals::default(),
                None => Goals::anything(),
            };
            self.group.is_guided.then(|| goals.unwrap_or(others))
        };
        { request.sentences().zip(&job.segments) }
            .map(|(request, segment)| Sentence {
                prompt: request.prompt.clone(),
                frames: segment.frames,
                goals: goals(request),
            })
            .collect()
    }

    /// Returns the sentences of the first frames of the motion.
    fn sentences_until(&self, end: usize) -> Vec<GeneratedSentence> {
        let run = BatchRun::new(self.model, self.group, self.requests);
        let mut sentences = run.sentences(&self.group.jobs[0]);
        sentences.retain(|sentence| sentence.frames.start < end);
        for sentence in &mut sentences {
            sentence.frames.end = sentence.frames.end.min(end);
        }
        sentences
    }

    /// Returns whether the goals of a stretch differ from those of the one before.
    fn changes_goals(&self, stretch: usize, sentences: &[Sentence]) -> bool {
        let sentence = |section: Option<&Section>| section.map(|section| section.sentence);
        let before = sentence(self.stretches[stretch - 1].last());
        let own = sentence(self.stretches[stretch].first());
        let goals = |sentence: Option<usize>| sentence.map(|place| &sentences[place].goals);
        before != own && goals(before) != goals(own)
    }

    /// Returns the number of frames of the motion.
    fn length(&self) -> usize {
        self.group.jobs[0].kept.len()
    }

    /// Returns the frames of a stretch among those of the motion.
    fn frames(&self, stretch: usize) -> Range<usize> {
        let length = |stretch: &Vec<Section>| -> usize {
            stretch.iter().map(|section| section.frames.len()).sum()
        };
        let start = self.stretches[..stretch].iter().map(length).sum();
        start..start + length(&self.stretches[stretch])
    }

    /// Runs a part of the generation of a stretch; with an itinerary, through its places.
    fn with_stretch<T>(
        &self,
        (stretch, itinerary): (usize, Option<&Itinerary>),
        sentences: &[Sentence],
        end: Option<StretchEnd>,
        run: impl FnOnce(&BatchRun<'_, D>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let sections = &self.stretches[stretch];
        let requests =
            { sections.iter() }.map(|section| section.request(&sentences[section.sentence]));
        let options = &self.requests[self.index];
        let mut request = stretch_request(options, requests, stretch, end).steps(self.group.steps);
        match stretch + 1 == self.stretches.len() {
            true => request.before = options.before.clone(),
            false => request.ahead = ahead(self.group.is_guided),
        }
        if let Some(itinerary) = itinerary {
            let frames = (&self.frames(stretch), self.length());
            request.places = section_places(itinerary, frames, &request);
        }
        let requests = [request];
        let groups = self.model.groups(&requests)?;
        run(&BatchRun::new(self.model, &groups[0], &requests))
    }

    /// Turns the error of a stretch into that of the whole motion. `finished` are the stretches of the pass before it, which is
    /// the guided pass if there is a baseline.
    fn unfinished(
        &self,
        mut error: Error,
        baseline: Option<&Motion>,
        finished: &[Motion],
    ) -> Error {
        let which = RequestIndex::new(self.requests, self.index);
        let is_guided = baseline.is_some() && self.group.is_guided && !finished.is_empty();
        let motion = match finished {
            [] => baseline.cloned(),
            finished => Some(joined(finished)),
        };
        let stretches = motion.map(|motion| FinishedStretches {
            sentences: self.sentences_until(motion.frames()),
            is_guided,
            motion,
        });
        let unfinished = |loss| UnfinishedRequest {
            request: self.index,
            baseline: baseline.cloned(),
            prediction: None,
            finished: stretches.clone(),
            loss,
        };
        match &mut error {
            Error::Stopped(stopped) => {
                let running = stopped.partial.unfinished.pop();
                let loss = running.map(|running| running.loss).unwrap_or_default();
                stopped.partial.unfinished.push(unfinished(loss));
            }
            Error::Failed(failed) => {
                failed.which = which;
                failed.partial.unfinished = vec![unfinished(Vec::new())];
            }
            Error::Request { which: place, .. } => *place = which,
        }
        error
    }

    /// Joins the stretches. The features of the whole motion are measured as those of a file would be.
    fn joined(
        &self,
        baseline: Motion,
        baseline_laban: LabanSeries,
        made: Vec<Generation>,
    ) -> Generation {
        let job = &self.group.jobs[0];
        let run = BatchRun::new(self.model, self.group, self.requests);
        let motions = |motion: fn(&Generation) -> &Motion| -> Motion {
            let stretches: Vec<Motion> = made.iter().map(|made| motion(made).clone()).collect();
            joined(&stretches)
        };
        let guided = motions(|made| &made.guided);
        let length = self.length();
        let places = self.itinerary.outcomes(&(0..length), length, &guided);
        let targets = |target: &dyn Fn(&Generation) -> LabanSeries| -> LabanSeries {
            let frames = made.iter().flat_map(|made| target(made).frames().to_vec());
            LabanSeries::from_frames(frames.collect())
        };
        let goals = self.group.reported_goals(job);
        let terms = goals.terms(&self.group.guidance.laban.end_effectors);
        let parts = terms.into_iter().skip(1).map(|term| {
            let set = &term.end_effectors;
            let of_set = |part: &&PartLaban| part.end_effectors == *set;
            PartLaban {
                baseline: self.series(&baseline, Some(set)),
                target: targets(&|made| match made.parts.iter().find(of_set) {
                    Some(part) => part.target.clone(),
                    // Sentences without goals for these joints leave them free.
                    None => self.series(&made.baseline, Some(set)),
                }),
                guided: self.series(&guided, Some(set)),
                end_effectors: term.end_effectors,
            }
        });
        Generation {
            sentences: run.sentences(job),
            cut_tokens: job.cut_tokens(),
            unseen_words: run.unseen_words(self.index),
            stand_in: run.stand_in(self.index),
            parts: parts.collect(),
            goals,
            network: NetworkMotions {
                baseline: motions(|made| &made.network.baseline),
                guided: motions(|made| &made.network.guided),
            },
            target: targets(&|made| made.target.clone()),
            guided_laban: self.series(&guided, None),
            baseline_laban,
            guided,
            baseline,
            terms: Vec::new(),
            places,
            steps: self.group.steps,
            loss: mean_loss(&made),
        }
    }

    /// Measures a motion, as a whole or at some of its joints.
    fn series(&self, motion: &Motion, end_effectors: Option<&EndEffectors>) -> LabanSeries {
        let options = &self.group.guidance.laban;
        let options = match end_effectors {
            Some(set) => &options.with_end_effectors(set.clone()),
            None => options,
        };
        LabanSeries::of(motion, options, &self.model.network().device())
    }
}

/// Returns the loss of each step of the guided pass, as the mean over frames of all stretches.
fn mean_loss(made: &[Generation]) -> Vec<f32> {
    let steps = made.iter().map(|made| made.loss.len()).min().unwrap_or(0);
    let frames: f32 = made.iter().map(|made| made.guided.frames() as f32).sum();
    let at = |step: usize| {
        let losses = { made.iter() }.map(|made| made.loss[step] * made.guided.frames() as f32);
        losses.sum::<f32>() / frames
    };
    (0..steps).map(at).collect()
}
