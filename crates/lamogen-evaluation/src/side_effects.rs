//! The side effects of tags: changes of components that were not requested, and the motions that follow their tags
//! least.

use lamogen::{COMPONENTS, Component, Tag};
use serde::Serialize;

use super::measure::quantile;
use super::plan::Condition;
use super::record::MotionMeasurements;
use super::summary::{GeneratedMotion, MeanEstimate, serialize_component, serialize_factor};

/// How much components change that were not requested: guided over baseline, minus 1, as an absolute value, by the maxima
/// over time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SideEffects {
    pub mean: MeanEstimate,
    /// The 95th percentile of the changes.
    #[serde(rename = "most")]
    pub percentile_95: f64,
}

/// The motion that followed a condition least, by the maximum over time.
#[derive(Clone, Debug, Serialize)]
pub struct WorstMotion {
    /// The tag, or the component and the factor if the condition is not that of a tag.
    #[serde(rename = "demand")]
    pub condition: String,
    #[serde(serialize_with = "serialize_component")]
    pub component: Component,
    /// The factor that was requested.
    #[serde(serialize_with = "serialize_factor")]
    pub asked: f32,
    /// The feature of the guided motion, divided by that of the baseline.
    pub ratio: f64,
    /// The share of the requested change that was reached: 1 is all of it, and below 0 the feature changed in the other
    /// direction.
    pub share: f64,
    /// The sentence of the motion.
    pub prompt: String,
    pub repeat: u64,
}

/// Returns how much the components of a motion change that were not requested. Components that are 0 in the baseline
/// are left out.
pub fn untargeted_changes(condition: Condition, measured: &MotionMeasurements) -> Vec<f64> {
    let requested = condition.factor().map(|(component, _)| component.index());
    let others = (0..COMPONENTS).filter(|place| requested.is_some_and(|index| index != *place));
    let ratios = others.filter_map(|place| ratio(measured, place));
    ratios.map(|ratio| (ratio - 1.0).abs()).collect()
}

/// Returns the maximum over time of a component, divided by that of the baseline; `None` if the latter is 0.
fn ratio(measured: &MotionMeasurements, place: usize) -> Option<f64> {
    let before = measured.baseline_maximum[place];
    (before > 0.0).then(|| measured.maximum[place] / before)
}

/// Returns the 95th percentile of the changes of components that were not requested. Motions without a requested change
/// do not count.
pub fn untargeted_change_percentile(motions: &[GeneratedMotion<'_>]) -> Option<f64> {
    let all = motions
        .iter()
        .flat_map(|motion| untargeted_changes(motion.condition, motion.measured));
    quantile(all.collect(), 0.95)
}

/// Returns the worst motion of every condition that requests a change. `prompt` returns the sentence for the place of a
/// prompt and a repeat.
pub fn worst_motions<'p>(
    conditions: &[Condition],
    motions: &[GeneratedMotion<'_>],
    prompt: impl Fn(usize, u64) -> &'p str,
) -> Vec<WorstMotion> {
    let worst_of_condition = |condition: &Condition| {
        let (component, asked) = condition.factor()?;
        let change = f64::from(asked) - 1.0;
        if change == 0.0 {
            return None;
        }
        let motions = { motions.iter() }.filter(|motion| motion.condition == *condition);
        let shares = motions.filter_map(|motion| {
            let ratio = ratio(motion.measured, component.index())?;
            Some((motion, ratio, (ratio - 1.0) / change))
        });
        let (motion, ratio, share) = shares.min_by(|a, b| a.2.total_cmp(&b.2))?;
        let tag = { Tag::ALL.into_iter() }
            .find(|tag| (tag.component(), tag.scale()) == (component, asked));
        Some(WorstMotion {
            condition: tag.map_or(format!("{component} {asked}"), |tag| tag.to_string()),
            component,
            asked,
            ratio,
            share,
            prompt: prompt(motion.prompt, motion.repeat).to_owned(),
            repeat: motion.repeat,
        })
    };
    conditions.iter().filter_map(worst_of_condition).collect()
}

#[cfg(test)]
mod tests {
    use super::super::record::{BodyMeasurements, JointTurnMeasurements, TurnMeasurements};
    use super::*;

    /// Makes the measurements of a motion with these features, and with a baseline of 2 for all components.
    fn measured(maximum: [f64; COMPONENTS]) -> MotionMeasurements {
        let still = JointTurnMeasurements {
            mean: 0.0,
            largest: 0.0,
        };
        MotionMeasurements {
            maximum,
            mean: [0.0; COMPONENTS],
            baseline_maximum: [2.0; COMPONENTS],
            baseline_mean: [0.0; COMPONENTS],
            distance: 0.0,
            body: BodyMeasurements {
                sliding: 0.0,
                sliding_speed: 0.0,
                ankles: 0.0,
                jerk: 0.0,
                drift: 0.0,
                below_floor: 0.0,
                turning: TurnMeasurements {
                    mean: 0.0,
                    largest: 0.0,
                    pelvis: 0.0,
                    pelvis_snaps: 0,
                    spine3: still,
                    neck: still,
                    left_shoulder: still,
                    right_shoulder: still,
                },
            },
            point: Vec::new(),
        }
    }

    const STRONG: Condition = Condition::Factor(Component::Weight, 1.5);
    const LIGHT: Condition = Condition::Phrase(Tag::Light);

    fn generated(
        condition: Condition,
        prompt: usize,
        measured: &MotionMeasurements,
    ) -> GeneratedMotion<'_> {
        GeneratedMotion {
            condition,
            prompt,
            repeat: 0,
            measured,
        }
    }

    #[test]
    fn changes_are_those_of_components_that_were_not_requested() {
        let motion = measured([3.0, 2.0, 1.0, 2.5]);
        assert_eq!(untargeted_changes(STRONG, &motion), [0.0, 0.5, 0.25]);
        assert!(untargeted_changes(Condition::Nothing, &motion).is_empty());
        let mut bare = motion.clone();
        bare.baseline_maximum[1] = 0.0;
        assert_eq!(untargeted_changes(STRONG, &bare), [0.5, 0.25]);
        let all = [
            generated(STRONG, 0, &motion),
            generated(Condition::Nothing, 0, &bare),
        ];
        // The interpolation goes 0.9 of the way from 0.25 to 0.5.
        let most = untargeted_change_percentile(&all).unwrap();
        assert!((most - 0.475).abs() < 1e-12, "{most}");
        assert_eq!(untargeted_change_percentile(&all[1..]), None);
    }

    #[test]
    fn the_worst_motion_reaches_the_smallest_share_of_the_requested_change() {
        let followed = measured([3.0, 2.0, 2.0, 2.0]);
        let half = measured([2.5, 2.0, 2.0, 2.0]);
        let lighter = measured([1.0, 2.0, 2.0, 2.0]);
        let other_way = measured([2.2, 2.0, 2.0, 2.0]);
        let all = [
            generated(STRONG, 0, &followed),
            generated(STRONG, 1, &half),
            generated(LIGHT, 1, &lighter),
            generated(LIGHT, 2, &other_way),
            generated(Condition::Factor(Component::Weight, 1.0), 0, &followed),
        ];
        let conditions = [
            STRONG,
            LIGHT,
            Condition::Factor(Component::Weight, 1.0),
            Condition::Factor(Component::Flow, 0.7),
            Condition::Nothing,
        ];
        let sentence = |prompt: usize, _| ["a", "b", "c"][prompt];
        let found = worst_motions(&conditions, &all, sentence);
        let worst = found
            .iter()
            .map(|worst| (&*worst.condition, &*worst.prompt));
        assert_eq!(worst.collect::<Vec<_>>(), [("strong", "b"), ("light", "c")]);
        assert_eq!((found[0].ratio, found[0].share), (1.25, 0.5));
        let factor = f64::from(Tag::Light.scale());
        let share = (1.1 - 1.0) / (factor - 1.0);
        assert!((found[1].share - share).abs() < 1e-12 && share < 0.0);
    }
}
