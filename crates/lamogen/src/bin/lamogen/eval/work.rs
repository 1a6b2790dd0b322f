//! From cells of the plan to records.

use lamogen::laban::LabanOptions;
use lamogen::{COMPONENTS, Device, Generation, LabanSeries, Motion, Request, TimeSummary};
use lamogen_eval::{Embeddings, Evaluator};

use super::measure::Measure;
use super::plan::{Cell, Demand, Prompt};
use super::record::{Body, JointTurn, Measured, Outcome, Record, Turning};
use crate::each::generate_each;
use crate::failure::{Code, Failure};
use crate::source::Source;

/// All that makes and measures motions.
pub struct Work<'a> {
    pub source: &'a Source,
    pub evaluator: &'a Evaluator,
    pub prompts: &'a [Prompt],
    pub device: &'a Device,
    /// On what they are measured.
    pub measure: Measure,
}

/// The real motions, one a prompt.
pub struct Real {
    /// Where the evaluator sees them.
    pub points: Embeddings,
    pub bodies: Vec<Body>,
}

/// A motion and the one that it is held against.
struct Pair {
    motion: Motion,
    baseline: Motion,
}

impl Work<'_> {
    /// Whether all requests make sense to the model.
    pub fn check(&self, cells: &[Cell<'_>]) -> Result<(), Failure> {
        for cell in cells {
            let request = cell.request(&self.prompts[cell.prompt]);
            self.source.model.check(&request).map_err(|problem| {
                let caption = self.prompts[cell.prompt].caption(cell.repeat);
                Failure::new(Code::Input, format!("{caption:?}: {problem}"))
            })?;
        }
        Ok(())
    }

    /// Makes and measures some motions.
    pub fn records(&self, cells: &[Cell<'_>]) -> Result<Vec<Record>, Failure> {
        let mut records = Vec::new();
        for (cell, pair) in cells.iter().zip(self.generate(cells)?) {
            let result = match pair.and_then(|pair| self.measure(&pair)) {
                Ok(measured) => Outcome::Motion(Box::new(measured)),
                Err(reason) => Outcome::Failed(reason),
            };
            let key = cell.key();
            records.push(Record { key, result });
        }
        Ok(records)
    }

    fn generate(&self, cells: &[Cell<'_>]) -> Result<Vec<Result<Pair, String>>, Failure> {
        let prompt = |cell: &Cell<'_>| &self.prompts[cell.prompt];
        let of_cell = |cell: &Cell<'_>| -> Vec<Request> {
            let request = cell.request(prompt(cell));
            match cell.demand {
                // An edited prompt does not know what the plain one gives.
                Demand::Phrase(_) => vec![request, cell.baseline(prompt(cell))],
                Demand::Nothing | Demand::Factor(..) => vec![request],
            }
        };
        let requests: Vec<Request> = cells.iter().flat_map(of_cell).collect();
        let mut made = generate_each(&self.source.model, &requests, &mut |_| ())?.into_iter();
        let mut next = || made.next().expect("as many motions as requests");
        let pair = |cell: &Cell<'_>| match cell.demand {
            Demand::Phrase(_) => {
                let (edited, plain) = (next(), next());
                Ok(Pair {
                    motion: edited?.guided,
                    baseline: plain?.baseline,
                })
            }
            Demand::Nothing | Demand::Factor(..) => {
                let Generation {
                    guided, baseline, ..
                } = next()?;
                Ok(Pair {
                    motion: guided,
                    baseline,
                })
            }
        };
        Ok(cells.iter().map(pair).collect())
    }

    fn measure(&self, pair: &Pair) -> Result<Measured, String> {
        let motion = self.measure.subject(&pair.motion)?;
        let baseline = self.measure.subject(&pair.baseline)?;
        // By the same ruler, whatever the guidance measured with.
        let [of_motion, of_baseline] = [&motion, &baseline]
            .map(|subject| LabanSeries::of(&subject.motion, &LabanOptions::default(), self.device));
        let points = self.evaluator.motions(&[motion.features()]);
        let points = points.map_err(|error| error.to_string())?;
        let measured = Measured {
            maximum: wide(of_motion.summary(TimeSummary::Maximum)),
            mean: wide(of_motion.summary(TimeSummary::Mean)),
            baseline_maximum: wide(of_baseline.summary(TimeSummary::Maximum)),
            baseline_mean: wide(of_baseline.summary(TimeSummary::Mean)),
            distance: motion.motion.distance(&baseline.motion).into(),
            body: motion.body(),
            point: points.row(0).to_vec(),
        };
        let is_finite = measured.numbers().all(f64::is_finite);
        match is_finite {
            true => Ok(measured),
            false => Err("the motion's measures are not finite".into()),
        }
    }
}

impl Measured {
    /// All its numbers but the point.
    fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        let features = [
            &self.maximum,
            &self.mean,
            &self.baseline_maximum,
            &self.baseline_mean,
        ];
        let Body {
            sliding,
            sliding_speed,
            ankles,
            jerk,
            drift,
            below_floor,
            turning,
        } = self.body;
        let Turning {
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
        let joints = joints.map(|JointTurn { mean, largest }| [mean, largest]);
        let features = features.into_iter().flatten().copied();
        features
            .chain(feet)
            .chain(single)
            .chain(joints.into_iter().flatten())
    }
}

fn wide(features: [f32; COMPONENTS]) -> [f64; COMPONENTS] {
    features.map(f64::from)
}

/// The failure of something that cannot be judged.
pub fn unjudged(error: impl ToString) -> Failure {
    Failure::new(Code::Run, error)
}
