//! Checking requests, and grouping them into batches.

use std::ops::RangeInclusive;
use std::sync::Arc;

use lamogen_guide::{Body, Guidance, Preset, Schedule, Tiling, longest_loop};
use lamogen_laban::{EndEffectors, Goals, Scale};
use lamogen_model::{Denoiser, MotionWindow, Tokenizer, Tokens};
use lamogen_motion::{POSE_FEATURES, RootMotion};

use crate::error::RequestError;
use crate::request::Request;

/// A request that has been checked against a model.
#[derive(Clone, Debug)]
pub(crate) struct GenerationJob {
    /// The place among the requests, from 0.
    pub(crate) request: usize,
    /// The sentences, one after another.
    pub(crate) segments: Vec<JobSegment>,
    /// How a motion of several sentences, or one longer than the model's longest, is cut into tiles. Such a job runs alone.
    /// `None` for all others.
    pub(crate) tiling: Option<Tiling>,
    /// The pose features of the frames before the motion, if the model reads such frames and the request has them.
    pub(crate) prefix: Option<Arc<[[f32; POSE_FEATURES]]>>,
    pub(crate) frames: usize,
    pub(crate) seed: u64,
    /// `None` where the motion of the text alone is requested.
    pub(crate) goals: Option<Goals>,
    pub(crate) root_motion: RootMotion,
}

/// A sentence of a motion.
#[derive(Clone, Debug)]
pub(crate) struct JobSegment {
    /// The tokens of the sentence that the model reads.
    pub(crate) tokens: Tokens,
    /// The number of frames for which the sentence holds.
    pub(crate) frames: usize,
}

impl GenerationJob {
    /// Returns the number of tokens of all sentences that did not fit the model.
    pub(crate) fn cut_tokens(&self) -> usize {
        self.segments.iter().map(|segment| segment.tokens.cut).sum()
    }

    /// Returns the tokens of the sentence at a frame; past the end of the motion, of the last one.
    pub(crate) fn tokens_at(&self, frame: usize) -> &Tokens {
        let mut end = 0;
        let segment = self.segments.iter().find(|segment| {
            end += segment.frames;
            frame < end
        });
        let segment = segment.or(self.segments.last());
        &segment.expect("a job has a sentence").tokens
    }
}

/// Jobs that can run as one batch: they agree in the options that all motions of a batch must share.
#[derive(Clone, Debug)]
pub(crate) struct JobGroup {
    pub(crate) steps: usize,
    pub(crate) guidance: Guidance,
    pub(crate) is_guided: bool,
    pub(crate) is_looped: bool,
    pub(crate) jobs: Vec<GenerationJob>,
}

impl JobGroup {
    /// Whether the motions are those of a rigid body.
    pub(crate) fn is_rigid(&self) -> bool {
        self.guidance.body == Body::Rig
    }

    /// Returns the largest number of steps that the group can take with a model that has such windows.
    pub(crate) fn max_steps(&self, window: Option<MotionWindow>) -> usize {
        let frames = self.jobs.iter().map(|job| job.frames).max().unwrap_or(0);
        let windows = window.map_or(1, |window| frames.div_ceil(window.frames));
        let steps = self.steps * windows;
        let guided = match self.is_guided {
            true => self.guidance.steps(steps),
            false => 0,
        };
        let fits = match (self.is_rigid(), self.is_guided) {
            (false, _) => 0,
            (true, false) => self.guidance.fit.allowed(false),
            (true, true) => self.guidance.fit.allowed(false) + self.guidance.fit.allowed(true),
        };
        steps + guided + fits
    }
}

/// Splits groups into batches of at most `batch_size` motions, and sorts the batches by their first request.
///
/// Motions of similar length share a batch, because the frames that pad a shorter motion are computed too.
pub(crate) fn split_into_batches(groups: Vec<JobGroup>, batch_size: usize) -> Vec<JobGroup> {
    let batches = groups.into_iter().flat_map(|mut group| {
        if batch_size > 1 {
            group.jobs.sort_by_key(|job| job.frames);
        }
        let (tiled, whole): (Vec<_>, Vec<_>) =
            { group.jobs.into_iter() }.partition(|job| job.tiling.is_some());
        let jobs = whole.chunks(batch_size).chain(tiled.chunks(1));
        let batch = |jobs: &[GenerationJob]| JobGroup {
            jobs: jobs.to_vec(),
            guidance: group.guidance.clone(),
            steps: group.steps,
            is_guided: group.is_guided,
            is_looped: group.is_looped,
        };
        jobs.map(batch).collect::<Vec<_>>()
    });
    let mut batches: Vec<JobGroup> = batches.collect();
    batches.sort_by_key(|batch| batch.jobs.iter().map(|job| job.request).min());
    batches
}

/// Checks the length of a sentence.
fn check_prompt(prompt: &str) -> Result<(), RequestError> {
    if prompt.trim().is_empty() {
        return Err(RequestError::EmptyPrompt);
    }
    match prompt.chars().count() {
        ..=Request::LONGEST_PROMPT => Ok(()),
        found => Err(RequestError::LongPrompt { found }),
    }
}

/// Encodes a sentence, which must have tokens of its own.
fn encode(tokenizer: &Tokenizer, prompt: &str) -> Result<Tokens, RequestError> {
    let tokens = tokenizer.encode(prompt)?;
    // The tokenizer removes some texts entirely, such as "&nbsp;".
    match tokens.own {
        0 => Err(RequestError::EmptyPrompt),
        _ => Ok(tokens),
    }
}

/// Checks whether a model with such windows can continue a motion as a request asks for.
fn check_continuation(request: &Request, window: Option<MotionWindow>) -> Result<(), RequestError> {
    match (window, &request.prefix) {
        (None, Some(_)) => Err(RequestError::NoWindows {
            what: "a motion to continue",
        }),
        (Some(window), Some(prefix)) if prefix.len() < window.prefix => Err(RequestError::Prefix {
            expected: window.prefix,
            found: prefix.len(),
        }),
        _ => Ok(()),
    }
}

/// Returns the goals that a request states, if it does.
fn requested_goals(request: &Request) -> Result<Option<Goals>, RequestError> {
    let goals = match (&request.tags[..], &request.goals) {
        ([], goals) => goals.clone(),
        (tags, None) => Some(Scale::from_tags(tags)?.into()),
        (_, Some(_)) => return Err(RequestError::TagsAndScale),
    };
    Ok(match &request.parts[..] {
        [] => goals,
        parts => {
            let goals = goals.unwrap_or_default();
            Some(parts.iter().cloned().fold(goals, Goals::with_part))
        }
    })
}

/// Joins the goals of sentences, each with its number of frames. A sentence without goals beside others keeps the motion of the
/// text as it is. Returns `None` if none has goals.
fn joined_goals(goals: Vec<Option<Goals>>, segments: &[JobSegment]) -> Option<Goals> {
    if goals.iter().all(Option::is_none) {
        return None;
    }
    let mut start = 0;
    let starts = segments.iter().map(|segment| {
        start += segment.frames;
        start - segment.frames
    });
    let goals = goals.into_iter().map(Option::unwrap_or_default).zip(starts);
    goals
        .reduce(|(joined, _), (goals, start)| (joined.then(start, goals), 0))
        .map(|(goals, _)| goals)
}

/// Returns the number of steps that a preset makes with a model: its own, or all timesteps of a model that has fewer.
pub(crate) fn default_steps(preset: Preset, model: &impl Denoiser) -> usize {
    preset.steps().min(model.noise_schedule().timesteps())
}

/// What the sentences of a request are checked by.
struct RequestedSentences<'a> {
    /// The lengths that a sentence may have, in frames.
    lengths: RangeInclusive<usize>,
    /// The end-effectors of the whole body.
    all: &'a EndEffectors,
    tokenizer: &'a Tokenizer,
    stand_in: &'a dyn Fn(&str) -> Option<String>,
}

impl RequestedSentences<'_> {
    /// Checks a sentence with its length and its goals.
    fn check(&self, request: &Request) -> Result<(JobSegment, Option<Goals>), RequestError> {
        check_prompt(&request.prompt)?;
        let tokens = encode(self.tokenizer, &request.prompt)?;
        let stand_in = (self.stand_in)(&request.prompt);
        let tokens = stand_in.map_or(Ok(tokens), |sentence| self.tokenizer.encode(&sentence))?;
        let frames = { request.length }.frames(*self.lengths.start(), *self.lengths.end())?;
        let goals = requested_goals(request)?;
        if let Some(goals) = &goals {
            goals.check(frames, self.all)?;
        }
        Ok((JobSegment { tokens, frames }, goals))
    }
}

/// Returns the lengths that the sentences of a request may have, in frames. `lengths` are those of the model's motions.
fn segment_lengths(
    request: &Request,
    (model, lengths): (&impl Denoiser, &RangeInclusive<usize>),
) -> RangeInclusive<usize> {
    let (shortest, longest) = (*lengths.start(), *lengths.end());
    match (request.is_looped, model.window()) {
        (true, _) => shortest..=longest_loop(longest),
        (false, Some(_)) => shortest..=longest,
        // Tiles make a motion of any length.
        (false, None) if request.following.is_empty() => shortest..=Request::LONGEST_MOTION,
        (false, None) => shortest.max(Tiling::shortest(longest))..=Request::LONGEST_MOTION,
    }
}

/// Checks a request and adds it to the group that has the same options, or to a new one. If there is a sentence that
/// stands in for a prompt, the model reads that sentence. `lengths` are those of motions in frames.
pub(crate) fn assign_to_group(
    groups: &mut Vec<JobGroup>,
    (index, request): (usize, &Request),
    stand_in: &dyn Fn(&str) -> Option<String>,
    (model, lengths): (&impl Denoiser, &RangeInclusive<usize>),
    tokenizer: &Tokenizer,
    default: Preset,
) -> Result<(), RequestError> {
    let preset = request.preset.unwrap_or(default);
    let steps = request.steps.unwrap_or(default_steps(preset, model));
    Schedule::new(model.noise_schedule()).ddim(steps)?;
    let mut guidance = request.guidance.clone().unwrap_or(preset.guidance());
    let terms = guidance.loss_terms.iter().chain(request.loss_terms.iter());
    guidance.loss_terms = terms.cloned().collect();
    guidance.check()?;
    check_continuation(request, model.window())?;
    let is_looped = request.is_looped;
    if is_looped && model.window().is_some() {
        return Err(RequestError::LoopOfWindows);
    }
    if is_looped && !request.following.is_empty() {
        return Err(RequestError::LoopOfSentences);
    }
    let sentences = RequestedSentences {
        lengths: segment_lengths(request, (model, lengths)),
        all: &guidance.laban.end_effectors,
        tokenizer,
        stand_in,
    };
    let mut segments = Vec::new();
    let mut goals = Vec::new();
    for (place, segment) in request.sentences().enumerate() {
        let checked = match place {
            0 => sentences.check(segment),
            _ if !segment.is_segment() => Err(RequestError::SegmentOptions),
            _ => sentences.check(segment),
        };
        let (job_segment, segment_goals) = match (checked, request.following.is_empty()) {
            (Err(reason), false) => {
                return Err(RequestError::Segment {
                    place: place + 1,
                    reason: Box::new(reason),
                });
            }
            (checked, _) => checked?,
        };
        segments.push(job_segment);
        goals.push(segment_goals);
    }
    let frames = segments.iter().map(|segment| segment.frames).sum();
    if frames > Request::LONGEST_MOTION {
        return Err(RequestError::LongMotion { found: frames });
    }
    let goals = joined_goals(goals, &segments);
    let tiling = (model.window().is_none() && !is_looped).then(|| {
        let frames: Vec<usize> = segments.iter().map(|segment| segment.frames).collect();
        Tiling::new(&frames, *lengths.end())
    });
    let tiling = tiling.filter(|tiling| !tiling.is_whole());
    let is_guided = goals.is_some() || !guidance.loss_terms.is_empty();
    let job = GenerationJob {
        request: index,
        segments,
        tiling,
        prefix: request.prefix.clone(),
        frames,
        seed: request.seed,
        goals,
        root_motion: request.root_motion,
    };
    let has_same_options = |group: &&mut JobGroup| {
        group.steps == steps
            && group.is_guided == is_guided
            && group.is_looped == is_looped
            && group.guidance == guidance
    };
    match groups.iter_mut().find(has_same_options) {
        Some(group) => group.jobs.push(job),
        None => groups.push(JobGroup {
            steps,
            guidance,
            is_guided,
            is_looped,
            jobs: vec![job],
        }),
    }
    Ok(())
}
