//! Where a body faces on its path.

use std::fmt;
use std::str::FromStr;

use super::error::PlaceError;

/// Where the body faces on its path.
///
/// The text form is `path`, `free`, or a number of degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "FacingForm", into = "FacingForm"))]
pub enum Facing {
    /// In the direction of the path, where it moves. This is the default.
    #[default]
    Path,
    /// Wherever the motion has it.
    Free,
    /// In one direction, in degrees to the left of how the body stands at the start: 0 is forward, 90 left, -90 right.
    Degrees(f32),
}

impl Facing {
    /// The largest number of degrees to either side.
    pub(super) const LARGEST_DEGREES: f32 = 360.0;

    /// Creates the direction of a number of degrees.
    ///
    /// # Errors
    ///
    /// If the number is not from -360 to 360.
    pub fn degrees(degrees: f32) -> Result<Facing, PlaceError> {
        let limit = Facing::LARGEST_DEGREES;
        match (-limit..=limit).contains(&degrees) {
            true => Ok(Facing::Degrees(degrees)),
            false => Err(PlaceError::Facing {
                found: degrees.to_string(),
            }),
        }
    }
}

/// A direction in JSON and other formats: a number of degrees, or a word.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(untagged, expecting = "path, free, or a number of degrees")]
enum FacingForm {
    Number(f32),
    Text(String),
}

#[cfg(feature = "serde")]
impl From<Facing> for FacingForm {
    fn from(facing: Facing) -> FacingForm {
        match facing {
            Facing::Degrees(degrees) => FacingForm::Number(degrees),
            word => FacingForm::Text(word.to_string()),
        }
    }
}

#[cfg(feature = "serde")]
impl TryFrom<FacingForm> for Facing {
    type Error = PlaceError;

    fn try_from(form: FacingForm) -> Result<Facing, PlaceError> {
        match form {
            FacingForm::Number(degrees) => Facing::degrees(degrees),
            FacingForm::Text(text) => text.parse(),
        }
    }
}

impl fmt::Display for Facing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Facing::Path => f.write_str("path"),
            Facing::Free => f.write_str("free"),
            Facing::Degrees(degrees) => write!(f, "{degrees}"),
        }
    }
}

impl FromStr for Facing {
    type Err = PlaceError;

    fn from_str(text: &str) -> Result<Self, PlaceError> {
        match text.trim() {
            "path" => Ok(Facing::Path),
            "free" => Ok(Facing::Free),
            number => {
                let degrees = number.parse().ok().map(Facing::degrees);
                degrees
                    .and_then(Result::ok)
                    .ok_or_else(|| PlaceError::Facing { found: text.into() })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_words_or_degrees() {
        for (text, facing) in [
            ("path", Facing::Path),
            ("free", Facing::Free),
            ("-90", Facing::Degrees(-90.0)),
        ] {
            assert_eq!(text.parse(), Ok(facing));
            assert_eq!(facing.to_string(), text);
        }
        for text in ["", "left", "NaN", "inf", "361", "1,2"] {
            let message = text.parse::<Facing>().unwrap_err().to_string();
            assert!(message.contains(&format!("found {text:?}")), "{message}");
        }
    }
}
