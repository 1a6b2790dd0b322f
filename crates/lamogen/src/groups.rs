//! Checking requests, and grouping them into batches.

use std::ops::{Range, RangeInclusive};

use lamogen_guide::{
    Body, Guidance, Itinerary, Pass, PlaceOrigin, Preset, Schedule, Tiling, longest_loop,
};
use lamogen_laban::{EndEffectors, Goals, Scale};
use lamogen_model::{Denoiser, MotionWindow, Tokenizer, Tokens};
use lamogen_motion::{POSE_FEATURES, RootMotion};

use crate::error::RequestError;
use crate::long_run::LONGEST_STRETCH;
use crate::neighbours::{KNOWN_FRAMES, KnownStart, KnownStarts, Predecessor, known_end};
use crate::request::Request;
use crate::stretches::{Section, stretches};

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
    /// The ends of the motions that this one continues, if there are any.
    pub(crate) start: Option<KnownStarts>,
    /// The pose features of the first frames of the motion that this one leads to, if there is one.
    pub(crate) end: Vec<[f32; POSE_FEATURES]>,
    /// The number of frames that the network makes, with the known ones.
    pub(crate) frames: usize,
    /// The frames of the motion that is requested, among these.
    pub(crate) kept: Range<usize>,
    pub(crate) seed: u64,
    /// The goals of all frames that the network makes. `None` where the motion of the text alone is requested.
    pub(crate) goals: Option<Goals>,
    /// The goals of the kept frames.
    pub(crate) requested_goals: Option<Goals>,
    pub(crate) root_motion: RootMotion,
}

/// A sentence of a motion.
#[derive(Clone, Debug)]
pub(crate) struct JobSegment {
    /// The tokens of the sentence that the model reads.
    pub(crate) tokens: Tokens,
    /// The number of frames for which the sentence holds.
    pub(crate) frames: usize,
    /// What is asked of these frames. `None` where the motion of the text alone is requested.
    pub(crate) goals: Option<Goals>,
}

impl GenerationJob {
    /// Returns the number of tokens of all sentences that did not fit the model.
    pub(crate) fn cut_tokens(&self) -> usize {
        self.segments.iter().map(|segment| segment.tokens.cut).sum()
    }

    /// Returns whether the job cannot run with others in a batch.
    pub(crate) fn runs_alone(&self) -> bool {
        self.tiling.is_some() || self.kept != (0..self.frames)
    }

    /// Returns the end of the motion that a pass continues, if there is one.
    pub(crate) fn start_of(&self, pass: Pass) -> Option<&KnownStart> {
        let starts = self.start.as_ref()?;
        Some(match pass {
            Pass::Guided => starts.guided(),
            _ => &starts.baseline,
        })
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

    /// Returns the goals of the kept frames of one of the jobs. Places and terms of one's own ask for nothing of the components.
    pub(crate) fn reported_goals(&self, job: &GenerationJob) -> Goals {
        match (&job.requested_goals, self.is_guided) {
            (Some(goals), _) => goals.clone(),
            (None, true) => Goals::anything(),
            (None, false) => Goals::default(),
        }
    }

    /// Whether the motion of the group is so long that it is made a stretch at a time. Terms of the loss of one's own, which see a
    /// motion as a whole, keep it in one piece.
    pub(crate) fn is_stretched(&self) -> bool {
        let [job] = &self.jobs[..] else { return false };
        job.tiling.is_some()
            && job.frames > LONGEST_STRETCH
            && self.is_rigid()
            && self.guidance.loss_terms.is_empty()
    }

    /// Returns the stretches that the motion of the group is made in, if it is so long.
    pub(crate) fn stretches(&self, itinerary: &Itinerary) -> Vec<Vec<Section>> {
        let segments = self.jobs[0].segments.iter();
        let lengths: Vec<usize> = segments.map(|segment| segment.frames).collect();
        let places = itinerary.frames(lengths.iter().sum());
        stretches(&lengths, LONGEST_STRETCH, &places)
    }

    /// Returns the number of stretches that the motions of the group are made in.
    fn stretch_count(&self) -> usize {
        match self.is_stretched() {
            true => {
                let itinerary = Itinerary::new(self.guidance.places.clone(), None);
                self.stretches(&itinerary).len()
            }
            false => 1,
        }
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
        self.stretch_count() * (steps + guided + fits)
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
        let (alone, together): (Vec<_>, Vec<_>) =
            { group.jobs.into_iter() }.partition(GenerationJob::runs_alone);
        let jobs = together.chunks(batch_size).chain(alone.chunks(1));
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

/// Takes the frames that are known before and after a motion from the clips of a request, for a model with such windows.
fn known_frames(
    request: &Request,
    window: Option<MotionWindow>,
) -> Result<(Option<KnownStarts>, Vec<[f32; POSE_FEATURES]>), RequestError> {
    let (frames, least) = match window {
        Some(window) => (window.prefix, window.prefix),
        None => (KNOWN_FRAMES, 2),
    };
    let start = { request.after.as_ref() }.map(|motion| KnownStarts::of(motion, frames, least));
    let end = match (&request.before, window) {
        (Some(_), Some(_)) => return Err(RequestError::BeforeOfWindows),
        (Some(clip), None) => known_end(clip, frames)?,
        (None, _) => Vec::new(),
    };
    Ok((start.transpose()?, end))
}

/// Returns the goals that a request states, if it does.
pub(crate) fn requested_goals(request: &Request) -> Result<Option<Goals>, RequestError> {
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

/// Joins the goals of sentences. A sentence without goals beside others keeps the motion of the text as it is. Returns `None`
/// if none has goals.
fn joined_goals(segments: &[JobSegment]) -> Option<Goals> {
    if segments.iter().all(|segment| segment.goals.is_none()) {
        return None;
    }
    let mut start = 0;
    let goals = segments.iter().map(|segment| {
        start += segment.frames;
        let goals = segment.goals.clone().unwrap_or_default();
        (goals, start - segment.frames)
    });
    goals
        .reduce(|(joined, _), (goals, start)| (joined.then(start, goals), 0))
        .map(|(goals, _)| goals)
}

/// The number of frames in which goals set in beside known frames, whose speed they cannot change: one second.
const EASE: usize = 20;

/// Returns the goals of a motion with known frames around it, which may have any features, or with frames that are left out. With the
/// stretch before of the same motion, goals that go on as they were need not set in.
fn goals_of_kept(
    goals: Goals,
    kept: &Range<usize>,
    (frames, leads_to_known): (usize, bool),
    after: Option<&Predecessor>,
) -> Goals {
    let sets_in = match after {
        Some(Predecessor::Stretch(end)) => end.changes_goals,
        _ => kept.start > 0,
    };
    let ease = |eases: bool| if eases { EASE } else { 0 };
    let goals = goals.eased([ease(sets_in), ease(leads_to_known)]);
    let goals = match kept.start {
        0 => goals,
        start => Goals::anything().then(start, goals),
    };
    match kept.end {
        end if end < frames => goals.then(end, Goals::anything()),
        _ => goals,
    }
}

/// Returns the number of steps that a preset makes with a model: its own, or all timesteps of a model that has fewer. Motions
/// that have to arrive somewhere may have more.
pub(crate) fn default_steps(preset: Preset, has_meetings: bool, model: &impl Denoiser) -> usize {
    let steps = match has_meetings {
        true => preset.meeting_steps(),
        false => preset.steps(),
    };
    steps.min(model.noise_schedule().timesteps())
}

/// Returns whether a motion has to arrive somewhere: at its own beginning, in another motion, at places, or where other terms of the
/// loss lead it.
fn has_meetings(request: &Request, guidance: &Guidance) -> bool {
    let arrives = request.is_looped || request.before.is_some();
    arrives || !guidance.places.is_empty() || !guidance.loss_terms.is_empty()
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
    /// Checks all sentences of a request.
    fn check_all(&self, request: &Request) -> Result<Vec<JobSegment>, RequestError> {
        let checked = request.sentences().enumerate().map(|(place, segment)| {
            let checked = match place > 0 && !segment.is_segment() {
                true => Err(RequestError::SegmentOptions),
                false => self.check(segment),
            };
            checked.map_err(|reason| match request.following.is_empty() {
                true => reason,
                false => RequestError::Segment {
                    place: place + 1,
                    reason: Box::new(reason),
                },
            })
        });
        checked.collect()
    }

    /// Checks a sentence with its length and its goals.
    fn check(&self, request: &Request) -> Result<JobSegment, RequestError> {
        check_prompt(&request.prompt)?;
        let tokens = encode(self.tokenizer, &request.prompt)?;
        let stand_in = (self.stand_in)(&request.prompt);
        let tokens = stand_in.map_or(Ok(tokens), |sentence| self.tokenizer.encode(&sentence))?;
        let frames = { request.length }.frames(*self.lengths.start(), *self.lengths.end())?;
        let goals = requested_goals(request)?;
        if let Some(goals) = &goals {
            goals.check(frames, self.all)?;
        }
        Ok(JobSegment {
            tokens,
            frames,
            goals,
        })
    }
}

/// Checks whether a request of a loop can be one, with a model with such windows.
fn check_loop(request: &Request, window: Option<MotionWindow>) -> Result<(), RequestError> {
    if request.after.is_some() || request.before.is_some() {
        return Err(RequestError::LoopOfNeighbours);
    }
    if window.is_some() {
        return Err(RequestError::LoopOfWindows);
    }
    match request.following.is_empty() {
        true => Ok(()),
        false => Err(RequestError::LoopOfSentences),
    }
}

/// Cuts a motion of sentences, with known frames before and after it, into tiles. Returns `None` if a network makes it whole.
fn tiling(segments: &[JobSegment], [before, after]: [usize; 2], longest: usize) -> Option<Tiling> {
    let mut lengths: Vec<usize> = segments.iter().map(|segment| segment.frames).collect();
    lengths[0] += before;
    if let Some(last) = lengths.last_mut() {
        *last += after;
    }
    let tiling = Tiling::new(&lengths, longest);
    (!tiling.is_whole()).then_some(tiling)
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

/// Returns the options of the guided pass of a request, with its loss terms and its places.
pub(crate) fn requested_guidance(request: &Request, default: Preset) -> Guidance {
    let preset = request.preset.unwrap_or(default);
    let mut guidance = request.guidance.clone().unwrap_or(preset.guidance());
    let terms = guidance.loss_terms.iter().chain(request.loss_terms.iter());
    guidance.loss_terms = terms.cloned().collect();
    if !request.places.is_empty() {
        guidance.places = request.places.clone();
    }
    guidance
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
    let mut guidance = requested_guidance(request, default);
    guidance.check()?;
    let (start, end) = known_frames(request, model.window())?;
    let is_looped = request.is_looped;
    if is_looped {
        check_loop(request, model.window())?;
    }
    let sentences = RequestedSentences {
        lengths: segment_lengths(request, (model, lengths)),
        all: &guidance.laban.end_effectors,
        tokenizer,
        stand_in,
    };
    let segments = sentences.check_all(request)?;
    let requested: usize = segments.iter().map(|segment| segment.frames).sum();
    if requested > Request::LONGEST_MOTION {
        return Err(RequestError::LongMotion { found: requested });
    }
    // Networks with windows do not make the known frames again.
    let before = match model.window() {
        Some(_) => 0,
        None => start
            .as_ref()
            .map_or(0, |start| start.baseline.features.len()),
    };
    let kept = before..before + requested;
    let beyond = end.len() + request.ahead;
    let frames = kept.end + beyond;
    let requested_goals = joined_goals(&segments);
    let goals = { requested_goals.clone() }.map(|goals| {
        goals_of_kept(
            goals,
            &kept,
            (frames, !end.is_empty()),
            request.after.as_ref(),
        )
    });
    let tiling = match model.window().is_none() && !is_looped {
        true => tiling(&segments, [before, beyond], *lengths.end()),
        false => None,
    };
    let has_meetings = has_meetings(request, &guidance);
    let steps = { request.steps }.unwrap_or_else(|| default_steps(preset, has_meetings, model));
    Schedule::new(model.noise_schedule()).ddim(steps)?;
    guidance.places.check(requested)?;
    if !guidance.places.is_empty() && kept != (0..frames) {
        let before = start.as_ref();
        let before = before.map_or(Vec::new(), |start| start.guided().rotations.joints());
        guidance.place_origin = Some(PlaceOrigin::new(&before, kept.clone()));
    }
    if let (Some(starts), Body::Rig) = (&start, guidance.body) {
        guidance.headings = [&starts.baseline, starts.guided()].map(KnownStart::heading);
    }
    if is_looped && guidance.places.path.is_some() {
        return Err(RequestError::PathOfLoop);
    }
    let is_guided =
        goals.is_some() || !guidance.loss_terms.is_empty() || !guidance.places.is_empty();
    let job = GenerationJob {
        request: index,
        segments,
        tiling,
        start,
        end,
        frames,
        kept,
        seed: request.seed,
        goals,
        requested_goals,
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
