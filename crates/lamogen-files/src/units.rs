//! What a file's numbers mean: the length of its unit, and which axis points up.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use glam::DVec3;

/// What one unit of a file is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    /// Metres, as in glTF and HumanML3D.
    Metre,
    /// Decimetres, as some programs with a scene of their own scale write them.
    Decimetre,
    /// Centimetres, as in most BVH files.
    Centimetre,
    /// Millimetres, as capture systems write them.
    Millimetre,
    /// Inches, as in the first BVH files.
    Inch,
    /// The unit of CMU's motion capture database: inches divided by 0.45, 56.4 mm.
    Cmu,
    /// Another length, in metres.
    Metres(f64),
}

impl Unit {
    /// The units that a file's is sought among.
    pub const KNOWN: [Unit; 6] = [
        Unit::Metre,
        Unit::Decimetre,
        Unit::Centimetre,
        Unit::Millimetre,
        Unit::Inch,
        Unit::Cmu,
    ];

    /// Lengths that a unit may have, in metres: in others a file's numbers would lose their digits.
    pub const LENGTHS: RangeInclusive<f64> = 1e-6..=1e6;

    /// Its length in metres.
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

    /// The unit in which a body is nearest to a human's size, if in any it has at least half and at
    /// most double of it. `size` is the way from ankle to hip to pelvis to head, in the file's unit.
    pub(crate) fn of_body(size: f64) -> Option<Unit> {
        let off = |unit: &Unit| (size * unit.metres() / HUMAN).ln().abs();
        Unit::KNOWN
            .into_iter()
            .filter(|unit| off(unit) <= 2.0f64.ln())
            .min_by(|a, b| off(a).total_cmp(&off(b)))
    }
}

/// From ankle to knee to hip, and from pelvis along the spine to neck and head, in metres, on the body
/// of HumanML3D.
const HUMAN: f64 = 1.48;

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

/// A word that is no unit.
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

/// Which axis of a file points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// Y, as here.
    Y,
    /// Z, as in Blender and most laboratories.
    Z,
    /// Down along Y, as where pictures count their rows from the top.
    MinusY,
    /// Down along Z.
    MinusZ,
}

impl Up {
    /// A point of the file with Y up.
    pub(crate) fn to_y_up(self, point: DVec3) -> DVec3 {
        match self {
            Up::Y => point,
            Up::Z => DVec3::new(point.x, point.z, -point.y),
            Up::MinusY => DVec3::new(point.x, -point.y, -point.z),
            Up::MinusZ => DVec3::new(point.x, -point.z, point.y),
        }
    }
}

impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Up::Y => "y",
            Up::Z => "z",
            Up::MinusY => "-y",
            Up::MinusZ => "-z",
        })
    }
}

/// A word that is no axis.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected the axis that points up (y, z, -y or -z), found {0:?}")]
pub struct UpError(pub String);

impl FromStr for Up {
    type Err = UpError;

    fn from_str(text: &str) -> Result<Self, UpError> {
        match text {
            "y" | "Y" => Ok(Up::Y),
            "z" | "Z" => Ok(Up::Z),
            "-y" | "-Y" => Ok(Up::MinusY),
            "-z" | "-Z" => Ok(Up::MinusZ),
            _ => Err(UpError(text.into())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_tells_its_unit_from_a_child_to_a_giant() {
        for unit in Unit::KNOWN {
            for human in [1.0, 1.3, 1.48, 1.7, 1.9] {
                // A child in CMU's unit is as large as a tall adult in decimetres, of which there are more.
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
        for up in [Up::Y, Up::Z] {
            assert_eq!(up.to_string().parse(), Ok(up));
        }
        assert!("x".parse::<Up>().is_err());
    }

    #[test]
    fn z_up_becomes_y_up_without_a_mirror() {
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| Up::Z.to_y_up(axis));
        assert_eq!(z, DVec3::Y);
        assert_eq!(x.cross(y), z);
    }
}
