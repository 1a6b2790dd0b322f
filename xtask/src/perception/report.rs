//! The tables of the page.

use std::error::Error;
use std::fmt::Write;

use burn::tensor::Device;
use lamogen_files::{ReadOptions, read};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use super::choice::{Choice, ChoiceModel, predictable};
use super::measures::Measure;
use super::study::{Effort, PAIRS, Study};

/// The names of the features.
const FEATURES: [&str; 4] = ["Weight", "Time", "Flow", "Shape"];
/// The number of groups of clips of which one is held out.
const GROUPS: usize = 5;
/// How often clips are drawn anew for intervals.
const DRAWS: usize = 400;
/// How often clips are drawn anew for intervals of weights, which are fitted each time.
const FITTED_DRAWS: usize = 200;
/// Two clips are about equal in a feature if their ratio is below this.
const EQUAL: f64 = 1.1;
/// The ratios that the curve is divided at.
const RATIOS: [f64; 12] = [
    1.0,
    1.05,
    1.1,
    1.15,
    1.2,
    1.3,
    1.4,
    1.6,
    1.8,
    2.2,
    3.0,
    f64::INFINITY,
];

/// Measures the clips in every way, and returns the page.
pub fn page(
    study: &Study,
    device: &Device,
    observer: &mut dyn FnMut(&str),
) -> Result<String, Box<dyn Error>> {
    let mut analysis = Analysis::new(study);
    let mut rows = Vec::new();
    let mut by_summary = Vec::new();
    for measure in Measure::all() {
        observer(&format!("{}: {}", measure.group, measure.name));
        let features = measure.features(&study.clips, device)?;
        rows.push(analysis.row(measure.group, measure.name, &features));
        if matches!(measure.name, "maximum") || rows.len() == 1 {
            by_summary.push((rows.len() == 1, features));
        }
    }
    let (mean, maximum) = (&by_summary[0].1, &by_summary[1].1);
    for (name, features) in [("mean", mean), ("maximum", maximum)] {
        for (place, feature) in FEATURES.iter().enumerate() {
            let alone: Vec<Vec<f64>> = features.iter().map(|all| vec![all[place]]).collect();
            rows.push(analysis.row("one feature", &format!("{feature}, {name}"), &alone));
        }
    }
    let durations = study.clips.iter().map(|clip| {
        let read = read(&clip.path, &ReadOptions::default())?;
        Ok(vec![f64::from(read.motion.seconds()).ln()])
    });
    let durations: Vec<Vec<f64>> = durations.collect::<Result<_, Box<dyn Error>>>()?;
    rows.push(analysis.row("for comparison", "the duration of the clip", &durations));
    let labels = study.clips.iter().map(|clip| clip.effort.map(f64::from));
    let labels: Vec<[f64; 4]> = labels.collect();
    let all: Vec<Vec<f64>> = labels.iter().map(|labels| labels.to_vec()).collect();
    rows.push(analysis.row("for comparison", "the four authored labels", &all));
    let time: Vec<Vec<f64>> = labels.iter().map(|labels| vec![labels[2]]).collect();
    rows.push(analysis.row("for comparison", "the authored label of Time", &time));
    let none = vec![Vec::new(); study.clips.len()];
    rows.push(analysis.row("for comparison", "the places on the screen alone", &none));

    observer("weights and curves");
    let mut page = String::new();
    predictions(&mut page, study, &rows)?;
    labels_of_features(&mut page, study, mean, &labels)?;
    curves(&mut page, &analysis, mean)?;
    thresholds(&mut page, &analysis, mean)?;
    Ok(page)
}

/// How well features predict the answers.
struct Row {
    group: String,
    name: String,
    /// The shares of answers: every feature counts alike; weights of two actions on the third; weights of some clips on others.
    shares: [f64; 3],
    /// The difference of the first share from that of the first row, as a 95 % interval.
    difference: [f64; 2],
}

/// The study, prepared for predictions.
struct Analysis<'a> {
    study: &'a Study,
    /// The group of each clip: clips with the same Efforts are in one group in all actions. `None` for the neutral ones.
    groups: Vec<Option<usize>>,
    /// For each draw of clips with replacement, how often each triple counts.
    draws: Vec<Vec<f64>>,
    /// The hits of the first row.
    first: Option<Vec<f64>>,
}

impl<'a> Analysis<'a> {
    fn new(study: &'a Study) -> Analysis<'a> {
        let mut efforts: Vec<Effort> = study.clips.iter().map(|clip| clip.effort).collect();
        efforts.sort_unstable();
        efforts.dedup();
        efforts.retain(|effort| *effort != [0; 4]);
        let place = |clip: usize| efforts.binary_search(&study.clips[clip].effort).ok();
        let mut rng = ChaCha12Rng::seed_from_u64(7);
        let draws = (0..DRAWS).map(|_| {
            let mut counts = vec![0.0; efforts.len()];
            for _ in 0..efforts.len() {
                counts[rng.random_range(0..efforts.len())] += 1.0;
            }
            let factors = study.triples.iter().map(|triple| {
                let [left, _, right] = triple.clips.map(place);
                let count = |place: Option<usize>| place.map_or(1.0, |place| counts[place]);
                count(left) * count(right)
            });
            factors.collect()
        });
        Analysis {
            draws: draws.collect(),
            groups: (0..study.clips.len())
                .map(|clip| place(clip).map(|place| place % GROUPS))
                .collect(),
            study,
            first: None,
        }
    }

    fn choices(&self, features: &[Vec<f64>]) -> Vec<Choice> {
        let triples = self.study.triples.iter();
        triples.map(|triple| Choice::of(triple, features)).collect()
    }

    /// Fits weights on some triples, and returns the hits on others.
    fn hits_of_others(
        &self,
        choices: &[Choice],
        is_training: impl Fn(usize) -> bool,
        is_test: impl Fn(usize) -> bool,
    ) -> [f64; 2] {
        let factors: Vec<f64> = { 0..choices.len() }
            .map(|triple| f64::from(u8::from(is_training(triple))))
            .collect();
        let model = ChoiceModel::fit(choices, &factors);
        let test = (0..choices.len()).filter(|&triple| is_test(triple));
        test.fold([0.0; 2], |[hits, count], triple| {
            let choice = &choices[triple];
            [hits + model.hits(choice), count + choice.count()]
        })
    }

    /// Computes a row.
    fn row(&mut self, group: &str, name: &str, features: &[Vec<f64>]) -> Row {
        let choices = self.choices(features);
        let equal = ChoiceModel::equal(features[0].len());
        let hits: Vec<f64> = choices.iter().map(|choice| equal.hits(choice)).collect();
        let counts: Vec<f64> = choices.iter().map(Choice::count).collect();
        let share = hits.iter().sum::<f64>() / counts.iter().sum::<f64>();

        let mut sums = [[0.0; 2]; 2];
        let mut add = |place: usize, [hits, count]: [f64; 2]| {
            sums[place] = [sums[place][0] + hits, sums[place][1] + count];
        };
        let triples = &self.study.triples;
        for action in 0..Study::ACTIONS.len() {
            let is_of = |triple: usize| triples[triple].action == action;
            add(
                0,
                self.hits_of_others(&choices, |triple| !is_of(triple), is_of),
            );
        }
        for group in 0..GROUPS {
            let of_group = |triple: usize| {
                let [left, _, right] = triples[triple].clips.map(|clip| self.groups[clip]);
                [left, right].map(|found| found == Some(group))
            };
            let hits = self.hits_of_others(
                &choices,
                |triple| of_group(triple) == [false; 2],
                |triple| of_group(triple) == [true; 2],
            );
            add(1, hits);
        }
        let first = self.first.get_or_insert_with(|| hits.clone());
        let mut differences: Vec<f64> = { self.draws.iter() }
            .map(|factors| {
                let terms = factors
                    .iter()
                    .zip(&counts)
                    .zip(hits.iter().zip(first.iter()));
                let (mut difference, mut all) = (0.0, 0.0);
                for ((factor, count), (hits, first)) in terms {
                    difference += factor * (hits - first);
                    all += factor * count;
                }
                difference / all
            })
            .collect();
        Row {
            group: group.to_owned(),
            name: name.to_owned(),
            shares: [share, sums[0][0] / sums[0][1], sums[1][0] / sums[1][1]],
            difference: interval(&mut differences),
        }
    }

    /// Fits the weights of features on the triples of some actions; with an interval of each over draws of clips.
    fn weights(&self, features: &[Vec<f64>], actions: &[usize]) -> Vec<(f64, [f64; 2])> {
        let choices = self.choices(features);
        let of_actions = |factors: &[f64]| -> Vec<f64> {
            let triples = self.study.triples.iter().zip(factors);
            triples
                .map(|(triple, factor)| match actions.contains(&triple.action) {
                    true => *factor,
                    false => 0.0,
                })
                .collect()
        };
        let fit = |factors: &[f64]| ChoiceModel::fit(&choices, &of_actions(factors)).weights;
        let whole = fit(&vec![1.0; choices.len()]);
        let draws = self.draws.iter().take(FITTED_DRAWS);
        let draws: Vec<Vec<f64>> = draws.map(|factors| fit(factors)).collect();
        { whole.into_iter().enumerate() }
            .map(|(place, weight)| {
                let mut values: Vec<f64> = draws.iter().map(|draw| draw[place]).collect();
                (weight, interval(&mut values))
            })
            .collect()
    }
}

/// Returns the middle 95 % of values.
fn interval(values: &mut [f64]) -> [f64; 2] {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len() - 1;
    [0.025, 0.975].map(|fraction| values[(fraction * last as f64).round() as usize])
}

/// Formats a share in percent.
fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

/// Writes the table of predictions.
fn predictions(page: &mut String, study: &Study, rows: &[Row]) -> std::fmt::Result {
    let answers = f64::from(study.answers());
    let triples = &study.triples;
    let majority: f64 = triples
        .iter()
        .map(|triple| f64::from(triple.answers.into_iter().max().unwrap_or(0)))
        .sum();
    let others: f64 = triples
        .iter()
        .map(|triple| predictable(&Choice::of(triple, &vec![Vec::new(); study.clips.len()])))
        .sum();
    writeln!(
        page,
        "### What predicts the answers\n\n\
         {} clips, {} triples, {answers} answers. Shares of answers, in percent, that name the two clips that are nearest by the sum of absolute differences of logarithms: every feature counts alike; with weights fitted on two actions, \
         for the third; with weights fitted on four fifths of the Efforts, for triples of the others. Weights come with a bias of the outer pair. The last column is the difference of the first share from that of the first row: the 95 % interval over draws of the clips. \
         By chance it is 33.3. Who knows what most others say of the same triple names {} of the answers, and {} if one's own answer is among these.\n\n\
         | | | alike | other action | other clips | alike, less the first row |\n|---|---|---|---|---|---|",
        study.clips.len(),
        triples.len(),
        percent(others / answers),
        percent(majority / answers),
    )?;
    let mut group = "";
    for row in rows {
        let shown = if row.group == group { "" } else { &row.group };
        group = &row.group;
        let [alike, action, clips] = row.shares.map(percent);
        let [low, high] = row.difference.map(|value| format!("{:+.1}", 100.0 * value));
        writeln!(
            page,
            "| {shown} | {} | {alike} | {action} | {clips} | {low} to {high} |",
            row.name
        )?;
    }
    Ok(())
}

/// Writes the table of correlations between features and what the clips were made with.
fn labels_of_features(
    page: &mut String,
    study: &Study,
    features: &[Vec<f64>],
    labels: &[[f64; 4]],
) -> std::fmt::Result {
    writeln!(
        page,
        "\n### What the clips were made with\n\n\
         Correlation of the logarithm of each feature (mean over time) with the authored Efforts, and with the logarithm of the feature Time, over the clips of an action.\n\n\
         | action | feature | Space: direct | Weight: strong | Time: sudden | Flow: bound | feature Time |\n|---|---|---|---|---|---|---|"
    )?;
    for (action, name) in Study::ACTIONS.iter().enumerate() {
        let clips: Vec<usize> = { 0..study.clips.len() }
            .filter(|&clip| study.clips[clip].action == action)
            .collect();
        for (place, feature) in FEATURES.iter().enumerate() {
            let values: Vec<f64> = clips.iter().map(|&clip| features[clip][place]).collect();
            let cells = (0..5).map(|column| {
                let others = clips.iter().map(|&clip| match column {
                    4 => features[clip][1],
                    label => labels[clip][label],
                });
                format!("{:.2}", correlation(&values, &others.collect::<Vec<f64>>()))
            });
            let cells: Vec<String> = cells.collect();
            let name = if place == 0 { name } else { "" };
            writeln!(page, "| {name} | {feature} | {} |", cells.join(" | "))?;
        }
    }
    Ok(())
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let (mut products, mut squares) = (0.0, [0.0; 2]);
    for (a, b) in a.iter().zip(b) {
        let (a, b) = (a - mean_a, b - mean_b);
        products += a * b;
        squares = [squares[0] + a * a, squares[1] + b * b];
    }
    products / (squares[0] * squares[1]).sqrt()
}

/// Counts how often the clip that is apart in a feature is the one that people find different, by its ratio to the nearer of two that are about equal: hits and answers for each
/// range of [`RATIOS`].
fn curve(study: &Study, values: &[f64], actions: &[usize]) -> Vec<[f64; 2]> {
    let mut counts = vec![[0.0; 2]; RATIOS.len() - 1];
    for triple in study
        .triples
        .iter()
        .filter(|triple| actions.contains(&triple.action))
    {
        let mut order = [0, 1, 2];
        let value = |place: usize| values[triple.clips[place]];
        order.sort_by(|&a, &b| value(a).total_cmp(&value(b)));
        let gaps = [
            value(order[1]) - value(order[0]),
            value(order[2]) - value(order[1]),
        ];
        let (near, far, apart) = match gaps[0] > gaps[1] {
            true => (gaps[1], gaps[0], order[0]),
            false => (gaps[0], gaps[1], order[2]),
        };
        if near >= EQUAL.ln() {
            continue;
        }
        let pair = PAIRS.iter().position(|&(a, b)| a != apart && b != apart);
        let chosen = triple.answers[pair.expect("a pair without it")];
        let range = RATIOS
            .iter()
            .rposition(|ratio| ratio.ln() <= far)
            .unwrap_or(0);
        counts[range][0] += f64::from(chosen);
        counts[range][1] += f64::from(triple.count());
    }
    counts
}

/// Writes the table of the curves.
fn curves(page: &mut String, analysis: &Analysis<'_>, features: &[Vec<f64>]) -> std::fmt::Result {
    /// Fewer answers are no share.
    const ENOUGH: f64 = 100.0;
    writeln!(
        page,
        "\n### How large a factor has to be to be seen\n\n\
         Triples of which two clips are about equal in a feature (mean over time; a ratio below {EQUAL}), by the ratio of the third to the nearer of them: the share of answers, in percent, that find the third different, and the number of answers. By chance it is 33.3.\n\n\
         | ratio | Weight | Time | Flow | Shape |\n|---|---|---|---|---|"
    )?;
    let actions: Vec<usize> = (0..Study::ACTIONS.len()).collect();
    let columns = [0, 1, 2, 3].map(|place| {
        let values: Vec<f64> = features.iter().map(|all| all[place]).collect();
        curve(analysis.study, &values, &actions)
    });
    for range in 0..RATIOS.len() - 1 {
        let cells = columns.each_ref().map(|column| match column[range] {
            [hits, count] if count >= ENOUGH => format!("{} ({count})", percent(hits / count)),
            _ => "–".into(),
        });
        let name = match RATIOS[range + 1] {
            f64::INFINITY => format!("{} and more", RATIOS[range]),
            end => format!("{} to {end}", RATIOS[range]),
        };
        writeln!(page, "| {name} | {} |", cells.join(" | "))?;
    }
    Ok(())
}

/// Writes the tables of weights, and of the factors that they give.
fn thresholds(
    page: &mut String,
    analysis: &Analysis<'_>,
    features: &[Vec<f64>],
) -> std::fmt::Result {
    let everything: Vec<usize> = (0..Study::ACTIONS.len()).collect();
    let mut columns: Vec<&[usize]> = vec![&everything];
    columns.extend(everything.chunks(1));
    let header = format!(
        "all | {} |\n|---|---|{}",
        Study::ACTIONS.join(" | "),
        "---|".repeat(Study::ACTIONS.len())
    );
    writeln!(
        page,
        "\nIf a feature alone decided: the factor at which two thirds find the third clip different, halfway from chance to all (4^(1/w), with the weight w of the model of choices), with the 95 % interval over draws of the clips.\n\n| feature | {header}"
    )?;
    for (place, feature) in FEATURES.iter().enumerate() {
        let alone: Vec<Vec<f64>> = features.iter().map(|all| vec![all[place]]).collect();
        let cells = columns.iter().map(|actions| {
            let (weight, [low, high]) = analysis.weights(&alone, actions)[0];
            let factor = |weight: f64| match weight {
                ..0.05 => "none".into(),
                weight => format!("{:.2}", 4f64.powf(1.0 / weight)),
            };
            format!("{} ({} to {})", factor(weight), factor(high), factor(low))
        });
        let cells: Vec<String> = cells.collect();
        writeln!(page, "| {feature} | {} |", cells.join(" | "))?;
    }
    writeln!(
        page,
        "\nThe weights of all four together, for a unit of the logarithm, with intervals as above.\n\n| feature | {header}"
    )?;
    let fitted: Vec<Vec<(f64, [f64; 2])>> = { columns.iter() }
        .map(|actions| analysis.weights(features, actions))
        .collect();
    for (place, feature) in FEATURES.iter().enumerate() {
        let cells = fitted.iter().map(|weights| {
            let (weight, [low, high]) = weights[place];
            format!("{weight:.2} ({low:.2} to {high:.2})")
        });
        let cells: Vec<String> = cells.collect();
        writeln!(page, "| {feature} | {} |", cells.join(" | "))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::super::study::{Clip, Triple};
    use super::*;

    /// A study of one action whose clips are numbered, with answers to each triple.
    fn study(answers: impl Fn(usize, usize) -> [u32; 3]) -> Study {
        let clip = |number: usize| Clip {
            action: 0,
            effort: [0, 0, 0, number as i8],
            path: PathBuf::new(),
        };
        let triples = (1..30).flat_map(|left| (left + 1..30).map(move |right| (left, right)));
        Study {
            clips: (0..30).map(clip).collect(),
            triples: triples
                .map(|(left, right)| Triple {
                    action: 0,
                    clips: [left, 0, right],
                    answers: answers(left, right),
                })
                .collect(),
        }
    }

    #[test]
    fn a_curve_counts_how_often_the_clip_that_is_apart_is_found() {
        // Odd clips are as the neutral one, even ones twice as much; people see that nine times in ten.
        let is_apart = |clip: usize| clip > 0 && clip.is_multiple_of(2);
        let study = study(|left, right| match [left, right].map(is_apart) {
            [true, false] => [1, 0, 9],
            [false, true] => [9, 0, 1],
            [true, true] => [1, 9, 0],
            [false, false] => [3, 4, 3],
        });
        let values: Vec<f64> = { 0..30 }
            .map(|clip| if is_apart(clip) { 2f64.ln() } else { 0.0 })
            .collect();
        let counts = curve(&study, &values, &[0]);
        let range = RATIOS.iter().position(|ratio| *ratio == 1.8).unwrap();
        let [hits, count] = counts[range];
        assert_eq!(hits / count, 0.9);
        // The other triples are all alike.
        assert_eq!(counts[0][1], 10.0 * (15.0 * 14.0 / 2.0));
        assert_eq!(
            counts.iter().map(|range| range[1]).sum::<f64>(),
            f64::from(study.answers())
        );
    }

    #[test]
    fn what_decides_predicts_other_clips_too_and_what_does_not_is_at_chance() {
        let seen = |clip: usize| -> f64 { ((clip * 7) % 11) as f64 / 11.0 };
        let study = study(|left, right| {
            let distances = [[left, 0], [left, right], [0, right]];
            let distances: [f64; 3] = distances.map(|[a, b]| (seen(a) - seen(b)).abs());
            let nearest = (0..3)
                .min_by(|&a, &b| distances[a].total_cmp(&distances[b]))
                .unwrap();
            std::array::from_fn(|pair| if pair == nearest { 8 } else { 1 })
        });
        let mut analysis = Analysis::new(&study);
        let features = |value: &dyn Fn(usize) -> f64| -> Vec<Vec<f64>> {
            (0..30).map(|clip| vec![value(clip)]).collect()
        };
        let good = analysis.row("", "", &features(&seen));
        assert!(
            good.shares[0] > 0.75 && good.shares[2] > 0.7,
            "{:?}",
            good.shares
        );
        assert_eq!(good.difference, [0.0; 2]);
        let poor = analysis.row("", "", &features(&|clip| ((clip * 5) % 13) as f64));
        assert!(
            poor.shares[0] < 0.5 && poor.difference[1] < 0.0,
            "{:?}",
            poor.difference
        );
    }
}
