//! The errors of loading a model and of generating motions.

use std::fmt;
use std::path::PathBuf;

use lamogen_guide::{GuideError, Pass, PlaceError};
use lamogen_laban::{GoalError, ScaleError};
use lamogen_model::{CheckpointError, ConfigError, TokenizerError};
use lamogen_motion::{
    BodyError, FRAMES_PER_SECOND, Motion, MotionError, NormalizationError, POSE_FEATURES,
};

use crate::generation::{GeneratedSentence, Generation};
use crate::request::{Length, Request};

/// Why a model cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The folder has no weights.
    #[error(
        "{folder}: expected weights in model.safetensors, latest.tar or model/latest.tar, found {found}"
    )]
    #[allow(missing_docs)]
    NoWeights { folder: PathBuf, found: String },
    /// The folder has MDM's `args.json` without its weights.
    #[error(
        "{folder}: expected the weights of args.json in a file such as model000750000.pt, found {found}"
    )]
    #[allow(missing_docs)]
    NoMdmWeights { folder: PathBuf, found: String },
    /// The folder has the weights of an MDM without the file that says which network they are of.
    #[error("{weights}: expected an args.json beside these weights, found {found}")]
    #[allow(missing_docs)]
    NoMdmArguments { weights: PathBuf, found: String },
    /// The text encoder of an MDM is not there.
    #[error(
        "{folder}: expected {encoder}, which reads the sentences, in one of these files here or in the folder above: {names}; found {found}"
    )]
    #[allow(missing_docs)]
    NoTextEncoder {
        folder: PathBuf,
        encoder: &'static str,
        names: String,
        found: String,
    },
    /// The text encoder is not the one that the network was trained with.
    #[error(
        "{path}: expected {encoder} with features of {expected} numbers, which the network was trained with; found features of {found}"
    )]
    #[allow(missing_docs)]
    TextEncoderWidth {
        path: PathBuf,
        encoder: &'static str,
        expected: usize,
        found: usize,
    },
    /// The statistics are those of the networks that evaluate motions.
    #[error(
        "{path}: expected HumanML3D's own Mean.npy and Std.npy, found the statistics of the evaluators (t2m_mean.npy, t2m_std.npy), whose deviations of the root and the foot contacts are 25 times as small: contacts with a mean of {mean:.2} deviate by {expected:.2}, found {found:.4}"
    )]
    #[allow(missing_docs)]
    EvaluatorStatistics {
        path: PathBuf,
        mean: f32,
        expected: f32,
        found: f32,
    },
    /// The list of known words cannot be read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Words {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// The network does not have HumanML3D's pose features.
    #[error(
        "{path}: expected a network of {POSE_FEATURES} pose features (input_feats), found {found}"
    )]
    #[allow(missing_docs)]
    PoseFeatures { path: PathBuf, found: usize },
    /// The folder has no config, which only MotionDiffuse's own networks can do without.
    #[error(
        "{path}: No such file; only MotionDiffuse's networks, with embeddings for {public} tokens, do without: this one has {found}"
    )]
    #[allow(missing_docs)]
    NoConfig {
        path: PathBuf,
        public: usize,
        found: usize,
    },
    /// The folder has no tokenizer, and CLIP's own does not fit the network.
    #[error(
        "{path}: No such file, and CLIP's own tokenizer ({clip} ids) is not that of a network with embeddings for {found}"
    )]
    #[allow(missing_docs)]
    NoTokenizer {
        path: PathBuf,
        clip: usize,
        found: usize,
    },
    /// The config cannot be read.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The sampling options in the config are invalid.
    #[error("{path}: sampling: {problem}")]
    #[allow(missing_docs)]
    Sampling { path: PathBuf, problem: String },
    /// The weights cannot be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The tokenizer cannot be read.
    #[error(transparent)]
    Tokenizer(#[from] TokenizerError),
    /// The mean or the standard deviation of the features cannot be read.
    #[error(transparent)]
    Normalization(#[from] NormalizationError),
}

/// Why a motion cannot be generated.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A request is invalid. Nothing has been run.
    #[error("{which}: {reason}")]
    #[allow(missing_docs)]
    Request {
        which: RequestIndex,
        reason: RequestError,
    },
    /// The observer stopped the run.
    #[error("{0}")]
    Stopped(Box<StoppedRun>),
    /// A run failed.
    #[error("{which}: {reason}", which = .0.which, reason = .0.reason)]
    Failed(Box<FailedRun>),
}

/// One of the requests of a call.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestIndex {
    /// The place of the request among those of the call, from 0.
    pub index: usize,
    /// The number of requests of the call.
    pub count: usize,
    /// The prompt of the request.
    pub prompt: String,
}

impl RequestIndex {
    pub(crate) fn new(requests: &[Request], index: usize) -> Self {
        RequestIndex {
            index,
            count: requests.len(),
            prompt: requests[index].prompt.clone(),
        }
    }
}

impl fmt::Display for RequestIndex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Longer prompts are shortened to so many characters.
        const MAX_CHARACTERS: usize = 80;
        let mut prompt: String = self.prompt.chars().take(MAX_CHARACTERS).collect();
        if prompt.len() < self.prompt.len() {
            prompt.push('…');
        }
        match self.count {
            1 => write!(f, "request {prompt:?}"),
            count => write!(f, "request {} of {count}, {prompt:?}", self.index + 1),
        }
    }
}

/// Why a request is invalid.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// The prompt has no words.
    #[error("the prompt is empty; expected a sentence such as \"a person jumps\"")]
    EmptyPrompt,
    /// The prompt is longer than [`Request::LONGEST_PROMPT`].
    #[error("the prompt has {found} characters; expected at most {most}", most = Request::LONGEST_PROMPT)]
    #[allow(missing_docs)]
    LongPrompt { found: usize },
    /// The request cannot be made a stretch at a time.
    #[error("expected a request that can be made a stretch at a time, found {found}")]
    #[allow(missing_docs)]
    Stream { found: &'static str },
    /// The model cannot generate motions of this length.
    #[error(
        "expected {shortest} to {longest} frames ({:.1} to {:.1} s), found {}",
        *.shortest as f32 / FRAMES_PER_SECOND,
        *.longest as f32 / FRAMES_PER_SECOND,
        format_length(.found)
    )]
    #[allow(missing_docs)]
    Length {
        found: Length,
        shortest: usize,
        longest: usize,
    },
    /// A loop is requested of a model that makes a motion a window at a time.
    #[error(
        "expected a model that makes whole motions for a loop, found one that makes a motion a window at a time"
    )]
    LoopOfWindows,
    /// A loop is requested to take a path.
    #[error(
        "expected a path or a loop, found both: a loop has a way of its own, which leads back to its beginning"
    )]
    PathOfLoop,
    /// A place is beyond the motion, or there are two at one moment.
    #[error(transparent)]
    Places(#[from] PlaceError),
    /// A loop is requested of several sentences.
    #[error("expected one sentence for a loop, found several")]
    LoopOfSentences,
    /// One of several sentences cannot be a part of the motion.
    #[error("sentence {place}: {reason}")]
    #[allow(missing_docs)]
    Segment {
        place: usize,
        reason: Box<RequestError>,
    },
    /// A sentence that follows another has options that only the first may have.
    #[error(
        "expected a sentence with a length and goals, found other options: seed, steps, guidance, loop and the others belong to the first sentence"
    )]
    SegmentOptions,
    /// The motion is longer than [`Request::LONGEST_MOTION`].
    #[error(
        "expected a motion of at most {} frames (an hour) in all, found {found}",
        Request::LONGEST_MOTION
    )]
    #[allow(missing_docs)]
    LongMotion { found: usize },
    /// A loop is requested that continues a motion or leads to one.
    #[error("expected a loop without a motion before or after it, found one")]
    LoopOfNeighbours,
    /// The request leads to a motion, but the model makes a motion a window at a time.
    #[error(
        "expected a model that makes whole motions to lead to a given one, found one that makes a motion a window at a time"
    )]
    BeforeOfWindows,
    /// The motion to continue or to lead to is too short.
    #[error(
        "expected a motion of at least {expected} frames to continue or to lead to, found {found}"
    )]
    #[allow(missing_docs)]
    Prefix { expected: usize, found: usize },
    /// The motion to continue or to lead to shows no body.
    #[error("the motion to continue or to lead to: {0}")]
    Body(#[from] BodyError),
    /// The request has tags, and factors or other goals too.
    #[error("expected tags or a scale, found both")]
    TagsAndScale,
    /// The tags contradict each other.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// The goals are invalid, such as a key past the end of the motion.
    #[error(transparent)]
    Goal(#[from] GoalError),
    /// The number of steps or the guidance options are invalid.
    #[error(transparent)]
    Guidance(#[from] GuideError),
    /// The tokenizer cannot encode the prompt.
    #[error(transparent)]
    Tokenizer(#[from] TokenizerError),
}

/// Formats a length in the unit in which it was given.
fn format_length(length: &Length) -> String {
    match length {
        Length::Seconds(seconds) => format!("{seconds} s"),
        Length::Frames(frames) => format!("{frames} frames"),
    }
}

/// A run that the observer stopped, with its partial results.
#[derive(Clone, Debug)]
pub struct StoppedRun {
    /// The pass that was stopped.
    pub pass: Pass,
    /// The last finished step of the pass, from 0.
    pub index: usize,
    /// The number of steps of the pass.
    pub steps: usize,
    /// The results up to the stop.
    pub partial: PartialResults,
}

/// A run that failed, with its partial results.
#[derive(Debug)]
pub struct FailedRun {
    /// The request at which the run failed.
    pub which: RequestIndex,
    /// Why the run failed.
    pub reason: PassError,
    /// The results up to the failure.
    pub partial: PartialResults,
}

/// Why a pass failed.
#[derive(Debug, thiserror::Error)]
pub enum PassError {
    /// A loss or gradient of the guided pass is not finite.
    #[error(transparent)]
    Guide(#[from] GuideError),
    /// The output of the network is not a usable motion.
    #[error("the {pass} motion is not usable: {reason}")]
    #[allow(missing_docs)]
    Motion { pass: Pass, reason: MotionError },
}

/// The results of a run that ended early.
#[derive(Clone, Debug, Default)]
pub struct PartialResults {
    /// The finished requests, each with its place among the requests, from 0.
    pub finished: Vec<(usize, Generation)>,
    /// The requests of the batch that was running.
    pub unfinished: Vec<UnfinishedRequest>,
}

/// A request that was running when the run ended early.
#[derive(Clone, Debug)]
pub struct UnfinishedRequest {
    /// The place among the requests, from 0.
    pub request: usize,
    /// The motion of the text alone, if that pass was finished.
    pub baseline: Option<Motion>,
    /// The last prediction of the clean motion by the pass that was stopped, if it is a usable motion. Long motions, which are
    /// made a stretch at a time, have none.
    pub prediction: Option<Motion>,
    /// What is finished of a long motion: the stretches from its start to the one that was running. They are those of the
    /// guided motion or, before the first of these, of the text alone.
    pub finished: Option<FinishedStretches>,
    /// The Laban loss at every step before the stop.
    pub loss: Vec<f32>,
}

/// The stretches of a long motion that were finished when the run ended early.
#[derive(Clone, Debug)]
pub struct FinishedStretches {
    /// The stretches as one motion, which begins where the whole motion would.
    pub motion: Motion,
    /// Whether the motion is guided; otherwise it is that of the text alone.
    pub is_guided: bool,
    /// The sentences of the motion, each with those of its frames that are finished.
    pub sentences: Vec<GeneratedSentence>,
}

impl fmt::Display for StoppedRun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "stopped by the observer after step {} of {} of the {} pass",
            self.index + 1,
            self.steps,
            self.pass
        )?;
        match self.partial.finished.len() {
            0 => Ok(()),
            1 => write!(f, "; 1 request was finished before"),
            count => write!(f, "; {count} requests were finished before"),
        }
    }
}
