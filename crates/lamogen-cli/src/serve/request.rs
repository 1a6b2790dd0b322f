//! The JSON of a request to the server: that of a line of a batch, except that no file is opened.

use lamogen::{COMPONENTS, Component, Device, JsonRequest, LabanSeries, Preset, Request};
use lamogen_server::{Problem, ProblemKind};
use serde_json::{Map, Value};

use super::problem::invalid_request;
use crate::arguments::{BodyName, PassArguments, PresetName};
use crate::report::component_key;

/// A request for a motion.
pub struct ServedRequest {
    line: JsonRequest,
    /// The Laban features to reach.
    like: Option<LabanSeries>,
    /// The name of the character on which the motion is shown and written.
    pub onto: Option<String>,
}

/// The number of frames of the longest series to be like: an hour, as in files.
const MAX_FRAMES: usize = 72_000;

impl ServedRequest {
    /// Parses a request.
    ///
    /// # Errors
    ///
    /// If the text is not a JSON object in the form of a request, or names a file.
    pub fn parse(text: &str) -> Result<ServedRequest, Problem> {
        let mut fields: Map<String, Value> = match serde_json::from_str(text) {
            Ok(fields) => fields,
            // The parser of lines says what is wrong with other texts.
            Err(_) => Map::new(),
        };
        let like = match fields.remove("like") {
            None | Some(Value::Null) => None,
            Some(value) => Some(parse_series(&value)?),
        };
        let onto = match fields.remove("onto") {
            None | Some(Value::Null) => None,
            Some(Value::String(name)) => Some(name),
            Some(other) => {
                let expected = "the name of a character of /api/v1/character";
                let found = other.to_string();
                let problem = Problem::mismatch(ProblemKind::InvalidRequest, expected, found);
                return Err(problem.at("onto"));
            }
        };
        let line_alone;
        let text = match (&like, &onto) {
            (None, None) => text,
            _ => {
                line_alone = Value::from(fields).to_string();
                &line_alone
            }
        };
        let line = JsonRequest::parse(text).map_err(invalid_request)?;
        let file_fields = [
            ("after", line.after.is_some()),
            ("before", line.before.is_some()),
            ("pose", !line.pose.is_empty()),
            (
                "then",
                line.then.iter().any(|sentence| sentence.like.is_some()),
            ),
        ];
        if let Some((field, _)) = file_fields.into_iter().find(|(_, names_file)| *names_file) {
            let expected = "no names of files: a server opens no files";
            return Err(Problem::mismatch(ProblemKind::InvalidRequest, expected, "one").at(field));
        }
        if like.is_some()
            && line
                .requested_goals()
                .is_ok_and(|goals| goals.scale.is_some())
        {
            let (expected, found) = ("a scale or a series to be like", "both");
            return Err(Problem::mismatch(ProblemKind::InvalidRequest, expected, found).at("like"));
        }
        Ok(ServedRequest { line, like, onto })
    }

    /// Checks that the motion is not longer than so many seconds.
    ///
    /// # Errors
    ///
    /// If it is.
    pub fn check_length(&self, longest: f32) -> Result<(), Problem> {
        // What is not a length is found later; below 0 it must not make up for others, as in `total_seconds`.
        let lengths = self
            .line
            .sentences()
            .map(|sentence| sentence.seconds.unwrap_or(3.0).max(0.0));
        let seconds: f32 = lengths.sum();
        match seconds <= longest {
            true => Ok(()),
            false => {
                let expected = format!("a motion of at most {longest} s, all sentences together");
                let found = format!("{seconds} s");
                let problem = Problem::mismatch(ProblemKind::InvalidRequest, expected, found);
                Err(problem.at("seconds"))
            }
        }
    }

    /// Returns the seed of the start noise.
    pub fn seed(&self) -> u64 {
        self.line.seed.unwrap_or(0)
    }

    /// Returns the options of the passes.
    pub fn pass(&self) -> PassArguments {
        let line = &self.line;
        PassArguments {
            steps: line.steps,
            preset: line.preset.map(PresetName::of),
            emphasis: line.emphasis,
            body: line.body.map(BodyName::of),
            is_looped: line.is_looped.unwrap_or(false),
        }
    }

    /// Makes the request of the model. `preset` is that of the model.
    ///
    /// # Errors
    ///
    /// If the goals are not valid.
    pub fn request(&self, preset: Preset, device: &Device) -> Result<Request, Problem> {
        let invalid = |error: &dyn std::fmt::Display| invalid_request(error);
        let mut goals = self.line.goals(device).map_err(|error| invalid(&error))?;
        if let (Some(series), Some(first)) = (&self.like, goals.first_mut()) {
            let requested = self.line.requested_goals();
            let requested = requested.map_err(|error| invalid(&error))?;
            *first = Some(requested.resolve_like(series));
        }
        Ok(self.line.request_with(&goals, preset))
    }
}

/// Parses the series of a report: an object with as many values of each component.
fn parse_series(value: &Value) -> Result<LabanSeries, Problem> {
    let wrong = |expected: String, found: String| {
        Problem::mismatch(ProblemKind::InvalidRequest, expected, found).at("like")
    };
    let Value::Object(series) = value else {
        let expected = "the series of a report of /api/v1/laban; a server opens no files";
        let found = match value {
            Value::String(_) => "a text",
            Value::Array(_) => "an array",
            _ => "another value",
        };
        return Err(wrong(expected.into(), found.into()));
    };
    let names = Component::ALL.map(component_key);
    if let Some(unknown) = series.keys().find(|key| !names.contains(key)) {
        let expected = format!("series of {}", names.join(", "));
        return Err(wrong(expected, format!("one of {unknown:?}")));
    }
    let mut columns: Vec<Vec<f32>> = Vec::new();
    for name in &names {
        let expected = || format!("{name}: an array of 1 to {MAX_FRAMES} numbers, at least 0");
        let Some(Value::Array(values)) = series.get(name) else {
            return Err(wrong(expected(), "none".into()));
        };
        let number = |value: &Value| {
            let number = value.as_f64().map(|number| number as f32);
            number.filter(|number| number.is_finite() && *number >= 0.0)
        };
        if let Some(frame) = values.iter().position(|value| number(value).is_none()) {
            let found = format!("{} at frame {frame}", values[frame]);
            return Err(wrong(expected(), found));
        }
        let frames = columns.first().map_or(values.len(), Vec::len);
        if values.is_empty() || values.len() > MAX_FRAMES || values.len() != frames {
            let expected = match columns.is_empty() {
                true => expected(),
                false => format!("{name}: {frames} numbers, as of {}", names[0]),
            };
            return Err(wrong(expected, values.len().to_string()));
        }
        columns.push(values.iter().filter_map(number).collect());
    }
    let frames = columns[0].len();
    let row = |frame: usize| std::array::from_fn(|component| columns[component][frame]);
    let rows: Vec<[f32; COMPONENTS]> = (0..frames).map(row).collect();
    Ok(LabanSeries::from_frames(rows))
}
