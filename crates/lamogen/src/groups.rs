//! Checking requests, and grouping them into batches.

use std::ops::RangeInclusive;

use lamogen_guide::{Body, Guidance, Preset, Schedule, longest_loop};
use lamogen_laban::{Goals, Scale};
use lamogen_model::Tokenizer;
use lamogen_motion::RootMotion;

use crate::error::RequestError;
use crate::request::Request;

/// A request that has been checked against a model.
#[derive(Clone, Debug)]
pub(crate) struct GenerationJob {
    /// The place among the requests, from 0.
    pub(crate) request: usize,
    /// The token ids of the sentence that the model reads.
    pub(crate) ids: Vec<u32>,
    /// The number of tokens that did not fit the model.
    pub(crate) cut_tokens: usize,
    pub(crate) frames: usize,
    pub(crate) seed: u64,
    /// `None` where the motion of the text alone is requested.
    pub(crate) goals: Option<Goals>,
    pub(crate) root_motion: RootMotion,
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

    /// Returns the largest number of steps that the group can take.
    pub(crate) fn max_steps(&self) -> usize {
        let guided = match self.is_guided {
            true => self.guidance.steps(self.steps),
            false => 0,
        };
        let fits = match (self.is_rigid(), self.is_guided) {
            (false, _) => 0,
            (true, false) => self.guidance.fit.allowed(false),
            (true, true) => self.guidance.fit.allowed(false) + self.guidance.fit.allowed(true),
        };
        self.steps + guided + fits
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

/// Checks a request and adds it to the group that has the same options, or to a new one. If there is a sentence that
/// stands in for the prompt, the model reads that sentence. `lengths` are those of motions in frames.
pub(crate) fn assign_to_group(
    groups: &mut Vec<JobGroup>,
    (index, request): (usize, &Request),
    stand_in: Option<&str>,
    lengths: &RangeInclusive<usize>,
    tokenizer: &Tokenizer,
    default: Preset,
) -> Result<(), RequestError> {
    if request.prompt.trim().is_empty() {
        return Err(RequestError::EmptyPrompt);
    }
    let found = request.prompt.chars().count();
    if found > Request::LONGEST_PROMPT {
        return Err(RequestError::LongPrompt { found });
    }
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
    let steps = request.steps.unwrap_or(preset.steps());
    Schedule::linear().ddim(steps)?;
    let mut guidance = request.guidance.clone().unwrap_or(preset.guidance());
    let terms = guidance.loss_terms.iter().chain(request.loss_terms.iter());
    guidance.loss_terms = terms.cloned().collect();
    guidance.check()?;
    let tokens = tokenizer.encode(&request.prompt)?;
    // The tokenizer removes some texts entirely, such as "&nbsp;".
    if tokens.own == 0 {
        return Err(RequestError::EmptyPrompt);
    }
    let tokens = stand_in.map_or(Ok(tokens), |sentence| tokenizer.encode(sentence))?;
    let is_looped = request.is_looped;
    let longest = match is_looped {
        true => longest_loop(*lengths.end()),
        false => *lengths.end(),
    };
    let frames = request.length.frames(*lengths.start(), longest)?;
    if let Some(goals) = &goals {
        goals.check(frames, &guidance.laban.end_effectors)?;
    }
    let is_guided = goals.is_some() || !guidance.loss_terms.is_empty();
    let job = GenerationJob {
        request: index,
        ids: tokens.ids,
        cut_tokens: tokens.cut,
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
