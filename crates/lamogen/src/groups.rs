//! Checking requests, and grouping them into batches.

use std::ops::RangeInclusive;
use std::sync::Arc;

use lamogen_guide::{Body, Guidance, Preset, Schedule, longest_loop};
use lamogen_laban::{Goals, Scale};
use lamogen_model::{Denoiser, MotionWindow, Tokenizer, Tokens};
use lamogen_motion::{POSE_FEATURES, RootMotion};

use crate::error::RequestError;
use crate::request::Request;

/// A request that has been checked against a model.
#[derive(Clone, Debug)]
pub(crate) struct GenerationJob {
    /// The place among the requests, from 0.
    pub(crate) request: usize,
    /// The tokens of the sentence that the model reads.
    pub(crate) tokens: Tokens,
    /// The tokens of the sentences of further windows.
    pub(crate) further_tokens: Vec<Tokens>,
    /// The pose features of the frames before the motion, if the model reads such frames and the request has them.
    pub(crate) prefix: Option<Arc<[[f32; POSE_FEATURES]]>>,
    pub(crate) frames: usize,
    pub(crate) seed: u64,
    /// `None` where the motion of the text alone is requested.
    pub(crate) goals: Option<Goals>,
    pub(crate) root_motion: RootMotion,
}

impl GenerationJob {
    /// Returns the number of tokens of all sentences that did not fit the model.
    pub(crate) fn cut_tokens(&self) -> usize {
        let further = self.further_tokens.iter().map(|tokens| tokens.cut);
        self.tokens.cut + further.sum::<usize>()
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
        let jobs = group.jobs.chunks(batch_size);
        let batch = |jobs: &[GenerationJob]| JobGroup {
            jobs: jobs.to_vec(),
            guidance: group.guidance.clone(),
            ..group
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

/// Checks whether a model with such windows can continue a motion and change its sentence as a request asks for.
fn check_continuation(request: &Request, window: Option<MotionWindow>) -> Result<(), RequestError> {
    match (window, &request.prefix) {
        (None, Some(_)) => Err(RequestError::NoWindows {
            what: "a motion to continue",
        }),
        (None, None) if !request.further_prompts.is_empty() => Err(RequestError::NoWindows {
            what: "a second sentence",
        }),
        (Some(window), Some(prefix)) if prefix.len() < window.prefix => Err(RequestError::Prefix {
            expected: window.prefix,
            found: prefix.len(),
        }),
        _ => Ok(()),
    }
}

/// Returns the number of steps that a preset makes with a model: its own, or all timesteps of a model that has fewer.
pub(crate) fn default_steps(preset: Preset, model: &impl Denoiser) -> usize {
    preset.steps().min(model.noise_schedule().timesteps())
}

/// Checks a request and adds it to the group that has the same options, or to a new one. If there is a sentence that
/// stands in for the prompt, the model reads that sentence. `lengths` are those of motions in frames.
pub(crate) fn assign_to_group(
    groups: &mut Vec<JobGroup>,
    (index, request): (usize, &Request),
    stand_in: Option<&str>,
    (model, lengths): (&impl Denoiser, &RangeInclusive<usize>),
    tokenizer: &Tokenizer,
    default: Preset,
) -> Result<(), RequestError> {
    check_prompt(&request.prompt)?;
    let goals = match (&request.tags[..], &request.goals) {
        ([], goals) => goals.clone(),
        (tags, None) => Some(Scale::from_tags(tags)?.into()),
        (_, Some(_)) => return Err(RequestError::TagsAndScale),
    };
    let goals = match &request.parts[..] {
        [] => goals,
        parts => {
            let goals = goals.unwrap_or_default();
            Some(parts.iter().cloned().fold(goals, Goals::with_part))
        }
    };
    let preset = request.preset.unwrap_or(default);
    let steps = request.steps.unwrap_or(default_steps(preset, model));
    Schedule::new(model.noise_schedule()).ddim(steps)?;
    let mut guidance = request.guidance.clone().unwrap_or(preset.guidance());
    let terms = guidance.loss_terms.iter().chain(request.loss_terms.iter());
    guidance.loss_terms = terms.cloned().collect();
    if !request.places.is_empty() {
        guidance.places = request.places.clone();
    }
    guidance.check()?;
    let tokens = encode(tokenizer, &request.prompt)?;
    let further_tokens = { request.further_prompts.iter() }
        .map(|prompt| check_prompt(prompt).and_then(|()| encode(tokenizer, prompt)))
        .collect::<Result<_, _>>()?;
    check_continuation(request, model.window())?;
    let tokens = stand_in.map_or(Ok(tokens), |sentence| tokenizer.encode(sentence))?;
    let is_looped = request.is_looped;
    if is_looped && model.window().is_some() {
        return Err(RequestError::LoopOfWindows);
    }
    let longest = match is_looped {
        true => longest_loop(*lengths.end()),
        false => *lengths.end(),
    };
    let frames = request.length.frames(*lengths.start(), longest)?;
    if let Some(goals) = &goals {
        goals.check(frames, &guidance.laban.end_effectors)?;
    }
    guidance.places.check(frames)?;
    if is_looped && guidance.places.path.is_some() {
        return Err(RequestError::PathOfLoop);
    }
    let is_guided =
        goals.is_some() || !guidance.loss_terms.is_empty() || !guidance.places.is_empty();
    let job = GenerationJob {
        request: index,
        tokens,
        further_tokens,
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
            // A place at the end of a motion is at another frame of a longer one.
            && (guidance.places.is_empty() || group.jobs[0].frames == frames)
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
