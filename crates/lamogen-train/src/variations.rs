//! Variations of motions: the same movement with other Laban features.
//!
//! ```text
//! motion of an entry ──Rig::fit──▶ rigid baseline ─┐
//! factors drawn ──Goals────────────────────────────┴─Rig::guide──▶ rigid motion ──encode──▶ rows of a variation
//! ```
//!
//! Captions nearly tell which motion is meant, and so how strong or sudden it is: a network that is told the Laban features beside them
//! has no need to listen. Of a variation the caption says the same and the features say otherwise.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_data::{Dataset, MotionVariation, Split};
use lamogen_guide::{Guidance, GuideError, Rig};
use lamogen_laban::{Component, Goals, Scale, ScaleError};
use lamogen_motion::npy::{self, NpyError};
use lamogen_motion::{Motion, MotionError, POSE_FEATURES, encode_every_frame};
use rand::{Rng, RngExt};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::identity::{ClaimError, claim};
use crate::sampling::stream;

/// What variations are made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariationOptions {
    /// How many of every motion.
    pub count: usize,
    /// The smallest and the largest factor on a component; in between they are drawn evenly by their logarithm.
    pub factors: [f32; 2],
    /// By what they are drawn.
    pub seed: u64,
    /// How often the terms of a fit are evaluated.
    pub evaluations: usize,
}

impl Default for VariationOptions {
    fn default() -> Self {
        VariationOptions {
            count: 3,
            factors: [0.35, 2.2],
            seed: 0,
            evaluations: 100,
        }
    }
}

/// Why variations cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum VariationError {
    /// Options that make no sense.
    #[error("variations: {0}")]
    Options(String),
    /// The body's motion cannot be guided.
    #[error("{name}: {reason}")]
    #[allow(missing_docs)]
    Guide { name: String, reason: GuideError },
    /// A motion cannot be taken.
    #[error("{name}: {reason}")]
    #[allow(missing_docs)]
    Motion { name: String, reason: MotionError },
    /// A file of the work's folder cannot be read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// An array of the work's folder is damaged.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// The work's folder is of other options or another data set.
    #[error(
        "{path}: expected work on {expected}, found work on {found}; take another folder or remove it"
    )]
    #[allow(missing_docs)]
    OtherWork {
        path: PathBuf,
        expected: String,
        found: String,
    },
}

/// Makes variations of every motion for training, and returns them all; none if the observer stopped the work, which the same call then goes on
/// with. `work` is a folder that keeps what is finished, `device` computes; the observer is told how many motions are, of how many.
///
/// Of six in ten variations one component changes, of three in ten two, of the others all. What does not change keeps its features.
///
/// # Errors
///
/// If the options make no sense, a motion cannot be guided, or the folder cannot be used.
pub fn vary(
    dataset: &Dataset,
    options: &VariationOptions,
    work: &Path,
    device: &Device,
    observer: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
) -> Result<Option<Vec<MotionVariation>>, VariationError> {
    options.check()?;
    let entries = dataset.indices(Split::Train);
    let entries: Vec<usize> = entries
        .filter(|&entry| {
            let entry = &dataset.entries()[entry];
            !entry.mirror && entry.variation_of.is_none()
        })
        .collect();
    claim_folder(dataset, options, &entries, work)?;
    let done = std::sync::atomic::AtomicUsize::new(0);
    let stopped = std::sync::atomic::AtomicBool::new(false);
    let order = std::sync::atomic::Ordering::Relaxed;
    let made = { entries.par_iter() }.map(|&entry| {
        let path = work.join(format!("{entry:06}.npy"));
        let finished = match path.exists() {
            true => Some(read(&path, options, dataset.entries()[entry].frames)?),
            false if stopped.load(order) => None,
            false => {
                let rows = vary_one(dataset, entry, options, device)?;
                write(&path, &rows)?;
                Some(rows)
            }
        };
        if finished.is_some() {
            let done = done.fetch_add(1, order) + 1;
            if observer(done, entries.len()).is_break() {
                stopped.store(true, order);
            }
        }
        Ok(finished.map(|motions| {
            let factors = draw(options, entry);
            let variations = motions.into_iter().zip(factors);
            let variation =
                |(rows, factors): (Vec<_>, [f32; Component::ALL.len()])| MotionVariation {
                    entry,
                    rows,
                    note: format!("Weight, Time, Flow, Shape times {factors:.2?}"),
                };
            variations.map(variation).collect::<Vec<_>>()
        }))
    });
    let made: Vec<Option<Vec<MotionVariation>>> = made.collect::<Result<_, VariationError>>()?;
    let made: Option<Vec<Vec<MotionVariation>>> = made.into_iter().collect();
    Ok(made.map(|made| made.into_iter().flatten().collect()))
}

impl VariationOptions {
    fn check(&self) -> Result<(), VariationError> {
        let [least, most] = self.factors;
        let problem = |text: String| Err(VariationError::Options(text));
        if !(0.05..=20.0).contains(&least) || !(least..=20.0).contains(&most) {
            let found = self.factors;
            return problem(format!(
                "expected two factors from 0.05 to 20, the smaller first, found {found:?}"
            ));
        }
        if !(1..=100).contains(&self.count) {
            return problem(format!(
                "expected 1 to 100 of each motion, found {}",
                self.count
            ));
        }
        if self.evaluations == 0 {
            return problem("expected at least one evaluation, found 0".to_owned());
        }
        Ok(())
    }
}

/// The factors of every variation of an entry.
fn draw(options: &VariationOptions, entry: usize) -> Vec<[f32; Component::ALL.len()]> {
    const ONE: f64 = 0.6;
    const TWO: f64 = 0.75;
    let mut generator = stream(options.seed, entry as u64);
    let [least, most] = options.factors.map(|factor| f64::from(factor).ln());
    let factor = |generator: &mut dyn Rng| {
        let way: f64 = generator.random();
        (least + way * (most - least)).exp() as f32
    };
    let variation = |_| {
        let all = Component::ALL.len();
        let changed = match generator.random_bool(ONE) {
            true => 1,
            false if generator.random_bool(TWO) => 2,
            false => all,
        };
        let mut factors = [1.0; Component::ALL.len()];
        let first = generator.random_range(0..all as u64) as usize;
        let step = generator.random_range(1..all as u64) as usize;
        for place in 0..changed {
            // Two different ones, or all.
            let step = if changed == all { 1 } else { step };
            factors[(first + place * step) % all] = factor(&mut generator);
        }
        factors
    };
    (0..options.count).map(variation).collect()
}

type Rows = Vec<[f32; POSE_FEATURES]>;

fn vary_one(
    dataset: &Dataset,
    place: usize,
    options: &VariationOptions,
    device: &Device,
) -> Result<Vec<Rows>, VariationError> {
    let entry = &dataset.entries()[place];
    let broken = |reason| VariationError::Motion {
        name: entry.name.clone(),
        reason,
    };
    let motion = dataset.motion(entry).map_err(broken)?;
    let mut guidance = Guidance::precise();
    guidance.fit.goal_evaluations = options.evaluations;
    let rig = Rig::new(&guidance, device);
    let watch = &mut |_| ControlFlow::Continue(());
    let (fitted, _) = rig.fit(std::slice::from_ref(&motion), watch);
    let baseline = fitted.into_iter().map(Motion::from_rotations);
    let baseline = baseline.collect::<Result<Vec<_>, _>>().map_err(broken)?;
    let mut variations = Vec::with_capacity(options.count);
    for factors in draw(options, place) {
        let scale = Scale::new(factors);
        let scale =
            scale.map_err(|error: ScaleError| VariationError::Options(error.to_string()))?;
        let guided = rig
            .guide(&baseline, &baseline, &[Goals::from(scale)], watch)
            .map_err(|reason| VariationError::Guide {
                name: entry.name.clone(),
                reason,
            })?;
        variations.push(encode_every_frame(&guided.rotations[0].joints()));
    }
    Ok(variations)
}

/// Notes in the folder whose work it holds, or compares it with what is noted.
fn claim_folder(
    dataset: &Dataset,
    options: &VariationOptions,
    entries: &[usize],
    work: &Path,
) -> Result<(), VariationError> {
    let io = |path: &Path, reason| VariationError::Io {
        path: path.to_owned(),
        reason,
    };
    std::fs::create_dir_all(work).map_err(|reason| io(work, reason))?;
    let path = work.join("variations.json");
    let frames: usize = { entries.iter() }
        .map(|&entry| dataset.entries()[entry].frames)
        .sum();
    let own = json!({ "options": options, "motions": entries.len(), "frames": frames });
    claim(&path, &own).map_err(|error| match error {
        ClaimError::Io(reason) => io(&path, reason),
        ClaimError::Format(reason) => io(&path, reason.into()),
        ClaimError::Other { expected, found } => VariationError::OtherWork {
            path: work.to_owned(),
            expected,
            found,
        },
    })
}

fn write(path: &Path, variations: &[Rows]) -> Result<(), VariationError> {
    let frames = variations[0].len();
    let values: Vec<f32> = { variations.iter() }
        .flat_map(|rows| rows.as_flattened().iter().copied())
        .collect();
    Ok(npy::write(
        path,
        &values,
        &[variations.len(), frames, POSE_FEATURES],
    )?)
}

fn read(
    path: &Path,
    options: &VariationOptions,
    frames: usize,
) -> Result<Vec<Rows>, VariationError> {
    let array = npy::read(path)?;
    let expected = [options.count, frames, POSE_FEATURES];
    if array.shape != expected {
        return Err(VariationError::OtherWork {
            path: path.to_owned(),
            expected: format!("{expected:?}"),
            found: format!("{:?}", array.shape),
        });
    }
    let (rows, _) = array.values.as_chunks::<POSE_FEATURES>();
    Ok(rows.chunks(frames).map(<[_]>::to_vec).collect())
}
