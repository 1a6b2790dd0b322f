//! What can go wrong, from loading a model to the last frame.

use std::fmt;
use std::path::PathBuf;

use lamogen_guide::{GuideError, Pass};
use lamogen_laban::{GoalError, ScaleError};
use lamogen_model::{CheckpointError, ConfigError, TokenizerError};
use lamogen_motion::{FRAMES_PER_SECOND, Motion, MotionError, NormalizationError, POSE_FEATURES};

use crate::generation::Generation;
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
    /// The list of known words cannot be read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Words {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// The network's poses are not HumanML3D's.
    #[error(
        "{path}: expected a network of {POSE_FEATURES} pose features (input_feats), found {found}"
    )]
    #[allow(missing_docs)]
    PoseFeatures { path: PathBuf, found: usize },
    /// The folder has no config, and the network is not MotionDiffuse's.
    #[error(
        "{path}: No such file; only MotionDiffuse's networks, with embeddings for {public} tokens, do without: this one has {found}"
    )]
    #[allow(missing_docs)]
    NoConfig {
        path: PathBuf,
        public: usize,
        found: usize,
    },
    /// The folder has no tokenizer, and CLIP's is not the network's.
    #[error(
        "{path}: No such file, and CLIP's own tokenizer ({clip} ids) is not that of a network with embeddings for {found}"
    )]
    #[allow(missing_docs)]
    NoTokenizer {
        path: PathBuf,
        clip: usize,
        found: usize,
    },
    /// The config.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// How the config says that the network is sampled.
    #[error("{path}: sampling: {problem}")]
    #[allow(missing_docs)]
    Sampling { path: PathBuf, problem: String },
    /// The weights.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The tokenizer.
    #[error(transparent)]
    Tokenizer(#[from] TokenizerError),
    /// Mean or standard deviation.
    #[error(transparent)]
    Normalization(#[from] NormalizationError),
}

/// Why a motion cannot be generated.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A request makes no sense. Nothing has been run.
    #[error("{which}: {reason}")]
    #[allow(missing_docs)]
    Request {
        which: RequestIndex,
        reason: RequestError,
    },
    /// The observer stopped the run.
    #[error("{0}")]
    Stopped(Box<StoppedRun>),
    /// A pass failed.
    #[error("{which}: {reason}", which = .0.which, reason = .0.reason)]
    Failed(Box<FailedRun>),
}

/// One of the requests of a call.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestIndex {
    /// Its place among the requests, from 0.
    pub index: usize,
    /// How many requests there are.
    pub count: usize,
    /// Its prompt.
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
        const MOST: usize = 80;
        let mut prompt: String = self.prompt.chars().take(MOST).collect();
        if prompt.len() < self.prompt.len() {
            prompt.push('…');
        }
        match self.count {
            1 => write!(f, "request {prompt:?}"),
            count => write!(f, "request {} of {count}, {prompt:?}", self.index + 1),
        }
    }
}

/// What makes no sense in a request.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// No words.
    #[error("the prompt is empty; expected a sentence such as \"a person jumps\"")]
    EmptyPrompt,
    /// More than a model could read.
    #[error("the prompt has {found} characters; expected at most {most}", most = Request::LONGEST_PROMPT)]
    #[allow(missing_docs)]
    LongPrompt { found: usize },
    /// A length that the model cannot do.
    #[error(
        "expected {shortest} to {longest} frames ({:.1} to {:.1} s), found {}",
        *.shortest as f32 / FRAMES_PER_SECOND,
        *.longest as f32 / FRAMES_PER_SECOND,
        length(.found)
    )]
    #[allow(missing_docs)]
    Length {
        found: Length,
        shortest: usize,
        longest: usize,
    },
    /// Tags and factors or other goals at once.
    #[error("expected tags or a scale, found both")]
    TagsAndScale,
    /// Tags that contradict each other.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// Goals that make no sense, such as a key past the motion's end.
    #[error(transparent)]
    Goal(#[from] GoalError),
    /// Steps or guidance options.
    #[error(transparent)]
    Guidance(#[from] GuideError),
    /// A prompt that the tokenizer cannot encode.
    #[error(transparent)]
    Tokenizer(#[from] TokenizerError),
}

fn length(length: &Length) -> String {
    match length {
        Length::Seconds(seconds) => format!("{seconds} s"),
        Length::Frames(frames) => format!("{frames} frames"),
    }
}

/// A run that the observer stopped, and what it has.
#[derive(Clone, Debug)]
pub struct StoppedRun {
    /// The pass that was stopped.
    pub pass: Pass,
    /// The last step that was made, from 0.
    pub index: usize,
    /// How many steps the pass has.
    pub steps: usize,
    /// What there is.
    pub partial: PartialResults,
}

/// A run that failed, and what it has.
#[derive(Debug)]
pub struct FailedRun {
    /// The request that it failed at.
    pub which: RequestIndex,
    /// Why.
    pub reason: PassError,
    /// What there is.
    pub partial: PartialResults,
}

/// How a pass fails.
#[derive(Debug, thiserror::Error)]
pub enum PassError {
    /// A loss or gradient of the guided pass is not finite.
    #[error(transparent)]
    Guide(#[from] GuideError),
    /// The network gave something that is no motion.
    #[error("the {pass} motion is not usable: {reason}")]
    #[allow(missing_docs)]
    Motion { pass: Pass, reason: MotionError },
}

/// What an interrupted run has.
#[derive(Clone, Debug, Default)]
pub struct PartialResults {
    /// Requests that were finished before, with their places among the requests, from 0.
    pub finished: Vec<(usize, Generation)>,
    /// Requests that were being worked on.
    pub unfinished: Vec<UnfinishedRequest>,
}

/// A request that was being worked on when a run ended early.
#[derive(Clone, Debug)]
pub struct UnfinishedRequest {
    /// Its place among the requests, from 0.
    pub request: usize,
    /// The motion of the text alone, if that pass was finished.
    pub baseline: Option<Motion>,
    /// The clean motion as a stopped pass last predicted it, if it is a motion.
    pub prediction: Option<Motion>,
    /// The Laban loss at every step that was made before a stop.
    pub loss: Vec<f32>,
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
