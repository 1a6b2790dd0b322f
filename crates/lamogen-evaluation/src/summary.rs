//! The figures of the tables, computed from the records.

use std::collections::HashMap;

use lamogen::{COMPONENTS, Component, Tag};
use lamogen_eval::protocol::{Protocol, ProtocolScores};
use lamogen_eval::{
    ChangeMatrix, ControlRange, Embeddings, Estimate, MatchingScore, MetricError, RetrievalBatches,
    diversity, fid, mean_distance, multimodality,
};
use serde::{Serialize, Serializer};

use super::judge::ScoreBasis;
use super::plan::{Condition, EvalPrompt, MethodSetting, Multimodality, planned_motions};
use super::record::{
    BodyMeasurements, JointTurnMeasurements, MotionMeasurements, MotionOutcome, RecordKey,
};
use super::side_effects::{
    SideEffects, WorstMotion, untargeted_change_percentile, untargeted_changes, worst_motions,
};

/// The number of random draws of batches for R-precision.
const DRAWS: u64 = 20;
/// The number of pairs for diversity, if there are more motions than that; otherwise all pairs count.
const PAIRS: usize = 300;

/// The data that the figures are computed from.
pub struct EvalData<'a> {
    pub records: &'a HashMap<RecordKey, MotionOutcome>,
    pub prompts: &'a [EvalPrompt],
    /// The measurements of the prompts' real motions.
    pub bodies: &'a [BodyMeasurements],
    pub scores: ScoreBasis<'a>,
    pub multimodality: Option<&'a Multimodality>,
    pub repeats: u64,
}

/// A cache of figures, since studies share rows with the tables and with each other.
pub struct FigureCache<'a> {
    data: &'a EvalData<'a>,
    figures: Vec<(MethodSetting, SettingFigures)>,
}

impl<'a> FigureCache<'a> {
    pub fn new(data: &'a EvalData<'a>) -> Self {
        FigureCache {
            data,
            figures: Vec::new(),
        }
    }

    /// Returns the figures of a setting; see [`EvalData::figures`].
    pub fn figures(&mut self, setting: &MethodSetting) -> Result<&SettingFigures, MetricError> {
        let place = self.figures.iter().position(|(known, _)| known == setting);
        let place = match place {
            Some(place) => place,
            None => {
                let figures = self.data.figures(setting)?;
                self.figures.push((setting.clone(), figures));
                self.figures.len() - 1
            }
        };
        Ok(&self.figures[place].1)
    }
}

/// The figures of a setting.
#[derive(Clone, Debug, Serialize)]
pub struct SettingFigures {
    /// The name of the setting.
    pub setting: String,
    /// The number of motions.
    pub motions: usize,
    /// The ids of motions that could not be generated, each with the reason.
    pub failed: Vec<(String, String)>,
    /// Control by the maximum over time, as in the paper, if the setting has both tags of every component.
    pub control: Option<ControlTable>,
    /// Control by the mean over time.
    pub control_by_mean: Option<ControlTable>,
    /// The difference between the reached and the requested factor on a component, by the maximum over time.
    pub error: Option<MeanEstimate>,
    /// The changes of the other components.
    #[serde(rename = "stays")]
    pub side_effects: Option<SideEffects>,
    /// The worst motion of every condition.
    pub worst: Vec<WorstMotion>,
    /// R-precision top 1 to 3 in batches of 32.
    pub r_precision: Option<[MeanEstimate; 3]>,
    /// The distance from texts to their motions.
    pub matching: Option<MeanEstimate>,
    pub fid: Option<MeanEstimate>,
    pub diversity: Option<MeanEstimate>,
    /// The mean distance of motions of one text; with the public evaluator only.
    pub multimodality: Option<MeanEstimate>,
    /// The distance of the joints from those of the baseline, in metres.
    pub distance: Option<MeanEstimate>,
    #[serde(flatten)]
    pub bodies: BodyMeans,
}

/// Means of [`BodyMeasurements`] over motions.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BodyMeans {
    pub sliding: Option<MeanEstimate>,
    pub sliding_speed: Option<MeanEstimate>,
    pub ankles: Option<MeanEstimate>,
    pub jerk: Option<MeanEstimate>,
    pub drift: Option<MeanEstimate>,
    pub below_floor: Option<MeanEstimate>,
    pub turning: TurnMeans,
}

/// Means of [`TurnMeasurements`](super::record::TurnMeasurements) over motions.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TurnMeans {
    pub mean: Option<MeanEstimate>,
    pub largest: Option<MeanEstimate>,
    pub pelvis: Option<MeanEstimate>,
    /// The number of snaps in all motions together.
    pub pelvis_snaps: usize,
    pub spine3: JointTurnMeans,
    pub neck: JointTurnMeans,
    pub left_shoulder: JointTurnMeans,
    pub right_shoulder: JointTurnMeans,
}

/// Means of [`JointTurnMeasurements`] over motions.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct JointTurnMeans {
    pub mean: Option<MeanEstimate>,
    pub largest: Option<MeanEstimate>,
}

impl BodyMeans {
    /// Computes the means. `mean` computes that of one measurement, and `all` are the measurements of all motions.
    fn of<'b>(
        all: impl Iterator<Item = &'b BodyMeasurements>,
        mean: impl Fn(&dyn Fn(&BodyMeasurements) -> f64) -> Option<MeanEstimate>,
    ) -> BodyMeans {
        let joint = |turn: fn(&BodyMeasurements) -> JointTurnMeasurements| JointTurnMeans {
            mean: mean(&|body| turn(body).mean),
            largest: mean(&|body| turn(body).largest),
        };
        BodyMeans {
            sliding: mean(&|body| body.sliding),
            sliding_speed: mean(&|body| body.sliding_speed),
            ankles: mean(&|body| body.ankles),
            jerk: mean(&|body| body.jerk),
            drift: mean(&|body| body.drift),
            below_floor: mean(&|body| body.below_floor),
            turning: TurnMeans {
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

/// A mean, and its 95 % confidence interval.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MeanEstimate {
    pub mean: f64,
    /// Half of the width of the interval; `None` for the mean of a single value.
    pub interval: Option<f64>,
}

/// The relative changes of the components when a component is requested by its two tags (table 1 of the paper).
#[derive(Clone, Debug, Serialize)]
pub struct ControlTable {
    /// The means over motions: `[requested component][measured component]`.
    pub mean: [[f64; COMPONENTS]; COMPONENTS],
    /// The standard deviations over motions, in the same order.
    pub std: [[f64; COMPONENTS]; COMPONENTS],
    pub diagonality: f64,
}

impl MeanEstimate {
    /// Computes the mean of values; `None` if there are none.
    fn of(values: impl IntoIterator<Item = f64>) -> Option<MeanEstimate> {
        let values: Vec<f64> = values.into_iter().collect();
        if values.is_empty() {
            return None;
        }
        let is_single = values.len() == 1;
        let Estimate { mean, interval } = Estimate::of(values);
        let interval = (!is_single).then_some(interval);
        Some(MeanEstimate { mean, interval })
    }
}

/// Computes the mean of at least one value.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

/// The measurements of a generated motion, with its condition, prompt and repeat.
pub struct GeneratedMotion<'a> {
    pub condition: Condition,
    /// The place of the prompt among all prompts.
    pub prompt: usize,
    pub repeat: u64,
    pub measured: &'a MotionMeasurements,
}

impl EvalData<'_> {
    /// Computes the figures of a setting. Figures are `None` if no motion was generated yet, or all motions failed.
    fn figures(&self, setting: &MethodSetting) -> Result<SettingFigures, MetricError> {
        let (mut motions, mut failed) = (Vec::new(), Vec::new());
        for planned in planned_motions(setting, self.repeats) {
            let key = planned.key();
            match self.records.get(&key) {
                None => {}
                Some(MotionOutcome::Failed(reason)) => failed.push((key.id, reason.clone())),
                Some(MotionOutcome::Motion(measured)) => motions.push(GeneratedMotion {
                    condition: planned.condition,
                    prompt: planned.prompt,
                    repeat: planned.repeat,
                    measured,
                }),
            }
        }
        // The interval is over repeats; within a repeat all motions have the same weight.
        let over_repeats = |value: &dyn Fn(&GeneratedMotion<'_>) -> Option<f64>| {
            let means = (0..self.repeats).filter_map(|repeat| {
                let motions = motions.iter().filter(|motion| motion.repeat == repeat);
                Some(MeanEstimate::of(motions.filter_map(value))?.mean)
            });
            MeanEstimate::of(means)
        };
        let mean = |value: &dyn Fn(&MotionMeasurements) -> f64| {
            over_repeats(&|motion| Some(value(motion.measured)))
        };
        let scores = self.evaluator_scores(&motions, setting)?;
        let mean_untargeted_change = |motion: &GeneratedMotion<'_>| {
            let changes = untargeted_changes(motion.condition, motion.measured);
            Some(MeanEstimate::of(changes)?.mean)
        };
        let side_effects =
            over_repeats(&mean_untargeted_change).zip(untargeted_change_percentile(&motions));
        let sentence = |prompt: usize, repeat| self.prompts[prompt].caption(repeat);
        Ok(SettingFigures {
            setting: setting.name.clone(),
            motions: motions.len(),
            failed,
            control: control_table(&motions, |measured| measured.maximum)?,
            control_by_mean: control_table(&motions, |measured| measured.mean)?,
            error: over_repeats(&|motion| motion.error()),
            side_effects: side_effects.map(|(mean, percentile_95)| SideEffects {
                mean,
                percentile_95,
            }),
            worst: worst_motions(&setting.conditions, &motions, sentence),
            r_precision: scores.r_precision,
            matching: scores.matching,
            fid: scores.fid,
            diversity: scores.diversity,
            multimodality: self.multimodality_of(setting)?,
            distance: mean(&|measured| measured.distance),
            bodies: BodyMeans::of(
                { motions.iter() }.map(|motion| &motion.measured.body),
                |value| mean(&|measured| value(&measured.body)),
            ),
        })
    }

    /// Computes the scores by the evaluator: first those of the motions of each condition and repeat, then their means.
    fn evaluator_scores(
        &self,
        motions: &[GeneratedMotion<'_>],
        setting: &MethodSetting,
    ) -> Result<EvaluatorScores, MetricError> {
        let mut scores_by_repeat = Vec::new();
        for repeat in 0..self.repeats {
            let mut scores = Vec::new();
            for condition in &setting.conditions {
                let set = motions.iter();
                let set = set.filter(|m| m.condition == *condition && m.repeat == repeat);
                let set: Vec<&GeneratedMotion<'_>> = set.collect();
                if set.len() > 1 {
                    scores.extend(self.set_scores(&set, repeat)?);
                }
            }
            scores_by_repeat.push(scores);
        }
        let over_repeats = |score: &dyn Fn(&MotionSetScores) -> Option<f64>| {
            let means = scores_by_repeat.iter().filter_map(|scores| {
                let values = scores.iter().filter_map(score);
                Some(MeanEstimate::of(values)?.mean)
            });
            MeanEstimate::of(means)
        };
        let ranks = [0, 1, 2].map(|rank| over_repeats(&|set| Some(set.matching?.0[rank])));
        Ok(EvaluatorScores {
            r_precision: all_or_none(ranks),
            matching: over_repeats(&|set| Some(set.matching?.1)),
            fid: over_repeats(&|set| Some(set.fid)),
            diversity: over_repeats(&|set| Some(set.diversity)),
        })
    }

    /// Computes MultiModality: the mean distance of motions of one text. Texts that lack a motion are left out.
    fn multimodality_of(
        &self,
        setting: &MethodSetting,
    ) -> Result<Option<MeanEstimate>, MetricError> {
        let (Some(plan), ScoreBasis::Public(_)) = (self.multimodality, &self.scores) else {
            return Ok(None);
        };
        let mut values = Vec::new();
        for repeat in 0..self.repeats {
            let mut sets = Vec::new();
            for text in plan.planned_motions(setting, repeat) {
                let points = text.map(|planned| match self.records.get(&planned.key())? {
                    MotionOutcome::Motion(measured) => Some(&measured.point[..]),
                    MotionOutcome::Failed(_) => None,
                });
                let points: Option<Vec<&[f32]>> = points.collect();
                if let Some(points) = points.filter(|points| !points.is_empty()) {
                    sets.push(Embeddings::new(points.concat(), points[0].len())?);
                }
            }
            let drawn = Protocol::MULTIMODALITY_PAIRS;
            match sets.first() {
                None => {}
                Some(first) if first.len() > drawn => {
                    values.push(multimodality(&sets, drawn, repeat)?);
                }
                Some(_) => {
                    let distances = sets
                        .iter()
                        .map(mean_distance)
                        .collect::<Result<Vec<_>, _>>();
                    values.push(mean(distances?.into_iter()));
                }
            }
        }
        Ok(MeanEstimate::of(values))
    }

    /// Computes the figures of the real motions.
    pub fn real_motion_figures(&self) -> Result<RealMotionFigures, MetricError> {
        let score = |repeat: u64| match &self.scores {
            ScoreBasis::None => Ok(None),
            ScoreBasis::Public(protocol) => {
                let scores = protocol.real_scores(repeat as usize)?;
                Ok(Some(MotionSetScores::of(&scores)))
            }
            ScoreBasis::Trained { real, .. } => {
                let places: Vec<usize> = (0..self.prompts.len()).collect();
                self.embedding_scores(&places, real, repeat)
            }
        };
        let scores: Vec<Option<MotionSetScores>> =
            (0..self.repeats).map(score).collect::<Result<_, _>>()?;
        let over_repeats = |score: &dyn Fn(&MotionSetScores) -> Option<f64>| {
            MeanEstimate::of(scores.iter().flatten().filter_map(score))
        };
        let ranks = [0, 1, 2].map(|rank| over_repeats(&|set| Some(set.matching?.0[rank])));
        // The motions themselves are those that others are compared with.
        let fid = match &self.scores {
            ScoreBasis::Public(_) => over_repeats(&|set| Some(set.fid)),
            ScoreBasis::Trained { real, others, .. } => {
                let distances = others.iter().map(|other| fid(real, other));
                MeanEstimate::of(distances.collect::<Result<Vec<_>, _>>()?)
            }
            ScoreBasis::None => None,
        };
        Ok(RealMotionFigures {
            bodies: BodyMeans::of(self.bodies.iter(), |value| {
                MeanEstimate::of([mean(self.bodies.iter().map(value))])
            }),
            r_precision: all_or_none(ranks),
            matching: over_repeats(&|set| Some(set.matching?.1)),
            fid,
            diversity: over_repeats(&|set| Some(set.diversity)),
        })
    }

    /// Computes the factor that was reached for every condition of a setting.
    pub fn factor_ratios(&self, setting: &MethodSetting) -> Vec<FactorRatio> {
        let ratios = setting.conditions.iter().filter_map(|&condition| {
            let (component, asked) = condition.factor()?;
            let place = component.index();
            let motions = planned_motions(setting, self.repeats)
                .filter(|planned| planned.condition == condition);
            let ratios = motions.filter_map(|planned| match self.records.get(&planned.key())? {
                MotionOutcome::Motion(measured) if measured.baseline_mean[place] > 0.0 => {
                    Some(measured.mean[place] / measured.baseline_mean[place])
                }
                _ => None,
            });
            Some(FactorRatio {
                component,
                asked,
                reached: MeanEstimate::of(ratios)?.mean,
            })
        });
        ratios.collect()
    }

    /// Computes the scores of motions of one condition and repeat, if there is an evaluator and there are enough.
    fn set_scores(
        &self,
        set: &[&GeneratedMotion<'_>],
        repeat: u64,
    ) -> Result<Option<MotionSetScores>, MetricError> {
        let width = set[0].measured.point.len();
        if width == 0 {
            return Ok(None);
        }
        let points = set.iter().flat_map(|m| m.measured.point.iter().copied());
        let motions = Embeddings::new(points.collect(), width)?;
        let places: Vec<usize> = set.iter().map(|m| m.prompt).collect();
        self.embedding_scores(&places, &motions, repeat)
    }

    /// Computes the scores of embedded motions. `places` are the places of their prompts among all prompts.
    fn embedding_scores(
        &self,
        places: &[usize],
        motions: &Embeddings,
        repeat: u64,
    ) -> Result<Option<MotionSetScores>, MetricError> {
        let (texts, real) = match &self.scores {
            ScoreBasis::None => return Ok(None),
            ScoreBasis::Public(_) if places.len() < RetrievalBatches::SIZE => return Ok(None),
            ScoreBasis::Public(protocol) => {
                let scores = protocol.scores(repeat as usize, places, motions)?;
                return Ok(Some(MotionSetScores::of(&scores)));
            }
            ScoreBasis::Trained { texts, real, .. } => (&texts[repeat as usize], real),
        };
        let places = || places.iter().copied();
        let texts = texts.select(places());
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
        let mean = |value: &dyn Fn(&MatchingScore) -> f64| mean(draws.iter().map(value));
        Ok(Some(MotionSetScores {
            matching: (!draws.is_empty()).then(|| {
                let ranks = [0, 1, 2].map(|rank| mean(&|score| score.r_precision[rank]));
                (ranks, mean(&|score| score.distance))
            }),
            fid: fid(&real.select(places()), motions)?,
            diversity: match motions.len() > PAIRS {
                true => diversity(motions, PAIRS, repeat)?,
                false => mean_distance(motions)?,
            },
        }))
    }
}

/// The figures of the real motions.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RealMotionFigures {
    pub r_precision: Option<[MeanEstimate; 3]>,
    pub matching: Option<MeanEstimate>,
    /// With the public evaluator the distance to other cuts of the same motions, otherwise that to as many real motions of other sentences.
    pub fid: Option<MeanEstimate>,
    pub diversity: Option<MeanEstimate>,
    #[serde(flatten)]
    pub bodies: BodyMeans,
}

/// The factor on a component that was requested, and the one that was reached: the feature of the guided motion divided
/// by that of the baseline, by the means over time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FactorRatio {
    #[serde(serialize_with = "serialize_component")]
    pub component: Component,
    #[serde(serialize_with = "serialize_factor")]
    pub asked: f32,
    #[serde(rename = "came_out")]
    pub reached: f64,
}

/// Serializes a component as its name.
pub fn serialize_component<S: Serializer>(
    component: &Component,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_str(component)
}

/// Serializes a factor in its shortest form: as 0.8, and not as the 64-bit value of the 32-bit number.
pub fn serialize_factor<S: Serializer>(factor: &f32, serializer: S) -> Result<S::Ok, S::Error> {
    let short = factor.to_string().parse();
    serializer.serialize_f64(short.unwrap_or(f64::from(*factor)))
}

/// The evaluator's scores of a set of motions, one for each prompt.
struct MotionSetScores {
    /// R-precision top 1 to 3, and the distance to the texts.
    matching: Option<([f64; 3], f64)>,
    fid: f64,
    diversity: f64,
}

impl MotionSetScores {
    /// Returns the scores of the public evaluation.
    fn of(scores: &ProtocolScores) -> MotionSetScores {
        let matching = scores.matching.as_ref();
        MotionSetScores {
            matching: matching.map(|matching| (matching.r_precision, matching.distance)),
            fid: scores.fid,
            diversity: scores.diversity,
        }
    }
}

/// Returns the three values if all of them are known.
fn all_or_none(ranks: [Option<MeanEstimate>; 3]) -> Option<[MeanEstimate; 3]> {
    match ranks {
        [Some(first), Some(second), Some(third)] => Some([first, second, third]),
        _ => None,
    }
}

/// The evaluator's scores of a setting.
struct EvaluatorScores {
    r_precision: Option<[MeanEstimate; 3]>,
    matching: Option<MeanEstimate>,
    fid: Option<MeanEstimate>,
    diversity: Option<MeanEstimate>,
}

impl GeneratedMotion<'_> {
    /// Returns the difference between the reached and the requested factor on the component.
    fn error(&self) -> Option<f64> {
        let (component, factor) = self.condition.factor()?;
        let place = component.index();
        let (after, before) = (
            self.measured.maximum[place],
            self.measured.baseline_maximum[place],
        );
        (before > 0.0).then(|| (after / before - f64::from(factor)).abs())
    }
}

/// Computes the change matrix of motions with both tags of every component; `None` if a tag has no motions.
fn control_table(
    motions: &[GeneratedMotion<'_>],
    features: impl Fn(&MotionMeasurements) -> [f64; COMPONENTS],
) -> Result<Option<ControlTable>, MetricError> {
    let features_by_motion = |tag: Tag| {
        let has_tag = move |m: &&GeneratedMotion<'_>| {
            m.condition.factor() == Some((tag.component(), tag.scale()))
        };
        let motions = motions.iter().filter(has_tag);
        motions
            .map(|m| ((m.prompt, m.repeat), features(m.measured)))
            .collect::<HashMap<_, _>>()
    };
    let mut rows: Vec<Vec<ControlRange>> = Vec::new();
    for pair in Tag::ALL.chunks_exact(2) {
        let (small, large) = (features_by_motion(pair[0]), features_by_motion(pair[1]));
        let mut both: Vec<_> = small.keys().filter(|key| large.contains_key(key)).collect();
        both.sort_unstable();
        let extremes = both.into_iter().map(|key| ControlRange {
            small: small[key],
            large: large[key],
        });
        rows.push(extremes.collect());
    }
    if rows.iter().any(Vec::is_empty) {
        return Ok(None);
    }
    let matrix = ChangeMatrix::of([0, 1, 2, 3].map(|row| &rows[row][..]))?;
    Ok(Some(ControlTable {
        diagonality: matrix.diagonality(),
        mean: matrix.mean,
        std: matrix.std,
    }))
}
