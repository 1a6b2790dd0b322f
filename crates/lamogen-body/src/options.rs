//! The options of a fit of motions to rigid bodies.

use lamogen_motion::{Joint, LEGS};

/// The options of a fit: the weights of its terms, and the number of evaluations.
///
/// A fit changes the root and the rotations of a body so that the weighted sum of its terms becomes least. Each term is a
/// square, summed over frames and, if it is about joints, over joints. A weight is the cost of one unit, which is a metre,
/// or a change of 1 in the numbers of a quaternion. A weight of 0 leaves a term out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// The largest number of evaluations of the terms without a goal. The fit ends earlier if it converges. Default: 60.
    pub evaluations: usize,
    /// The largest number of evaluations of the terms with a goal. Default: 300.
    pub goal_evaluations: usize,
    /// The weight of the distance of every joint from that of the motion, in metres. Default: 4.
    pub nearness: f64,
    /// The share of `nearness` that holds for the mean deviation of a frame's joints along the ground, 0 to 1. Below 1, a body
    /// may travel less far or further than the motion where a goal asks for it, with shorter or longer steps. Default: 0.3.
    pub placement: f64,
    /// The weight of the third difference of that deviation along time. It makes changes smooth and keeps details of the
    /// motion. Default: 15.
    pub smoothness: f64,
    /// The weight of the third difference of the joints' own positions. Default: 0.1.
    pub jerk: f64,
    /// The weight of the second difference of the deviation of a joint's quaternion from the one
    /// [solved](lamogen_motion::Rotations::of) from the motion. Joints differ by how much their turns move: those of the
    /// spine count twelve times as much, the [neck](FitOptions::neck) much more, and those of the legs, which have to bend
    /// to keep the feet in place, a third. Default: 15.
    pub turning: f64,
    /// A factor on the weights `turning` and `rotation` at the neck, whose turns hardly move any joint. Without it goals
    /// about the head are reached by nodding. Default: 8000.
    pub neck: f64,
    /// The weight of the second difference of a joint's quaternion. Default: 0.05.
    pub rotation: f64,
    /// The weight of the difference of a joint's quaternions at two neighbouring frames beyond that of a turn by
    /// [`fastest`](FitOptions::fastest). Default: 200.
    pub haste: f64,
    /// The angle in degrees that a joint may turn from one frame to the next, in the frame of its parent, without cost.
    /// Default: 26, which is 520 degrees a second.
    pub fastest: f64,
    /// The weight of the distance of a standing foot, at every frame, from its mean place on the ground as long as it stands, and
    /// from the height at which it stands, in metres. Default: 600.
    pub stand: f64,
    /// The weight of the depth of the ball of a swinging foot below the height at which it clears the ground, in metres.
    /// Default: 250.
    pub clearance: f64,
    /// The weight of the depth of a joint below the ground, in metres. Default: 1500.
    pub floor: f64,
    /// The weight of how far an elbow or knee is bent the wrong way, as a share of the length of the bone below it.
    /// Default: 2.
    pub hinge: f64,
    /// The weight of how far the bone below an elbow or knee is out of the plane in which the joint bends, as a share of
    /// the bone's length. Default: 0.05.
    pub plane: f64,
    /// The weight of the difference of a joint's quaternion from the one solved. It decides twists that the joint
    /// positions do not show, and keeps the turns of the body those of the motion where a goal could be reached by others.
    /// Joints of the trunk (pelvis and spine) count a thousand times as much, because a lean moves many joints at once, and
    /// those of the legs a twentieth. Default: 1.
    pub prior: f64,
    /// The factor by which a [`FitObjective`](crate::FitObjective) is multiplied. Default: 40.
    pub goal: f64,
    /// The distance in metres that a foot may slide while it stands; further on it takes steps of this length. `None`, the
    /// default, holds every standing foot in one place.
    pub stride: Option<f64>,
}

impl Default for FitOptions {
    fn default() -> Self {
        FitOptions {
            evaluations: 60,
            goal_evaluations: 300,
            nearness: 4.0,
            placement: 0.3,
            smoothness: 15.0,
            jerk: 0.1,
            turning: 15.0,
            neck: 8000.0,
            rotation: 0.05,
            haste: 200.0,
            fastest: 26.0,
            stand: 600.0,
            clearance: 250.0,
            floor: 1500.0,
            hinge: 2.0,
            plane: 0.05,
            prior: 1.0,
            goal: 40.0,
            stride: None,
        }
    }
}

/// A value of [`FitOptions`] that is out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("fit: expected {expected}, found {field} = {found}")]
#[allow(missing_docs)]
pub struct FitError {
    pub field: &'static str,
    pub expected: &'static str,
    pub found: f64,
}

impl FitOptions {
    /// Checks that all values are in range.
    ///
    /// # Errors
    ///
    /// If a weight is not a finite number from 0 to a million, nearness is 0, placement is not from 0 to 1, a number of
    /// evaluations is not from 1 to 100000, the stride is not from 0.1 to 10 metres, or the fastest turn is not from 1 to
    /// 180 degrees.
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
        if !(0.0..=1.0).contains(&self.placement) {
            return problem("placement", "a share from 0 to 1", self.placement);
        }
        for (field, found) in [
            ("evaluations", self.evaluations),
            ("goal_evaluations", self.goal_evaluations),
        ] {
            if !(1..=100_000).contains(&found) {
                return problem(field, "1 to 100000 evaluations", found as f64);
            }
        }
        if let Some(stride) = self.stride.filter(|stride| !(0.1..=10.0).contains(stride)) {
            return problem("stride", "0.1 to 10 metres", stride);
        }
        match (1.0..=180.0).contains(&self.fastest) {
            true => Ok(()),
            false => problem("fastest", "1 to 180 degrees a frame", self.fastest),
        }
    }

    /// Returns the factor on the weights `turning` and `rotation` at a joint.
    pub(crate) fn turning_factor(&self, joint: Joint) -> f64 {
        match joint {
            Joint::Neck => self.neck,
            Joint::Spine1 | Joint::Spine2 | Joint::Spine3 => 12.0,
            joint if is_of_leg(joint) => 1.0 / 3.0,
            _ => 1.0,
        }
    }

    /// Returns the weight `prior` at a joint.
    pub(crate) fn prior_of(&self, joint: Joint) -> f64 {
        match joint {
            Joint::Pelvis | Joint::Spine1 | Joint::Spine2 | Joint::Spine3 => 1000.0 * self.prior,
            joint if is_of_leg(joint) => self.prior / 20.0,
            _ => self.prior,
        }
    }
}

/// Returns whether a joint turns a part of a leg.
pub(crate) fn is_of_leg(joint: Joint) -> bool {
    LEGS.iter().any(|leg| leg.contains(&joint))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_make_no_sense_are_named() {
        assert_eq!(FitOptions::default().check(), Ok(()));
        let invalid = [
            FitOptions {
                stand: f64::NAN,
                ..FitOptions::default()
            },
            FitOptions {
                nearness: 0.0,
                ..FitOptions::default()
            },
            FitOptions {
                placement: 1.5,
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
            FitOptions {
                stride: Some(f64::NAN),
                ..FitOptions::default()
            },
        ];
        let names = [
            "stand",
            "nearness",
            "placement",
            "evaluations",
            "fastest",
            "stride",
        ];
        for (fit, name) in invalid.into_iter().zip(names) {
            let message = fit.check().unwrap_err().to_string();
            assert!(
                message.contains(name) && message.contains("expected"),
                "{message}"
            );
        }
    }
}
