//! The unit and the up axis of a file.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use glam::DVec3;

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    /// Metres, as in glTF and HumanML3D.
    Metre,
    /// Decimetres, as written by some programs that have their own scene scale.
    Decimetre,
    /// Centimetres, as in most BVH files.
    Centimetre,
    /// Millimetres, as capture systems write them.
    Millimetre,
    /// Inches, as in the first BVH files.
    Inch,
    /// The unit of CMU's motion capture database: inches divided by 0.45, 56.4 mm.
    Cmu,
    /// A unit of any other length, given in metres.
    Metres(f64),
}

impl Unit {
    /// The units among which the unit of a file is guessed.
    pub const KNOWN: [Unit; 6] = [
        Unit::Metre,
        Unit::Decimetre,
        Unit::Centimetre,
        Unit::Millimetre,
        Unit::Inch,
        Unit::Cmu,
    ];

    /// The allowed lengths of a unit in metres. In smaller or larger units the numbers of a file would lose digits.
    pub const LENGTHS: RangeInclusive<f64> = 1e-6..=1e6;

    /// Returns the length of the unit in metres.
    pub fn metres(self) -> f64 {
        match self {
            Unit::Metre => 1.0,
            Unit::Decimetre => 0.1,
            Unit::Centimetre => 0.01,
            Unit::Millimetre => 0.001,
            Unit::Inch => 0.0254,
            Unit::Cmu => 0.0254 / 0.45,
            Unit::Metres(metres) => metres,
        }
    }

    /// Returns the unit in which a body is nearest to human size, if its size is between half and twice human size in
    /// some unit. `size` is the length of the path from the ankle to the hip plus that from the pelvis to the head, in
    /// the file's unit.
    pub(crate) fn of_body(size: f64) -> Option<Unit> {
        let deviation = |unit: &Unit| (size * unit.metres() / HUMAN_SIZE).ln().abs();
        Unit::KNOWN
            .into_iter()
            .filter(|unit| deviation(unit) <= 2.0f64.ln())
            .min_by(|a, b| deviation(a).total_cmp(&deviation(b)))
    }
}

/// The size of the body of HumanML3D in metres: the length from ankle over knee to hip, plus the length from the pelvis
/// along the spine to neck and head.
const HUMAN_SIZE: f64 = 1.48;

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Unit::Metre => write!(f, "m"),
            Unit::Decimetre => write!(f, "dm"),
            Unit::Centimetre => write!(f, "cm"),
            Unit::Millimetre => write!(f, "mm"),
            Unit::Inch => write!(f, "in"),
            Unit::Cmu => write!(f, "cmu"),
            Unit::Metres(metres) => write!(f, "{metres}"),
        }
    }
}

/// The error of a text that is not a unit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected a unit (m, dm, cm, mm, in, cmu) or its length, 0.000001 to 1000000 metres, found {0:?}"
)]
pub struct UnitError(pub String);

impl FromStr for Unit {
    type Err = UnitError;

    fn from_str(text: &str) -> Result<Self, UnitError> {
        if let Some(unit) = Unit::KNOWN.iter().find(|unit| unit.to_string() == text) {
            return Ok(*unit);
        }
        match text.parse::<f64>() {
            Ok(metres) if Unit::LENGTHS.contains(&metres) => Ok(Unit::Metres(metres)),
            _ => Err(UnitError(text.into())),
        }
    }
}

/// The axis of a file that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// Y, as in lamogen.
    Y,
    /// Z, as in Blender and most laboratories.
    Z,
    /// The negative Y axis, as in files that follow image coordinates, in which rows are counted from the top.
    MinusY,
    /// The negative Z axis.
    MinusZ,
}

impl UpAxis {
    /// Converts a point of the file to coordinates with Y up.
    pub(crate) fn to_y_up(self, point: DVec3) -> DVec3 {
        match self {
            UpAxis::Y => point,
            UpAxis::Z => DVec3::new(point.x, point.z, -point.y),
            UpAxis::MinusY => DVec3::new(point.x, -point.y, -point.z),
            UpAxis::MinusZ => DVec3::new(point.x, -point.z, point.y),
        }
    }
}

impl fmt::Display for UpAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            UpAxis::Y => "y",
            UpAxis::Z => "z",
            UpAxis::MinusY => "-y",
            UpAxis::MinusZ => "-z",
        })
    }
}

/// The error of a text that is not an axis.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected the axis that points up (y, z, -y or -z), found {0:?}")]
pub struct UpAxisError(pub String);

impl FromStr for UpAxis {
    type Err = UpAxisError;

    fn from_str(text: &str) -> Result<Self, UpAxisError> {
        match text {
            "y" | "Y" => Ok(UpAxis::Y),
            "z" | "Z" => Ok(UpAxis::Z),
            "-y" | "-Y" => Ok(UpAxis::MinusY),
            "-z" | "-Z" => Ok(UpAxis::MinusZ),
            _ => Err(UpAxisError(text.into())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_guessed_from_bodies_of_children_and_of_very_tall_adults() {
        for unit in Unit::KNOWN {
            for human in [1.0, 1.3, 1.48, 1.7, 1.9] {
                // A child in CMU's unit has the same size as a tall adult in decimetres, which is the more frequent case.
                if unit == Unit::Cmu && human < 1.2 {
                    continue;
                }
                assert_eq!(Unit::of_body(human / unit.metres()), Some(unit));
            }
        }
        assert_eq!(Unit::of_body(6.0), None);
        assert_eq!(Unit::of_body(0.0), None);
        assert_eq!(Unit::of_body(f64::NAN), None);
    }

    #[test]
    fn units_and_axes_are_read_as_they_are_shown() {
        for unit in Unit::KNOWN.into_iter().chain([Unit::Metres(0.3048)]) {
            assert_eq!(unit.to_string().parse(), Ok(unit));
        }
        for text in ["", "foot", "0", "-1", "nan", "inf"] {
            assert!(text.parse::<Unit>().is_err(), "{text}");
        }
        for up in [UpAxis::Y, UpAxis::Z] {
            assert_eq!(up.to_string().parse(), Ok(up));
        }
        assert!("x".parse::<UpAxis>().is_err());
    }

    #[test]
    fn z_up_becomes_y_up_without_a_mirror() {
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| UpAxis::Z.to_y_up(axis));
        assert_eq!(z, DVec3::Y);
        assert_eq!(x.cross(y), z);
    }
}
