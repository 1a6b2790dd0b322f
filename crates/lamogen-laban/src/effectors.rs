//! The joints whose movement is measured.

use lamogen_motion::Joint;

/// The end-effectors of Weight, Time and Flow, each with its mass.
#[derive(Clone, Debug, PartialEq)]
pub struct EndEffectors(Vec<(Joint, f32)>);

/// What cannot be a set of end-effectors.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EffectorError {
    /// No joint at all.
    #[error("expected at least one end-effector, found none")]
    Empty,
    /// A joint named twice.
    #[error("the end-effector {name} is given twice", name = .0.name())]
    Twice(Joint),
    /// A mass that is negative, infinite or not a number.
    #[error("the mass of {name} must be a finite number of at least 0, found {found}", name = .joint.name())]
    #[allow(missing_docs)]
    Mass { joint: Joint, found: f32 },
}

impl EndEffectors {
    /// A set of joints with their masses. Masses enter Weight alone; Time and Flow count every
    /// end-effector once (paper, appendix).
    ///
    /// # Errors
    ///
    /// If the set is empty, names a joint twice, or a mass is negative or not finite.
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

    /// The joints.
    pub fn joints(&self) -> impl Iterator<Item = Joint> {
        self.0.iter().map(|&(joint, _)| joint)
    }

    /// Their masses, in the same order.
    pub fn masses(&self) -> impl Iterator<Item = f32> {
        self.0.iter().map(|&(_, mass)| mass)
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

impl Default for EndEffectors {
    /// Hands, feet, head and torso, each of mass 1 (paper, section "Laban Effort and Shape
    /// Quantification"): both wrists, both feet, the head and the upper spine.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_that_makes_no_sense_is_refused() {
        assert_eq!(EndEffectors::new([]), Err(EffectorError::Empty));
        let twice = EndEffectors::new([(Joint::Head, 1.0), (Joint::Head, 2.0)]);
        assert_eq!(twice, Err(EffectorError::Twice(Joint::Head)));
        let message = EndEffectors::new([(Joint::LeftFoot, -1.0)]).unwrap_err();
        assert!(message.to_string().contains("left_foot"), "{message}");
    }
}
