//! Requests as JSON objects, in the form of the lines of `lamogen batch`.

use std::path::PathBuf;

use burn::tensor::Device;
use lamogen_files::ReadError;
use lamogen_guide::{Body, Facing, GroundPath, Places, Preset, Reach};
use lamogen_laban::{COMPONENTS, Component, Factor, Goal, GoalError, Goals, PartScale, Scale};
use lamogen_motion::RootMotion;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::named_motions::{NamedMotionError, NamedMotions, PoseFile};
use crate::request::Request;
use crate::requested_goals::RequestedGoals;

/// A request as a JSON object states it. `lamogen batch --help` lists the fields.
///
/// ```
/// use lamogen::{Device, JsonRequest, Preset};
///
/// let line = r#"{"prompt": "a person jumps", "weight": "strong", "seconds": 2, "seed": 7}"#;
/// let request = JsonRequest::parse(line)?.request(Preset::Precise, &Device::flex())?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JsonRequest {
    /// The sentence.
    pub prompt: String,
    /// A name for the motion, valid as a part of a file name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    weight: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    flow: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shape: Option<GoalText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    scale: Option<[f32; 4]>,
    /// The path of a motion file whose Laban features are the goals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub like: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    part: Vec<String>,
    /// The path of the pelvis along the ground; it is free without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<GroundPath>,
    /// Where the body faces on its path; along the path without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub face: Option<Facing>,
    /// Positions that parts of the body reach.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reach: Vec<Reach>,
    /// Poses of motion files that the body takes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pose: Vec<PoseFile>,
    /// The length of the motion in seconds; 3 without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f32>,
    /// What comes next in the same motion: objects with a sentence, a length and goals.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub then: Vec<JsonRequest>,
    /// The path of a motion file to go on from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after: Option<PathBuf>,
    /// The path of a motion file to lead to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<PathBuf>,
    /// The seed of the start noise; 0 without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// The number of DDIM steps; that of the preset without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<usize>,
    /// The preset; that of the model without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<Preset>,
    /// The power of the weight that guidance gives to large features; that of the preset without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emphasis: Option<f32>,
    /// The body on which motions are measured and guided; that of the preset without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<Body>,
    /// Whether the motion is a loop; it is none without.
    #[serde(default, skip_serializing_if = "Option::is_none", rename = "loop")]
    pub is_looped: Option<bool>,
    /// Where files of the motion keep its travel; in the hips without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub root_motion: Option<RootMotion>,
    /// Whether the body stays in place, which is short for the root motion `none`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_place: Option<bool>,
}

/// A goal in the syntax of the command line, or a plain number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a number, a word or keys such as \"0:1 1:1.5\"")]
enum GoalText {
    Number(f32),
    Text(String),
}

/// The reason why a text is not a request.
#[derive(Debug, thiserror::Error)]
pub enum JsonRequestError {
    /// The text is not a JSON object, or a field of it is not valid.
    #[error("{reason}")]
    #[allow(missing_docs)]
    Invalid { reason: String },
    /// A motion file to be like cannot be read.
    #[error(transparent)]
    Like(#[from] ReadError),
    /// A motion to go on from, to lead to or to take a pose from cannot be had.
    #[error(transparent)]
    Motion(#[from] NamedMotionError),
}

/// Makes the error of an object that is not valid.
fn invalid(reason: impl Into<String>) -> JsonRequestError {
    let reason = reason.into();
    JsonRequestError::Invalid { reason }
}

/// The length of the longest id in characters.
const MAX_ID_LENGTH: usize = 100;

impl JsonRequest {
    /// Parses a JSON object.
    ///
    /// # Errors
    ///
    /// If the text is not a JSON object, lacks the prompt, has an unknown field or a field of another type, or states an
    /// id or goals that are not valid. The error names the field.
    pub fn parse(text: &str) -> Result<JsonRequest, JsonRequestError> {
        if !text.trim_start().starts_with('{') {
            let start: String = text.trim_start().chars().take(20).collect();
            let found = match start.is_empty() {
                true => "nothing",
                false => &start,
            };
            return Err(invalid(format!(
                "expected a JSON object {{\"prompt\": …}}, found {found}"
            )));
        }
        let request: JsonRequest = serde_json::from_str(text).map_err(|error| {
            // An object of one line needs only the column.
            let reason = error.to_string().replace("at line 1 column", "at column");
            match find_wrong_field(text) {
                Some(field) if !reason.contains(&format!("`{field}`")) => {
                    invalid(format!("{field}: {reason}"))
                }
                _ => invalid(reason),
            }
        })?;
        request.check_id()?;
        if request.in_place == Some(true)
            && request
                .root_motion
                .is_some_and(|place| place != RootMotion::None)
        {
            return Err(invalid(
                "expected in_place or a root_motion other than none, found both",
            ));
        }
        if request.face.is_some() && request.path.is_none() {
            return Err(invalid("expected a path beside face, found none"));
        }
        request.requested_goals()?;
        for (place, sentence) in request.then.iter().enumerate() {
            let in_place =
                |reason: String| invalid(format!("then, sentence {}: {reason}", place + 2));
            if !sentence.is_segment() {
                return Err(in_place(
                    "expected a prompt, seconds and goals, found other fields, which belong to the first sentence".into(),
                ));
            }
            let goals = sentence.requested_goals();
            goals.map_err(|error| in_place(error.to_string()))?;
        }
        Ok(request)
    }

    /// Returns whether the object states nothing but a sentence, a length and goals.
    fn is_segment(&self) -> bool {
        let plain = JsonRequest {
            id: None,
            path: None,
            face: None,
            reach: Vec::new(),
            pose: Vec::new(),
            then: Vec::new(),
            after: None,
            before: None,
            seed: None,
            steps: None,
            preset: None,
            emphasis: None,
            body: None,
            is_looped: None,
            root_motion: None,
            in_place: None,
            ..self.clone()
        };
        *self == plain
    }

    /// Returns the sentences of the motion, this one first.
    pub fn sentences(&self) -> impl Iterator<Item = &JsonRequest> {
        [self].into_iter().chain(&self.then)
    }

    /// Returns the length of the whole motion in seconds.
    pub fn total_seconds(&self) -> f32 {
        // The default of Request::new.
        let seconds = self
            .sentences()
            .map(|sentence| sentence.seconds.unwrap_or(3.0));
        seconds.sum()
    }

    /// Checks that the id can be a part of a file name.
    fn check_id(&self) -> Result<(), JsonRequestError> {
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        let is_valid = |id: &String| {
            !id.is_empty()
                && id.len() <= MAX_ID_LENGTH
                && !id.starts_with('.')
                && id.chars().all(is_allowed)
        };
        match &self.id {
            Some(id) if !is_valid(id) => Err(invalid(format!(
                "expected an id of up to {MAX_ID_LENGTH} letters A to Z and a to z, digits, - _ and . (not first), found {id:?}"
            ))),
            _ => Ok(()),
        }
    }

    /// Parses the goals.
    ///
    /// # Errors
    ///
    /// If a goal is not valid, or two of them contradict each other.
    pub fn requested_goals(&self) -> Result<RequestedGoals, JsonRequestError> {
        let goals = [&self.weight, &self.time, &self.flow, &self.shape];
        let both = |found: &str| Err(invalid(format!("expected {found}, found both")));
        if self.scale.is_some() && goals.iter().any(|goal| goal.is_some()) {
            return both("a scale or factors of components");
        }
        if self.scale.is_some() && self.like.is_some() {
            return both("a scale or a motion to be like");
        }
        let mut parsed = [const { None }; COMPONENTS];
        for (component, text) in Component::ALL.into_iter().zip(goals) {
            let goal = text.as_ref().map(|text| match text {
                GoalText::Number(number) => Ok(Factor::constant(*number)?.into()),
                GoalText::Text(text) => Goal::parse(component, text),
            });
            parsed[component.index()] = goal.transpose().map_err(|error| {
                invalid(format!("{}: {error}", component.to_string().to_lowercase()))
            })?;
        }
        let parts = self.part.iter().map(|part| part.parse());
        let parts: Result<Vec<PartScale>, GoalError> = parts.collect();
        let scale = self.scale.map(Scale::new).transpose();
        Ok(RequestedGoals {
            goals: parsed,
            scale: scale.map_err(|error| invalid(error.to_string()))?,
            like: self.like.clone(),
            parts: parts.map_err(|error| invalid(format!("part: {error}")))?,
        })
    }

    /// Returns the goals of every sentence, as far as they have any. Motion files to be like are read here.
    ///
    /// # Errors
    ///
    /// If a motion file cannot be read, or goals are not valid, which [`parse`](Self::parse) has checked.
    pub fn goals(&self, device: &Device) -> Result<Vec<Option<Goals>>, JsonRequestError> {
        self.sentences()
            .map(|sentence| Ok(sentence.requested_goals()?.resolve(device)?))
            .collect()
    }

    /// Reads the motions before and after this one, and those with poses, if the object names any.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, or has no pose at a moment.
    pub fn named_motions(&self) -> Result<NamedMotions, JsonRequestError> {
        let (after, before) = (self.after.as_deref(), self.before.as_deref());
        Ok(NamedMotions::read(after, before, &self.pose)?)
    }

    /// Makes the request. `preset` is that of the model ([`LaMoGen::preset`](crate::LaMoGen::preset)) and holds where the
    /// object states none. Motion files to be like are read here.
    ///
    /// # Errors
    ///
    /// If a motion file cannot be read, or goals are not valid, which [`parse`](Self::parse) has checked.
    pub fn request(&self, preset: Preset, device: &Device) -> Result<Request, JsonRequestError> {
        let request = self.request_with(&self.goals(device)?, preset);
        Ok(self.named_motions()?.apply(request))
    }

    /// Makes the request with other goals than those that the object states, one entry for each sentence; sentences past the
    /// last entry have none. `preset` is as in [`request`](Self::request). The [motions of files](Self::named_motions) are not set.
    pub fn request_with(&self, goals: &[Option<Goals>], preset: Preset) -> Request {
        let mut sentences = self
            .sentences()
            .zip(goals.iter().chain(std::iter::repeat(&None)));
        let segments = sentences.by_ref().map(|(sentence, goals)| {
            let mut request = Request::new(&sentence.prompt);
            if let Some(seconds) = sentence.seconds {
                request = request.seconds(seconds);
            }
            match goals {
                Some(goals) => request.scale(goals.clone()),
                None => request,
            }
        });
        let request = segments.reduce(Request::then);
        let request = request.expect("the first sentence is always there");
        let mut request = request.seed(self.seed.unwrap_or(0));
        let preset = self.preset.unwrap_or(preset);
        request = request.preset(preset);
        if let Some(steps) = self.steps {
            request = request.steps(steps);
        }
        let mut guidance = preset.guidance();
        if let Some(emphasis) = self.emphasis {
            guidance.emphasis = [emphasis; COMPONENTS];
        }
        if let Some(body) = self.body {
            guidance.body = body;
        }
        request = request.looped(self.is_looped.unwrap_or(false));
        if let Some(root_motion) = self.root_motion() {
            request = request.root_motion(root_motion);
        }
        request.guidance(guidance).places(self.places())
    }

    /// Returns the places that the object states.
    pub fn places(&self) -> Places {
        Places {
            path: self.path.clone(),
            facing: self.face.unwrap_or_default(),
            reaches: self.reach.clone(),
            poses: Vec::new(),
        }
    }

    /// Returns where files of the motion keep its travel, if the object says so.
    pub fn root_motion(&self) -> Option<RootMotion> {
        match self.in_place {
            Some(true) => Some(RootMotion::None),
            _ => self.root_motion,
        }
    }
}

/// Returns the first field that cannot be read; the errors of serde do not name it.
fn find_wrong_field(text: &str) -> Option<String> {
    let fields: Map<String, Value> = serde_json::from_str(text).ok()?;
    let is_wrong = |(name, value): &(String, Value)| {
        let mut alone = Map::from_iter([("prompt".to_owned(), "a".into())]);
        alone.insert(name.clone(), value.clone());
        serde_json::from_value::<JsonRequest>(alone.into()).is_err()
    };
    let (name, _) = fields.into_iter().find(is_wrong)?;
    Some(name)
}
