//! Generation and measurement of the planned motions.

use std::ops::ControlFlow;

use lamogen::laban::LabanOptions;
use lamogen::{COMPONENTS, Device, Generation, LabanSeries, Motion, Request, TimeSummary};

use super::error::{EvaluationError, EvaluationErrorKind};
use super::judge::MotionEvaluator;
use super::measure::MeasurementTarget;
use super::plan::{Condition, EvalPrompt, PlannedMotion};
use super::record::{
    BodyMeasurements, JointTurnMeasurements, MotionMeasurements, MotionOutcome, MotionRecord,
    TurnMeasurements,
};
use lamogen::{LaMoGen, PassError};
use lamogen_model::Denoiser;

/// Generates and measures motions.
pub struct EvalRunner<'a, D> {
    pub model: &'a LaMoGen<D>,
    pub evaluator: MotionEvaluator<'a>,
    pub prompts: &'a [EvalPrompt],
    pub device: &'a Device,
    /// The form of the motions that is measured.
    pub measure: MeasurementTarget,
}

/// A motion and the baseline that it is compared with.
struct MotionPair {
    motion: Motion,
    baseline: Motion,
}

impl<D: Denoiser> EvalRunner<'_, D> {
    /// Checks whether the model can run the requests of all planned motions.
    pub fn check(&self, planned_motions: &[PlannedMotion<'_>]) -> Result<(), EvaluationError> {
        for planned in planned_motions {
            let request = planned.request(&self.prompts[planned.prompt]);
            self.model.check(&request).map_err(|problem| {
                let caption = self.prompts[planned.prompt].caption(planned.repeat);
                EvaluationError::new(
                    EvaluationErrorKind::Input,
                    format!("{caption:?}: {problem}"),
                )
            })?;
        }
        Ok(())
    }

    /// Generates and measures planned motions, and returns their records.
    pub fn records(
        &self,
        planned_motions: &[PlannedMotion<'_>],
    ) -> Result<Vec<MotionRecord>, EvaluationError> {
        let mut records = Vec::new();
        for (planned, pair) in planned_motions.iter().zip(self.generate(planned_motions)?) {
            let result = match pair.and_then(|pair| self.measure(&pair)) {
                Ok(measured) => MotionOutcome::Motion(Box::new(measured)),
                Err(reason) => MotionOutcome::Failed(reason),
            };
            let key = planned.key();
            records.push(MotionRecord { key, result });
        }
        Ok(records)
    }

    /// Generates planned motions and their baselines.
    fn generate(
        &self,
        planned_motions: &[PlannedMotion<'_>],
    ) -> Result<Vec<Result<MotionPair, String>>, EvaluationError> {
        let prompt = |planned: &PlannedMotion<'_>| &self.prompts[planned.prompt];
        let requests_for = |planned: &PlannedMotion<'_>| -> Vec<Request> {
            let request = planned.request(prompt(planned));
            match planned.condition {
                // The generation of an edited prompt does not contain the motion of the original one.
                Condition::Phrase(_) => vec![request, planned.baseline(prompt(planned))],
                Condition::Nothing | Condition::Factor(..) => vec![request],
            }
        };
        let requests: Vec<Request> = planned_motions.iter().flat_map(requests_for).collect();
        let generations = self
            .model
            .generate_each(&requests, &mut |_| ControlFlow::Continue(()))?;
        let reason = |error: PassError| error.to_string();
        let generations = generations.into_iter();
        let mut generations = generations.map(|generation| generation.map_err(reason));
        let mut next = || generations.next().expect("as many motions as requests");
        let pair = |planned: &PlannedMotion<'_>| match planned.condition {
            Condition::Phrase(_) => {
                let (edited, plain) = (next(), next());
                Ok(MotionPair {
                    motion: edited?.guided,
                    baseline: plain?.baseline,
                })
            }
            Condition::Nothing | Condition::Factor(..) => {
                let Generation {
                    guided, baseline, ..
                } = next()?;
                Ok(MotionPair {
                    motion: guided,
                    baseline,
                })
            }
        };
        Ok(planned_motions.iter().map(pair).collect())
    }

    /// Measures a motion and its baseline.
    fn measure(&self, pair: &MotionPair) -> Result<MotionMeasurements, String> {
        let motion = self.measure.measured_motion(&pair.motion)?;
        let baseline = self.measure.measured_motion(&pair.baseline)?;
        // All motions are measured with the same options, whatever the options of guidance are.
        let options = LabanOptions::default();
        let [motion_laban, baseline_laban] = [&motion, &baseline]
            .map(|measured| LabanSeries::of(&measured.motion, &options, self.device));
        let points = self.evaluator.motions(&[motion.features()]);
        let points = points.map_err(|error| error.to_string())?;
        let point = points.map_or(Vec::new(), |points| points.row(0).to_vec());
        let measured = MotionMeasurements {
            maximum: to_f64(motion_laban.summary(TimeSummary::Maximum)),
            mean: to_f64(motion_laban.summary(TimeSummary::Mean)),
            baseline_maximum: to_f64(baseline_laban.summary(TimeSummary::Maximum)),
            baseline_mean: to_f64(baseline_laban.summary(TimeSummary::Mean)),
            distance: motion.motion.distance(&baseline.motion).into(),
            body: motion.body(),
            point,
        };
        let is_finite = measured.numbers().all(f64::is_finite);
        match is_finite {
            true => Ok(measured),
            false => Err("the motion's measures are not finite".into()),
        }
    }
}

impl MotionMeasurements {
    /// Returns all numbers but those of the embedding and the count of snaps.
    fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        let features = [
            &self.maximum,
            &self.mean,
            &self.baseline_maximum,
            &self.baseline_mean,
        ];
        let BodyMeasurements {
            sliding,
            sliding_speed,
            ankles,
            jerk,
            drift,
            below_floor,
            turning,
        } = self.body;
        let TurnMeasurements {
            mean,
            largest,
            pelvis,
            pelvis_snaps: _,
            spine3,
            neck,
            left_shoulder,
            right_shoulder,
        } = turning;
        let feet = [sliding, sliding_speed, ankles];
        let single = [
            self.distance,
            jerk,
            drift,
            below_floor,
            mean,
            largest,
            pelvis,
        ];
        let joints = [spine3, neck, left_shoulder, right_shoulder];
        let joints = joints.map(|JointTurnMeasurements { mean, largest }| [mean, largest]);
        let features = features.into_iter().flatten().copied();
        features
            .chain(feet)
            .chain(single)
            .chain(joints.into_iter().flatten())
    }
}

/// Converts Laban features to 64 bits.
fn to_f64(features: [f32; COMPONENTS]) -> [f64; COMPONENTS] {
    features.map(f64::from)
}

/// Makes the failure of an evaluation that cannot be computed.
pub fn evaluation_failure(error: impl ToString) -> EvaluationError {
    EvaluationError::new(EvaluationErrorKind::Generation, error)
}
