//! How a motion becomes one of rigid bones.

use lamogen_motion::Joint;

/// What a fit weighs, and how long it works.
///
/// A fit moves the root and the rotations of a body so that the sum of all its terms becomes least. Each term is a square, summed over
/// frames and, where it is about joints, over these; a weight is what one unit of it costs: a metre, or a whole change of a
/// quaternion's numbers. A weight of 0 leaves a term out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// How often the terms are evaluated where there is no goal; it ends earlier where nothing is left to gain. Default: 60.
    pub evaluations: usize,
    /// The same where there is a goal. Default: 200.
    pub goal_evaluations: usize,
    /// Distance of every joint from the motion's, in metres. Default: 4.
    pub nearness: f64,
    /// Third difference of that distance: what is changed is changed smoothly, and details of the motion stay. Default: 15.
    pub smoothness: f64,
    /// Third difference of the joints' own positions. Default: 0.1.
    pub jerk: f64,
    /// Second difference of what a joint's quaternion is off the one [solved](lamogen_motion::Rotations::of) from the motion. The neck,
    /// whose turns hardly move anything, counts [eighty times](FitOptions::neck). Default: 5.
    pub turning: f64,
    /// How many times as much as another joint's the neck's turning counts. Default: 80.
    pub neck: f64,
    /// Second difference of a joint's quaternion. Default: 0.05.
    pub rotation: f64,
    /// How much the quaternions of two frames differ beyond a turn by [`fastest`](FitOptions::fastest). Default: 200.
    pub haste: f64,
    /// Degrees that a joint may turn in its parent's frame from one frame to the next. Default: 26, which is 520 degrees a second.
    pub fastest: f64,
    /// Distance of a foot that stands from where it stands, in metres. Default: 600.
    pub stand: f64,
    /// How far the ball of a swinging foot is below the height at which it clears the ground, in metres. Default: 70.
    pub clearance: f64,
    /// How far a joint is below the ground, in metres. Default: 1500.
    pub floor: f64,
    /// How far elbow or knee is bent the wrong way, as a share of the lower bone's length. Default: 2.
    pub hinge: f64,
    /// How far the lower bone is out of the plane in which elbow or knee bends, as a share of its length. Default: 0.05.
    pub plane: f64,
    /// Difference of a joint's quaternion from the one solved. It settles twists that no position tells. Default: 0.002.
    pub prior: f64,
    /// What a [`FitObjective`](crate::FitObjective) is multiplied by. Default: 15.
    pub goal: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        FitOptions {
            evaluations: 60,
            goal_evaluations: 200,
            nearness: 4.0,
            smoothness: 15.0,
            jerk: 0.1,
            turning: 5.0,
            neck: 80.0,
            rotation: 0.05,
            haste: 200.0,
            fastest: 26.0,
            stand: 600.0,
            clearance: 70.0,
            floor: 1500.0,
            hinge: 2.0,
            plane: 0.05,
            prior: 0.002,
            goal: 15.0,
        }
    }
}

/// A number of a [`FitOptions`] that makes no sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("fit: expected {expected}, found {field} = {found}")]
#[allow(missing_docs)]
pub struct FitError {
    pub field: &'static str,
    pub expected: &'static str,
    pub found: f64,
}

impl FitOptions {
    /// Whether the numbers make sense.
    ///
    /// # Errors
    ///
    /// If a weight is not a finite number from 0 to a million, nearness is 0, an evaluation is not allowed, or the fastest turn is not from 1
    /// to 180 degrees.
    pub fn check(&self) -> Result<(), FitError> {
        let weights = [
            ("nearness", self.nearness),
            ("smoothness", self.smoothness),
            ("jerk", self.jerk),
            ("turning", self.turning),
            ("neck", self.neck),
            ("rotation", self.rotation),
            ("haste", self.haste),
            ("stand", self.stand),
            ("clearance", self.clearance),
            ("floor", self.floor),
            ("hinge", self.hinge),
            ("plane", self.plane),
            ("prior", self.prior),
            ("goal", self.goal),
        ];
        let problem = |field, expected, found| {
            Err(FitError {
                field,
                expected,
                found,
            })
        };
        for (field, found) in weights {
            if !(0.0..=1e6).contains(&found) {
                return problem(field, "a weight from 0 to 1000000", found);
            }
        }
        if self.nearness == 0.0 {
            return problem("nearness", "a weight above 0", 0.0);
        }
        for (field, found) in [
            ("evaluations", self.evaluations),
            ("goal_evaluations", self.goal_evaluations),
        ] {
            if !(1..=100_000).contains(&found) {
                return problem(field, "1 to 100000 evaluations", found as f64);
            }
        }
        match (1.0..=180.0).contains(&self.fastest) {
            true => Ok(()),
            false => problem("fastest", "1 to 180 degrees a frame", self.fastest),
        }
    }

    /// The weight of a joint's turning.
    pub(crate) fn weight_of(&self, joint: Joint) -> f64 {
        match joint {
            Joint::Neck => self.neck,
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_make_no_sense_are_named() {
        assert_eq!(FitOptions::default().check(), Ok(()));
        let broken = [
            FitOptions {
                stand: f64::NAN,
                ..FitOptions::default()
            },
            FitOptions {
                nearness: 0.0,
                ..FitOptions::default()
            },
            FitOptions {
                evaluations: 0,
                ..FitOptions::default()
            },
            FitOptions {
                fastest: 0.0,
                ..FitOptions::default()
            },
        ];
        let names = ["stand", "nearness", "evaluations", "fastest"];
        for (fit, name) in broken.into_iter().zip(names) {
            let message = fit.check().unwrap_err().to_string();
            assert!(
                message.contains(name) && message.contains("expected"),
                "{message}"
            );
        }
    }
}
