//! From records to the figures of the tables.

use std::collections::HashMap;

use lamogen::{COMPONENTS, Component, Tag};
use lamogen_eval::{
    ChangeMatrix, ControlExtremes, Embeddings, Estimate, MatchingScore, MetricError,
    RetrievalBatches, diversity, fid, mean_distance,
};
use serde::{Serialize, Serializer};

use super::plan::{Demand, Prompt, Setting, cells};
use super::record::{Body, JointTurn, Key, Measured, Outcome};
use super::stays::{Stays, Worst, changes, most_of_changes, worst};
use super::work::Real;

/// Draws of batches behind R-precision.
const DRAWS: u64 = 20;
/// Pairs behind diversity, if there are more motions than that; else all pairs count.
const PAIRS: usize = 300;

/// All that the figures come from.
pub struct Evidence<'a> {
    pub records: &'a HashMap<Key, Outcome>,
    pub prompts: &'a [Prompt],
    /// `[repeat]`: the captions of all prompts where the evaluator sees them.
    pub texts: &'a [Embeddings],
    pub real: &'a Real,
    pub repeats: u64,
}

/// Figures that were computed, each once: studies share rows with the tables and with each other.
pub struct Known<'a> {
    evidence: &'a Evidence<'a>,
    figures: Vec<(Setting, Figures)>,
}

impl<'a> Known<'a> {
    pub fn new(evidence: &'a Evidence<'a>) -> Self {
        Known {
            evidence,
            figures: Vec::new(),
        }
    }

    /// The figures of a setting; see [`Evidence::figures`].
    pub fn figures(&mut self, setting: &Setting) -> Result<&Figures, MetricError> {
        let found = self.figures.iter().position(|(of, _)| of == setting);
        let place = match found {
            Some(place) => place,
            None => {
                let figures = self.evidence.figures(setting)?;
                self.figures.push((setting.clone(), figures));
                self.figures.len() - 1
            }
        };
        Ok(&self.figures[place].1)
    }
}

/// What is known of a setting.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    pub setting: String,
    pub motions: usize,
    /// Motions that could not be made, and why.
    pub failed: Vec<(String, String)>,
    /// By the maximum over time, as in the paper; where both tags of every component were asked for.
    pub control: Option<Control>,
    /// By the mean over time.
    pub control_by_mean: Option<Control>,
    /// How far the component that was asked for is from what was asked, relative to the baseline, by the maximum over time.
    pub error: Option<Mean>,
    /// Of the other components.
    pub stays: Option<Stays>,
    /// One for every demand.
    pub worst: Vec<Worst>,
    /// Top 1 to 3 of batches of 32.
    pub r_precision: Option<[Mean; 3]>,
    pub matching: Option<Mean>,
    pub fid: Option<Mean>,
    pub diversity: Option<Mean>,
    pub distance: Option<Mean>,
    #[serde(flatten)]
    pub bodies: Bodies,
}

/// Means of what is known of motions by their joints alone: see [`Body`].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Bodies {
    pub sliding: Option<Mean>,
    pub sliding_speed: Option<Mean>,
    pub ankles: Option<Mean>,
    pub jerk: Option<Mean>,
    pub drift: Option<Mean>,
    pub below_floor: Option<Mean>,
    pub turning: Turnings,
}

/// Means of [`Turning`](super::record::Turning).
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Turnings {
    pub mean: Option<Mean>,
    pub largest: Option<Mean>,
    pub pelvis: Option<Mean>,
    /// Of all motions together.
    pub pelvis_snaps: usize,
    pub spine3: JointTurns,
    pub neck: JointTurns,
    pub left_shoulder: JointTurns,
    pub right_shoulder: JointTurns,
}

/// Means of [`JointTurn`].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct JointTurns {
    pub mean: Option<Mean>,
    pub largest: Option<Mean>,
}

impl Bodies {
    /// Of all bodies, by what takes their mean.
    fn of<'b>(
        all: impl Iterator<Item = &'b Body>,
        mean: impl Fn(&dyn Fn(&Body) -> f64) -> Option<Mean>,
    ) -> Bodies {
        let joint = |of: fn(&Body) -> JointTurn| JointTurns {
            mean: mean(&|body| of(body).mean),
            largest: mean(&|body| of(body).largest),
        };
        Bodies {
            sliding: mean(&|body| body.sliding),
            sliding_speed: mean(&|body| body.sliding_speed),
            ankles: mean(&|body| body.ankles),
            jerk: mean(&|body| body.jerk),
            drift: mean(&|body| body.drift),
            below_floor: mean(&|body| body.below_floor),
            turning: Turnings {
                mean: mean(&|body| body.turning.mean),
                largest: mean(&|body| body.turning.largest),
                pelvis: mean(&|body| body.turning.pelvis),
                pelvis_snaps: all.map(|body| body.turning.pelvis_snaps).sum(),
                spine3: joint(|body| body.turning.spine3),
                neck: joint(|body| body.turning.neck),
                left_shoulder: joint(|body| body.turning.left_shoulder),
                right_shoulder: joint(|body| body.turning.right_shoulder),
            },
        }
    }
}

/// A mean with half of its 95 % interval, if it is of more than one.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Mean {
    pub mean: f64,
    pub interval: Option<f64>,
}

/// The paper's table 1.
#[derive(Clone, Debug, Serialize)]
pub struct Control {
    /// `[asked component][measured component]`
    pub mean: [[f64; COMPONENTS]; COMPONENTS],
    pub std: [[f64; COMPONENTS]; COMPONENTS],
    pub diagonality: f64,
}

impl Mean {
    fn of(values: impl IntoIterator<Item = f64>) -> Option<Mean> {
        let values: Vec<f64> = values.into_iter().collect();
        if values.is_empty() {
            return None;
        }
        let is_single = values.len() == 1;
        let Estimate { mean, interval } = Estimate::of(values);
        let interval = (!is_single).then_some(interval);
        Some(Mean { mean, interval })
    }
}

/// Of at least one number.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

/// A motion of a setting, and what it was to be.
pub struct Made<'a> {
    pub demand: Demand,
    pub prompt: usize,
    pub repeat: u64,
    pub measured: &'a Measured,
}

impl Evidence<'_> {
    /// The figures of a setting; those of none where nothing of it was made yet, or all failed.
    fn figures(&self, setting: &Setting) -> Result<Figures, MetricError> {
        let (mut made, mut failed) = (Vec::new(), Vec::new());
        for cell in cells(setting, self.repeats) {
            let key = cell.key();
            match self.records.get(&key) {
                None => {}
                Some(Outcome::Failed(reason)) => failed.push((key.id, reason.clone())),
                Some(Outcome::Motion(measured)) => made.push(Made {
                    demand: cell.demand,
                    prompt: cell.prompt,
                    repeat: cell.repeat,
                    measured,
                }),
            }
        }
        // Repeats are what the interval is over; within one all motions count alike.
        let over_repeats = |of: &dyn Fn(&Made<'_>) -> Option<f64>| {
            let means = (0..self.repeats).filter_map(|repeat| {
                let values = made.iter().filter(|m| m.repeat == repeat).filter_map(of);
                Some(Mean::of(values)?.mean)
            });
            Mean::of(means)
        };
        let mean = |of: &dyn Fn(&Measured) -> f64| over_repeats(&|made| Some(of(made.measured)));
        let judged = self.judged(&made, setting)?;
        let of_others = |made: &Made<'_>| {
            let changes = changes(made.demand, made.measured);
            Some(Mean::of(changes)?.mean)
        };
        let stays = over_repeats(&of_others).zip(most_of_changes(&made));
        let sentence = |prompt: usize, repeat| self.prompts[prompt].caption(repeat);
        Ok(Figures {
            setting: setting.name.clone(),
            motions: made.len(),
            failed,
            control: control(&made, |measured| measured.maximum)?,
            control_by_mean: control(&made, |measured| measured.mean)?,
            error: over_repeats(&|made| made.error()),
            stays: stays.map(|(mean, most)| Stays { mean, most }),
            worst: worst(&setting.demands, &made, sentence),
            r_precision: judged.r_precision,
            matching: judged.matching,
            fid: judged.fid,
            diversity: judged.diversity,
            distance: mean(&|measured| measured.distance),
            bodies: Bodies::of({ made.iter() }.map(|made| &made.measured.body), |of| {
                mean(&|measured| of(&measured.body))
            }),
        })
    }

    /// What the evaluator says: of the motions of each demand and repeat, and then the mean.
    fn judged(&self, made: &[Made<'_>], setting: &Setting) -> Result<Judged, MetricError> {
        let mut found = Vec::new();
        for repeat in 0..self.repeats {
            let mut of_repeat = Vec::new();
            for demand in &setting.demands {
                let set = made.iter();
                let set = set.filter(|m| m.demand == *demand && m.repeat == repeat);
                let set: Vec<&Made<'_>> = set.collect();
                if set.len() > 1 {
                    of_repeat.push(self.seen(&set, repeat)?);
                }
            }
            found.push(of_repeat);
        }
        let over_repeats = |of: &dyn Fn(&Seen) -> Option<f64>| {
            let means = found.iter().filter_map(|seen| {
                let values = seen.iter().filter_map(of);
                Some(Mean::of(values)?.mean)
            });
            Mean::of(means)
        };
        let ranks = [0, 1, 2].map(|rank| over_repeats(&|seen| Some(seen.matching?.0[rank])));
        Ok(Judged {
            r_precision: together(ranks),
            matching: over_repeats(&|seen| Some(seen.matching?.1)),
            fid: over_repeats(&|seen| Some(seen.fid)),
            diversity: over_repeats(&|seen| Some(seen.diversity)),
        })
    }

    /// What the evaluator says of the real motions.
    pub fn of_real(&self) -> Result<OfReal, MetricError> {
        let places: Vec<usize> = (0..self.prompts.len()).collect();
        let seen = { 0..self.repeats }.map(|repeat| self.see(&places, &self.real.points, repeat));
        let seen: Vec<Seen> = seen.collect::<Result<_, _>>()?;
        let over = |of: &dyn Fn(&Seen) -> Option<f64>| Mean::of(seen.iter().filter_map(of));
        let ranks = [0, 1, 2].map(|rank| over(&|seen| Some(seen.matching?.0[rank])));
        Ok(OfReal {
            bodies: Bodies::of(self.real.bodies.iter(), |of| {
                Mean::of([mean(self.real.bodies.iter().map(of))])
            }),
            r_precision: together(ranks),
            matching: over(&|seen| Some(seen.matching?.1)),
            diversity: over(&|seen| Some(seen.diversity)),
        })
    }

    /// What came out for every demand of a setting.
    pub fn ratios(&self, setting: &Setting) -> Vec<Ratio> {
        let found = setting.demands.iter().filter_map(|&demand| {
            let (component, asked) = demand.factor()?;
            let place = component.index();
            let of_demand = cells(setting, self.repeats).filter(|cell| cell.demand == demand);
            let ratios = of_demand.filter_map(|cell| match self.records.get(&cell.key())? {
                Outcome::Motion(measured) if measured.baseline_mean[place] > 0.0 => {
                    Some(measured.mean[place] / measured.baseline_mean[place])
                }
                _ => None,
            });
            Some(Ratio {
                component,
                asked,
                came_out: Mean::of(ratios)?.mean,
            })
        });
        found.collect()
    }

    /// What the evaluator says of motions of one demand and repeat.
    fn seen(&self, set: &[&Made<'_>], repeat: u64) -> Result<Seen, MetricError> {
        let width = set[0].measured.point.len();
        let points = set.iter().flat_map(|m| m.measured.point.iter().copied());
        let motions = Embeddings::new(points.collect(), width)?;
        let places: Vec<usize> = set.iter().map(|m| m.prompt).collect();
        self.see(&places, &motions, repeat)
    }

    /// What the evaluator says of motions of these prompts.
    fn see(
        &self,
        places: &[usize],
        motions: &Embeddings,
        repeat: u64,
    ) -> Result<Seen, MetricError> {
        let places = || places.iter().copied();
        let texts = self.texts[repeat as usize].select(places());
        let captions = places().map(|prompt| self.prompts[prompt].caption(repeat));
        let captions: Vec<&str> = captions.collect();
        let mut draws = Vec::new();
        for draw in 0..DRAWS {
            let RetrievalBatches { batches, .. } =
                RetrievalBatches::distinct(&captions, RetrievalBatches::SIZE, draw);
            if batches.is_empty() {
                break;
            }
            draws.push(MatchingScore::of(&texts, motions, &batches)?);
        }
        let mean = |of: &dyn Fn(&MatchingScore) -> f64| mean(draws.iter().map(of));
        Ok(Seen {
            matching: (!draws.is_empty()).then(|| {
                let ranks = [0, 1, 2].map(|rank| mean(&|found| found.r_precision[rank]));
                (ranks, mean(&|found| found.distance))
            }),
            fid: fid(&self.real.points.select(places()), motions)?,
            diversity: match motions.len() > PAIRS {
                true => diversity(motions, PAIRS, repeat)?,
                false => mean_distance(motions)?,
            },
        })
    }
}

/// What the evaluator says of real motions.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct OfReal {
    pub r_precision: Option<[Mean; 3]>,
    pub matching: Option<Mean>,
    pub diversity: Option<Mean>,
    #[serde(flatten)]
    pub bodies: Bodies,
}

/// What came out when a component was asked for by a factor: guided over baseline, by the mean over time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Ratio {
    #[serde(serialize_with = "name")]
    pub component: Component,
    #[serde(serialize_with = "short")]
    pub asked: f32,
    pub came_out: f64,
}

pub fn name<S: Serializer>(component: &Component, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(component)
}

/// 0.8 rather than the nearest number of more bits.
pub fn short<S: Serializer>(factor: &f32, serializer: S) -> Result<S::Ok, S::Error> {
    let short = factor.to_string().parse();
    serializer.serialize_f64(short.unwrap_or(f64::from(*factor)))
}

/// What the evaluator says of a set of motions, one a prompt.
struct Seen {
    /// R-precision and distance to the texts.
    matching: Option<([f64; 3], f64)>,
    fid: f64,
    diversity: f64,
}

/// All three or none.
fn together(ranks: [Option<Mean>; 3]) -> Option<[Mean; 3]> {
    match ranks {
        [Some(first), Some(second), Some(third)] => Some([first, second, third]),
        _ => None,
    }
}

struct Judged {
    r_precision: Option<[Mean; 3]>,
    matching: Option<Mean>,
    fid: Option<Mean>,
    diversity: Option<Mean>,
}

impl Made<'_> {
    /// How far the asked component is from what was asked, relative to the baseline.
    fn error(&self) -> Option<f64> {
        let (component, factor) = self.demand.factor()?;
        let place = component.index();
        let (found, before) = (
            self.measured.maximum[place],
            self.measured.baseline_maximum[place],
        );
        (before > 0.0).then(|| (found / before - f64::from(factor)).abs())
    }
}

/// The change matrix of motions with both tags of every component; none where a tag was not asked for.
fn control(
    made: &[Made<'_>],
    features: impl Fn(&Measured) -> [f64; COMPONENTS],
) -> Result<Option<Control>, MetricError> {
    let with = |tag: Tag| {
        let of_tag = move |m: &&Made<'_>| m.demand.factor() == Some((tag.component(), tag.scale()));
        let made = made.iter().filter(of_tag);
        made.map(|m| ((m.prompt, m.repeat), features(m.measured)))
            .collect::<HashMap<_, _>>()
    };
    let mut rows: Vec<Vec<ControlExtremes>> = Vec::new();
    for pair in Tag::ALL.chunks_exact(2) {
        let (small, large) = (with(pair[0]), with(pair[1]));
        let mut both: Vec<_> = small.keys().filter(|key| large.contains_key(key)).collect();
        both.sort_unstable();
        let extremes = both.into_iter().map(|key| ControlExtremes {
            small: small[key],
            large: large[key],
        });
        rows.push(extremes.collect());
    }
    if rows.iter().any(Vec::is_empty) {
        return Ok(None);
    }
    let matrix = ChangeMatrix::of([0, 1, 2, 3].map(|row| &rows[row][..]))?;
    Ok(Some(Control {
        diagonality: matrix.diagonality(),
        mean: matrix.mean,
        std: matrix.std,
    }))
}
