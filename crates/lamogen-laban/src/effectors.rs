//! The end-effectors: the joints of which Weight, Time and Flow are measured.

use std::fmt;
use std::str::FromStr;

use lamogen_motion::Joint;

use crate::goal_error::GoalError;

/// The end-effectors of Weight, Time and Flow, each with its mass.
#[derive(Clone, Debug, PartialEq)]
pub struct EndEffectors(Vec<(Joint, f32)>);

/// The reason why joints and masses are no valid set of end-effectors.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EffectorError {
    /// The set has no joint.
    #[error("expected at least one end-effector, found none")]
    Empty,
    /// A joint is in the set twice.
    #[error("the end-effector {name} is given twice", name = .0.name())]
    Twice(Joint),
    /// A mass is negative, infinite or not a number.
    #[error("the mass of {name} must be a finite number of at least 0, found {found}", name = .joint.name())]
    #[allow(missing_docs)]
    Mass { joint: Joint, found: f32 },
}

impl EndEffectors {
    /// Creates a set of joints with their masses. Only Weight uses the masses; Time and Flow count every
    /// end-effector once (paper, appendix).
    ///
    /// # Errors
    ///
    /// If the set is empty, holds a joint twice, or a mass is negative or not finite.
    pub fn new(
        effectors: impl IntoIterator<Item = (Joint, f32)>,
    ) -> Result<EndEffectors, EffectorError> {
        let effectors: Vec<_> = effectors.into_iter().collect();
        for (index, &(joint, found)) in effectors.iter().enumerate() {
            if effectors[..index].iter().any(|&(other, _)| other == joint) {
                return Err(EffectorError::Twice(joint));
            }
            if !found.is_finite() || found < 0.0 {
                return Err(EffectorError::Mass { joint, found });
            }
        }
        if effectors.is_empty() {
            return Err(EffectorError::Empty);
        }
        Ok(EndEffectors(effectors))
    }

    /// Iterates over the joints.
    pub fn joints(&self) -> impl Iterator<Item = Joint> {
        self.0.iter().map(|&(joint, _)| joint)
    }

    /// Iterates over the masses, in the order of the joints.
    pub fn masses(&self) -> impl Iterator<Item = f32> {
        self.0.iter().map(|&(_, mass)| mass)
    }

    /// Returns the set without some joints, or `None` if no joint is left.
    pub(crate) fn without(&self, joints: &[Joint]) -> Option<EndEffectors> {
        let rest = self.0.iter().filter(|(joint, _)| !joints.contains(joint));
        let rest: Vec<_> = rest.copied().collect();
        (!rest.is_empty()).then_some(EndEffectors(rest))
    }

    /// Returns the number of end-effectors.
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

impl Default for EndEffectors {
    /// Returns hands, feet, head and torso, each of mass 1 (paper, section "Laban Effort and Shape
    /// Quantification"). The joints are both wrists, both feet, the head and the upper spine.
    fn default() -> Self {
        EndEffectors(
            [
                Joint::LeftWrist,
                Joint::RightWrist,
                Joint::LeftFoot,
                Joint::RightFoot,
                Joint::Head,
                Joint::Spine3,
            ]
            .map(|joint| (joint, 1.0))
            .to_vec(),
        )
    }
}

/// Writes the names of the [body parts](BodyPart) that the set consists of, and of the joints that are in no part.
impl fmt::Display for EndEffectors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest: Vec<Joint> = self.joints().collect();
        let mut names: Vec<&str> = Vec::new();
        for part in BodyPart::ALL {
            if part.joints().iter().all(|joint| rest.contains(joint)) {
                rest.retain(|joint| !part.joints().contains(joint));
                names.push(part.name());
            }
        }
        names.extend(rest.into_iter().map(Joint::name));
        f.write_str(&names.join("+"))
    }
}

/// A part of the body with its end-effectors, each of mass 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BodyPart {
    /// Both wrists.
    Arms,
    /// The left wrist.
    LeftArm,
    /// The right wrist.
    RightArm,
    /// Both feet.
    Legs,
    /// The left foot.
    LeftLeg,
    /// The right foot.
    RightLeg,
    /// The head.
    Head,
    /// The upper spine.
    Torso,
}

impl BodyPart {
    /// All parts.
    pub const ALL: [BodyPart; 8] = [
        BodyPart::Arms,
        BodyPart::LeftArm,
        BodyPart::RightArm,
        BodyPart::Legs,
        BodyPart::LeftLeg,
        BodyPart::RightLeg,
        BodyPart::Head,
        BodyPart::Torso,
    ];

    /// Returns the part's name, as [`FromStr`] parses it.
    pub const fn name(self) -> &'static str {
        match self {
            BodyPart::Arms => "arms",
            BodyPart::LeftArm => "left-arm",
            BodyPart::RightArm => "right-arm",
            BodyPart::Legs => "legs",
            BodyPart::LeftLeg => "left-leg",
            BodyPart::RightLeg => "right-leg",
            BodyPart::Head => "head",
            BodyPart::Torso => "torso",
        }
    }

    const fn joints(self) -> &'static [Joint] {
        match self {
            BodyPart::Arms => &[Joint::LeftWrist, Joint::RightWrist],
            BodyPart::LeftArm => &[Joint::LeftWrist],
            BodyPart::RightArm => &[Joint::RightWrist],
            BodyPart::Legs => &[Joint::LeftFoot, Joint::RightFoot],
            BodyPart::LeftLeg => &[Joint::LeftFoot],
            BodyPart::RightLeg => &[Joint::RightFoot],
            BodyPart::Head => &[Joint::Head],
            BodyPart::Torso => &[Joint::Spine3],
        }
    }
}

impl From<BodyPart> for EndEffectors {
    fn from(part: BodyPart) -> Self {
        EndEffectors(part.joints().iter().map(|&joint| (joint, 1.0)).collect())
    }
}

impl fmt::Display for BodyPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for BodyPart {
    type Err = GoalError;

    fn from_str(text: &str) -> Result<Self, GoalError> {
        let mut all = BodyPart::ALL.into_iter();
        all.find(|part| part.name().eq_ignore_ascii_case(text))
            .ok_or_else(|| GoalError::BodyPart {
                expected: BodyPart::ALL.map(BodyPart::name).join(", "),
                found: text.into(),
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_is_named_by_its_parts() {
        assert_eq!(EndEffectors::default().to_string(), "arms+legs+head+torso");
        let odd = EndEffectors::new([(Joint::LeftElbow, 1.0), (Joint::RightWrist, 2.0)]);
        assert_eq!(odd.unwrap().to_string(), "right-arm+left_elbow");
        for part in BodyPart::ALL {
            assert_eq!(EndEffectors::from(part).to_string(), part.name());
            assert_eq!(part.name().parse(), Ok(part));
        }
    }

    #[test]
    fn an_invalid_set_is_refused() {
        assert_eq!(EndEffectors::new([]), Err(EffectorError::Empty));
        let twice = EndEffectors::new([(Joint::Head, 1.0), (Joint::Head, 2.0)]);
        assert_eq!(twice, Err(EffectorError::Twice(Joint::Head)));
        let message = EndEffectors::new([(Joint::LeftFoot, -1.0)]).unwrap_err();
        assert!(message.to_string().contains("left_foot"), "{message}");
    }
}
