//! What a tag leaves alone, and the motion that follows it least.

use lamogen::{COMPONENTS, Component, Tag};
use serde::Serialize;

use super::measure::quantile;
use super::plan::Demand;
use super::record::Measured;
use super::summary::{Made, Mean, name, short};

/// How much the components change that were not asked for: guided over baseline, less 1, without its sign, by the maximum over time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Stays {
    pub mean: Mean,
    /// 95 of 100 change by less.
    pub most: f64,
}

/// The motion that followed a demand least, by the maximum over time.
#[derive(Clone, Debug, Serialize)]
pub struct Worst {
    /// The tag, or else component and factor.
    pub demand: String,
    #[serde(serialize_with = "name")]
    pub component: Component,
    #[serde(serialize_with = "short")]
    pub asked: f32,
    /// Guided over baseline.
    pub ratio: f64,
    /// How much of the change that was asked for that is: all is 1, and below 0 it went the other way.
    pub share: f64,
    /// Its sentence.
    pub prompt: String,
    pub repeat: u64,
}

/// How much components change that were not asked for; of those that the baseline has.
pub fn changes(demand: Demand, measured: &Measured) -> Vec<f64> {
    let asked = demand.factor().map(|(component, _)| component.index());
    let others = (0..COMPONENTS).filter(|place| asked.is_some_and(|asked| asked != *place));
    let ratios = others.filter_map(|place| ratio(measured, place));
    ratios.map(|ratio| (ratio - 1.0).abs()).collect()
}

/// Guided over baseline, by the maximum over time; none where the baseline has nothing.
fn ratio(measured: &Measured, place: usize) -> Option<f64> {
    let before = measured.baseline_maximum[place];
    (before > 0.0).then(|| measured.maximum[place] / before)
}

/// What 95 of 100 changes are below, of motions of which something was asked.
pub fn most_of_changes(made: &[Made<'_>]) -> Option<f64> {
    let all = made
        .iter()
        .flat_map(|made| changes(made.demand, made.measured));
    quantile(all.collect(), 0.95)
}

/// The worst motion of every demand that asks for a change; `prompt` gives the sentence of a prompt and a repeat.
pub fn worst<'p>(
    demands: &[Demand],
    made: &[Made<'_>],
    prompt: impl Fn(usize, u64) -> &'p str,
) -> Vec<Worst> {
    let of_demand = |demand: &Demand| {
        let (component, asked) = demand.factor()?;
        let change = f64::from(asked) - 1.0;
        if change == 0.0 {
            return None;
        }
        let own = made.iter().filter(|made| made.demand == *demand);
        let shares = own.filter_map(|made| {
            let ratio = ratio(made.measured, component.index())?;
            Some((made, ratio, (ratio - 1.0) / change))
        });
        let (made, ratio, share) = shares.min_by(|a, b| a.2.total_cmp(&b.2))?;
        let tag = { Tag::ALL.into_iter() }
            .find(|tag| (tag.component(), tag.scale()) == (component, asked));
        Some(Worst {
            demand: tag.map_or(format!("{component} {asked}"), |tag| tag.to_string()),
            component,
            asked,
            ratio,
            share,
            prompt: prompt(made.prompt, made.repeat).to_owned(),
            repeat: made.repeat,
        })
    };
    demands.iter().filter_map(of_demand).collect()
}

#[cfg(test)]
mod tests {
    use super::super::record::{Body, JointTurn, Turning};
    use super::*;

    /// A motion with these features over a baseline of 2 everywhere.
    fn measured(maximum: [f64; COMPONENTS]) -> Measured {
        let still = JointTurn {
            mean: 0.0,
            largest: 0.0,
        };
        Measured {
            maximum,
            mean: [0.0; COMPONENTS],
            baseline_maximum: [2.0; COMPONENTS],
            baseline_mean: [0.0; COMPONENTS],
            distance: 0.0,
            body: Body {
                sliding: 0.0,
                sliding_speed: 0.0,
                ankles: 0.0,
                jerk: 0.0,
                drift: 0.0,
                below_floor: 0.0,
                turning: Turning {
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

    const STRONG: Demand = Demand::Factor(Component::Weight, 1.5);
    const LIGHT: Demand = Demand::Phrase(Tag::Light);

    fn made(demand: Demand, prompt: usize, measured: &Measured) -> Made<'_> {
        Made {
            demand,
            prompt,
            repeat: 0,
            measured,
        }
    }

    #[test]
    fn what_was_asked_is_no_change_of_others_and_nothing_asked_is_none() {
        let motion = measured([3.0, 2.0, 1.0, 2.5]);
        assert_eq!(changes(STRONG, &motion), [0.0, 0.5, 0.25]);
        assert!(changes(Demand::Nothing, &motion).is_empty());
        let mut bare = motion.clone();
        bare.baseline_maximum[1] = 0.0;
        assert_eq!(changes(STRONG, &bare), [0.5, 0.25]);
        let all = [made(STRONG, 0, &motion), made(Demand::Nothing, 0, &bare)];
        // Between 0.25 and 0.5, at 0.9 of the way.
        let most = most_of_changes(&all).unwrap();
        assert!((most - 0.475).abs() < 1e-12, "{most}");
        assert_eq!(most_of_changes(&all[1..]), None);
    }

    #[test]
    fn the_worst_motion_of_every_tag_is_the_one_that_reaches_least_of_it() {
        let followed = measured([3.0, 2.0, 2.0, 2.0]);
        let half = measured([2.5, 2.0, 2.0, 2.0]);
        let lighter = measured([1.0, 2.0, 2.0, 2.0]);
        let other_way = measured([2.2, 2.0, 2.0, 2.0]);
        let all = [
            made(STRONG, 0, &followed),
            made(STRONG, 1, &half),
            made(LIGHT, 1, &lighter),
            made(LIGHT, 2, &other_way),
            made(Demand::Factor(Component::Weight, 1.0), 0, &followed),
        ];
        let demands = [
            STRONG,
            LIGHT,
            Demand::Factor(Component::Weight, 1.0),
            Demand::Factor(Component::Flow, 0.7),
            Demand::Nothing,
        ];
        let sentence = |prompt: usize, _| ["a", "b", "c"][prompt];
        let found = worst(&demands, &all, sentence);
        let told = found.iter().map(|worst| (&*worst.demand, &*worst.prompt));
        assert_eq!(told.collect::<Vec<_>>(), [("strong", "b"), ("light", "c")]);
        assert_eq!((found[0].ratio, found[0].share), (1.25, 0.5));
        let factor = f64::from(Tag::Light.scale());
        let share = (1.1 - 1.0) / (factor - 1.0);
        assert!((found[1].share - share).abs() < 1e-12 && share < 0.0);
    }
}
