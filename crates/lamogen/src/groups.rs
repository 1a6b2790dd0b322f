//! Which requests run together.

use lamogen_guide::{Body, Guidance, Preset, Schedule};
use lamogen_laban::{Goals, Scale};
use lamogen_model::{Denoiser, Tokenizer};

use crate::error::RequestError;
use crate::request::Request;

/// A request that has been checked against a model.
#[derive(Clone, Debug)]
pub(crate) struct Job {
    /// Its place among the requests.
    pub(crate) request: usize,
    pub(crate) ids: Vec<u32>,
    pub(crate) cut: usize,
    pub(crate) frames: usize,
    pub(crate) seed: u64,
    /// `None` where nothing is asked for: the text alone.
    pub(crate) goals: Option<Goals>,
}

/// Jobs that are one batch: they agree in what all motions of a batch must share.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) steps: usize,
    pub(crate) guidance: Guidance,
    pub(crate) is_guided: bool,
    pub(crate) jobs: Vec<Job>,
}

impl Group {
    /// Whether its motions are those of a rigid body.
    pub(crate) fn is_rigid(&self) -> bool {
        self.guidance.body == Body::Rig
    }

    /// Steps that the group takes at most.
    pub(crate) fn cost(&self) -> usize {
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

/// The groups in parts of so many motions at most, those with the first requests first. Within a group motions of nearly the same length come
/// together, because what a batch pads is computed as well.
pub(crate) fn in_batches(groups: Vec<Group>, largest: usize) -> Vec<Group> {
    let parts = groups.into_iter().flat_map(|mut group| {
        if largest > 1 {
            group.jobs.sort_by_key(|job| job.frames);
        }
        let jobs = group.jobs.chunks(largest);
        let part = |jobs: &[Job]| Group {
            jobs: jobs.to_vec(),
            guidance: group.guidance.clone(),
            ..group
        };
        jobs.map(part).collect::<Vec<_>>()
    });
    let mut parts: Vec<Group> = parts.collect();
    parts.sort_by_key(|group| group.jobs.iter().map(|job| job.request).min());
    parts
}

/// Checks a request and assigns it to a group, a new one if it can join none. The model reads the sentence that stands in for the prompt, if one does.
pub(crate) fn assign(
    groups: &mut Vec<Group>,
    (index, request): (usize, &Request),
    stand_in: Option<&str>,
    model: &impl Denoiser,
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
    // Some texts are cleaned away, such as "&nbsp;".
    if tokens.own == 0 {
        return Err(RequestError::EmptyPrompt);
    }
    let tokens = stand_in.map_or(Ok(tokens), |sentence| tokenizer.encode(sentence))?;
    let frames = request
        .length
        .frames(model.min_frames(), model.max_frames())?;
    if let Some(goals) = &goals {
        goals.check(frames, &guidance.laban.end_effectors)?;
    }
    let is_guided = goals.is_some() || !guidance.loss_terms.is_empty();
    let job = Job {
        request: index,
        ids: tokens.ids,
        cut: tokens.cut,
        frames,
        seed: request.seed,
        goals,
    };
    let joins = |group: &&mut Group| {
        group.steps == steps && group.is_guided == is_guided && group.guidance == guidance
    };
    match groups.iter_mut().find(joins) {
        Some(group) => group.jobs.push(job),
        None => groups.push(Group {
            steps,
            guidance,
            is_guided,
            jobs: vec![job],
        }),
    }
    Ok(())
}
