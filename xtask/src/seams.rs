//! Measures where a motion goes from one sentence to the next: as one motion, as a motion that continues another, and as separate
//! clips that are cross-faded. What chance makes of the measure is seen in motions of one sentence, which have no join.
//!
//! ```text
//! pairs of sentences ──▶ one motion of both                  ──▶ steps at the join, steps elsewhere
//!                    ├─▶ a motion, and one that continues it ──▶ the same
//!                    ├─▶ a motion of each, cross-faded         ──▶ the same
//!                    └─▶ a motion of the first alone           ──▶ steps in its middle, steps elsewhere
//! ```

use std::error::Error;
use std::fmt::Write as _;
use std::ops::Range;

use burn::tensor::Device;
use lamogen::{Joint, Motion, Request, Tag};
use lamogen_eval::truth::sentences;
use lamogen_motion::{FRAMES_PER_SECOND, FootSliding, JOINTS, Placement};
use rand::SeedableRng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

use crate::subject::Subject;

/// The options of the measurement.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// Pairs of sentences, drawn from those of `truth`.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub pairs: u64,
    /// Make the second sentence strong, so that the guided pass is measured.
    #[arg(long)]
    pub guided: bool,
}

/// The frames of each sentence: three seconds.
const FRAMES: usize = 60;
/// The frames that cross-faded clips share: one second.
const FADE: usize = 20;
/// The number of frames before and after the border that belong to the join: half a second.
const REACH: usize = 10;

/// What is measured of one motion of two sentences.
struct Seam {
    /// The largest acceleration and jerk at the join, as multiples of the 99th percentile elsewhere, each a mean over joints.
    ratios: [f64; 2],
    /// The speed of standing feet at the join and elsewhere, in metres a second.
    sliding: [f64; 2],
    /// The largest step of the pelvis along the ground at the join, as a multiple of the largest elsewhere.
    pelvis: f64,
}

/// Generates the motions and measures them. Returns a table in Markdown; `progress` receives a line for each pair.
///
/// # Errors
///
/// If the model cannot be read or a motion cannot be generated.
pub fn run(
    options: &Options,
    device: &Device,
    progress: &mut dyn FnMut(String),
) -> Result<String, Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let suite = sentences();
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut seams: [Vec<Seam>; MOTIONS.len()] = Default::default();
    for seed in 0..options.pairs {
        let pair: Vec<_> = suite.sample(&mut random, 2).collect();
        let request = |sentence: usize, frames: usize| {
            let request = Request::new(&pair[sentence].text).frames(frames);
            match options.guided && sentence == 1 {
                true => request.tag(Tag::Strong),
                false => request,
            }
        };
        let generate = |request: Request| -> Result<Motion, Box<dyn Error>> {
            let request = options.subject.with_steps(request);
            Ok(model.generate(&request)?.guided)
        };
        let whole = generate(request(0, FRAMES).then(request(1, FRAMES)).seed(seed))?;
        let first = generate(request(0, FRAMES).seed(seed))?;
        let next = generate(request(1, FRAMES).seed(seed + options.pairs).after(&first))?;
        let continued = Motion::from_joints([first.joints(), next.joints()].concat())?;
        let clips = [0, 1].map(|sentence| {
            // A clip reaches half of the fade into the other.
            let request = request(sentence, FRAMES + FADE / 2);
            request.seed(seed + sentence as u64 * options.pairs)
        });
        let [first, second] = clips.map(generate);
        let fade = cross_fade(&first?, &second?)?;
        let alone = generate(request(0, 2 * FRAMES).seed(seed))?;
        let motions = [whole, continued, fade, alone];
        for (seams, motion) in seams.iter_mut().zip(&motions) {
            seams.push(Seam::of(motion)?);
        }
        let [whole, continued, faded, alone] = seams
            .each_ref()
            .map(|seams| seams[seams.len() - 1].ratios[1]);
        progress(format!(
            "{} | {}: jerk {whole:.2}, continued {continued:.2}, cross-faded {faded:.2}, without a join {alone:.2}",
            pair[0].text, pair[1].text
        ));
    }
    Ok(table(&seams))
}

/// Fades two clips into each other over the frames that they share. The second is placed where the first is in the middle of
/// them.
fn cross_fade(first: &Motion, second: &Motion) -> Result<Motion, Box<dyn Error>> {
    let start = first.frames() - FADE;
    let from = Placement::of(&second.joints()[FADE / 2]);
    let to = Placement::of(&first.joints()[start + FADE / 2]);
    let placed = from.to(&to).of_rotations(&second.rotations()).joints();
    let mut joints = first.joints().to_vec();
    for (place, pose) in placed.into_iter().enumerate() {
        if place >= FADE {
            joints.push(pose);
            continue;
        }
        let part = (place as f32 + 0.5) / FADE as f32;
        let share = part * part * (3.0 - 2.0 * part);
        let points = joints[start + place].as_flattened_mut().iter_mut();
        for (own, other) in points.zip(pose.as_flattened()) {
            *own += share * (other - *own);
        }
    }
    Ok(Motion::from_joints(joints)?)
}

impl Seam {
    fn of(motion: &Motion) -> Result<Seam, Box<dyn Error>> {
        let border = FRAMES;
        let join = border - REACH..border + REACH;
        let ratio = |order: usize| {
            let values = differences(motion, order);
            // A difference belongs to the join if it is of frames of the join alone.
            let at_join = join.start..join.end - order;
            let largest = { values[at_join.clone()].iter() }.fold(0.0, |a, b| f64::max(a, *b));
            let elsewhere = [&values[..at_join.start], &values[at_join.end..]].concat();
            largest / percentile(elsewhere, 0.99).max(1e-9)
        };
        let sliding = |frames: Range<usize>| -> Result<f64, Box<dyn Error>> {
            let section = Motion::from_joints(motion.joints()[frames].to_vec())?;
            Ok(f64::from(FootSliding::of(&section).speed))
        };
        let pelvis = |frames: Range<usize>| {
            let poses = motion.joints()[frames].windows(2);
            let steps = poses.map(|pair| {
                let [from, to] = [&pair[0], &pair[1]].map(|pose| pose[Joint::Pelvis.index()]);
                f64::from((to[0] - from[0]).hypot(to[2] - from[2]))
            });
            steps.fold(0.0, f64::max)
        };
        let frames = motion.frames();
        let elsewhere = [0..join.start, join.end..frames];
        let largest = elsewhere.clone().map(&pelvis).into_iter();
        let [before, after] = elsewhere.map(&sliding);
        Ok(Seam {
            ratios: [ratio(2), ratio(3)],
            sliding: [sliding(join.clone())?, (before? + after?) / 2.0],
            // A body that stands does not move its pelvis; a centimetre a frame is the least scale.
            pelvis: pelvis(join) / largest.fold(0.01, f64::max),
        })
    }
}

/// Returns the differences of an order of the joint positions: their lengths in metres, as means over joints.
fn differences(motion: &Motion, order: usize) -> Vec<f64> {
    let mut rows: Vec<Vec<f64>> = { motion.joints().iter() }
        .map(|pose| pose.as_flattened().iter().map(|x| f64::from(*x)).collect())
        .collect();
    for _ in 0..order {
        let pairs = rows.windows(2);
        rows = pairs
            .map(|pair| pair[1].iter().zip(&pair[0]).map(|(b, a)| b - a).collect())
            .collect();
    }
    let length = |point: &[f64]| point.iter().map(|x| x * x).sum::<f64>().sqrt();
    { rows.iter() }
        .map(|row| row.chunks_exact(3).map(length).sum::<f64>() / JOINTS as f64)
        .collect()
}

/// Returns the value that a share of the values does not exceed.
fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[(share * (values.len() - 1) as f64).round() as usize]
}

/// The motions that are measured, in the order of the results.
const MOTIONS: [&str; 4] = ["one motion", "continued", "cross-faded", "without a join"];

/// Formats what was measured of each kind of motion.
fn table(seams: &[Vec<Seam>; MOTIONS.len()]) -> String {
    let mut text = String::from(
        "| at the join | motion | median | 90 % | worst | pairs within |\n|---|---|---|---|---|---|\n",
    );
    type Value = fn(&Seam) -> f64;
    let values: [(&str, Value); 3] = [
        (
            "largest acceleration, of the 99th percentile elsewhere",
            |seam| seam.ratios[0],
        ),
        ("largest jerk, of the 99th percentile elsewhere", |seam| {
            seam.ratios[1]
        }),
        (
            "largest step of the pelvis, of the largest elsewhere",
            |seam| seam.pelvis,
        ),
    ];
    for (name, value) in values {
        for (motion, seams) in MOTIONS.iter().zip(seams) {
            let values: Vec<f64> = seams.iter().map(value).collect();
            let within = values.iter().filter(|value| **value <= 1.0).count();
            let [median, high, worst] =
                [0.5, 0.9, 1.0].map(|share| percentile(values.clone(), share));
            writeln!(
                text,
                "| {name} | {motion} | {median:.2} | {high:.2} | {worst:.2} | {within} of {} |",
                values.len()
            )
            .expect("a string takes all");
        }
    }
    for (name, place) in [("at the join", 0), ("elsewhere", 1)] {
        for (motion, seams) in MOTIONS.iter().zip(seams) {
            let speeds: Vec<f64> = seams.iter().map(|seam| seam.sliding[place]).collect();
            let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
            let [median, high, worst] =
                [0.5, 0.9, 1.0].map(|share| percentile(speeds.clone(), share));
            writeln!(
                text,
                "| speed of standing feet {name}, m/s (mean {mean:.3}) | {motion} | {median:.3} | {high:.3} | {worst:.3} | |"
            )
            .expect("a string takes all");
        }
    }
    let seconds = 2.0 * REACH as f32 / FRAMES_PER_SECOND;
    writeln!(text, "\nThe join is {seconds:.1} s.").expect("a string takes all");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body that shakes more and more, so that each part of it is like the parts beside it.
    fn motion(jump: f32) -> Motion {
        let frames = (0..2 * FRAMES).map(|frame| {
            let shift = if frame >= FRAMES { jump } else { 0.0 };
            let wave = (frame as f32 * 0.7).sin() * 0.1;
            std::array::from_fn(|joint| [wave + shift, 0.1 * joint as f32, 0.03 * frame as f32])
        });
        Motion::from_joints(frames.collect()).unwrap()
    }

    #[test]
    fn a_jump_at_the_join_is_seen() {
        let smooth = Seam::of(&motion(0.0)).unwrap();
        assert!(
            smooth.ratios.iter().all(|ratio| *ratio < 1.05),
            "{:?}",
            smooth.ratios
        );
        let jump = Seam::of(&motion(0.5)).unwrap();
        assert!(
            jump.ratios.iter().all(|ratio| *ratio > 3.0),
            "{:?}",
            jump.ratios
        );
        assert!(jump.pelvis > 3.0 && smooth.pelvis < 1.05);
    }
}
