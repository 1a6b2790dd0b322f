//! Variations of motions: the same movement with other Laban features.
//!
//! ```text
//! motion of an entry ──Rig::fit──▶ rigid baseline ─┐
//! drawn factors ──Goals────────────────────────────┴─Rig::guide──▶ rigid motion ──encode──▶ pose features of a variation
//! ```
//!
//! A caption almost identifies its motion, and so also tells how strong or sudden the motion is. A network that sees both the
//! caption and the Laban features can therefore ignore the features. A variation has the same caption but other features, so that
//! the network has to follow them.

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

use crate::identity::{IdentityError, write_or_check_identity};
use crate::sampling::step_generator;

/// The options by which variations are made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionVariationOptions {
    /// The number of variations of each motion.
    pub count: usize,
    /// The smallest and the largest factor on a component. The logarithms of the factors are drawn uniformly between them.
    pub factors: [f32; 2],
    /// The seed by which factors are drawn.
    pub seed: u64,
    /// The number of evaluations of the terms of a fit.
    pub evaluations: usize,
}

impl Default for MotionVariationOptions {
    fn default() -> Self {
        MotionVariationOptions {
            count: 3,
            factors: [0.35, 2.2],
            seed: 0,
            evaluations: 100,
        }
    }
}

/// The error of variations that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum VariationError {
    /// The options make no sense.
    #[error("variations: {0}")]
    Options(String),
    /// The motion of the rigid body cannot be guided.
    #[error("{name}: {reason}")]
    #[allow(missing_docs)]
    Guide { name: String, reason: GuideError },
    /// A motion of the data set cannot be used.
    #[error("{name}: {reason}")]
    #[allow(missing_docs)]
    Motion { name: String, reason: MotionError },
    /// A file of the work folder cannot be read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// An array in the work folder is damaged.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// The work folder belongs to other options or another data set.
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

/// Makes variations of every motion of the training split and returns them all.
///
/// Returns `None` if the observer stopped the work; the same call then resumes it. `work` is the folder that keeps finished
/// variations, and `device` computes. The observer receives the number of finished motions and the number of all motions.
///
/// Six in ten variations change one component, three in ten change two, and the others change all. A component that is not
/// changed keeps its features.
///
/// # Errors
///
/// If the options make no sense, a motion cannot be guided, or the folder cannot be used.
pub fn vary(
    dataset: &Dataset,
    options: &MotionVariationOptions,
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
    check_work_folder(dataset, options, &entries, work)?;
    let done = std::sync::atomic::AtomicUsize::new(0);
    let stopped = std::sync::atomic::AtomicBool::new(false);
    let order = std::sync::atomic::Ordering::Relaxed;
    let variations = { entries.par_iter() }.map(|&entry| {
        let path = work.join(format!("{entry:06}.npy"));
        let finished = match path.exists() {
            true => Some(read(&path, options, dataset.entries()[entry].frames)?),
            false if stopped.load(order) => None,
            false => {
                let rows = vary_entry(dataset, entry, options, device)?;
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
            let factors = draw_factors(options, entry);
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
    let variations: Vec<Option<Vec<MotionVariation>>> =
        variations.collect::<Result<_, VariationError>>()?;
    let variations: Option<Vec<Vec<MotionVariation>>> = variations.into_iter().collect();
    Ok(variations.map(|variations| variations.into_iter().flatten().collect()))
}

impl MotionVariationOptions {
    /// Checks that all options make sense.
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

/// Draws the factors on Weight, Time, Flow and Shape of every variation of an entry.
fn draw_factors(
    options: &MotionVariationOptions,
    entry: usize,
) -> Vec<[f32; Component::ALL.len()]> {
    /// The probability that one component changes.
    const ONE_PROBABILITY: f64 = 0.6;
    /// The probability that two components change if more than one does.
    const TWO_PROBABILITY: f64 = 0.75;
    let mut generator = step_generator(options.seed, entry as u64);
    let [least, most] = options.factors.map(|factor| f64::from(factor).ln());
    let factor = |generator: &mut dyn Rng| {
        let fraction: f64 = generator.random();
        (least + fraction * (most - least)).exp() as f32
    };
    let variation = |_| {
        let all = Component::ALL.len();
        let changed = match generator.random_bool(ONE_PROBABILITY) {
            true => 1,
            false if generator.random_bool(TWO_PROBABILITY) => 2,
            false => all,
        };
        let mut factors = [1.0; Component::ALL.len()];
        let first = generator.random_range(0..all as u64) as usize;
        let step = generator.random_range(1..all as u64) as usize;
        for place in 0..changed {
            // The step leads to two different components, or through all.
            let step = if changed == all { 1 } else { step };
            factors[(first + place * step) % all] = factor(&mut generator);
        }
        factors
    };
    (0..options.count).map(variation).collect()
}

/// The pose features of each frame of a variation.
type PoseRows = Vec<[f32; POSE_FEATURES]>;

/// Makes the variations of an entry.
fn vary_entry(
    dataset: &Dataset,
    index: usize,
    options: &MotionVariationOptions,
    device: &Device,
) -> Result<Vec<PoseRows>, VariationError> {
    let entry = &dataset.entries()[index];
    let motion_error = |reason| VariationError::Motion {
        name: entry.name.clone(),
        reason,
    };
    let motion = dataset.motion(entry).map_err(motion_error)?;
    let mut guidance = Guidance::precise();
    guidance.fit.goal_evaluations = options.evaluations;
    let rig = Rig::new(&guidance, device);
    let observer = &mut |_| ControlFlow::Continue(());
    let (fitted, _) = rig.fit(std::slice::from_ref(&motion), observer);
    let baseline = fitted.into_iter().map(Motion::from_rotations);
    let baseline = baseline
        .collect::<Result<Vec<_>, _>>()
        .map_err(motion_error)?;
    let mut variations = Vec::with_capacity(options.count);
    for factors in draw_factors(options, index) {
        let scale = Scale::new(factors);
        let scale =
            scale.map_err(|error: ScaleError| VariationError::Options(error.to_string()))?;
        let guided = rig
            .guide(&baseline, &baseline, &[Goals::from(scale)], observer)
            .map_err(|reason| VariationError::Guide {
                name: entry.name.clone(),
                reason,
            })?;
        variations.push(encode_every_frame(&guided.rotations[0].joints()));
    }
    Ok(variations)
}

/// Writes the identity of the work to a new work folder, or compares it with the one that the folder holds.
fn check_work_folder(
    dataset: &Dataset,
    options: &MotionVariationOptions,
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
    let identity = json!({ "options": options, "motions": entries.len(), "frames": frames });
    write_or_check_identity(&path, &identity).map_err(|error| match error {
        IdentityError::Io(reason) => io(&path, reason),
        IdentityError::Format(reason) => io(&path, reason.into()),
        IdentityError::Mismatch { expected, found } => VariationError::OtherWork {
            path: work.to_owned(),
            expected,
            found,
        },
    })
}

/// Writes the variations of a motion, `[variations, frames, features]`.
fn write(path: &Path, variations: &[PoseRows]) -> Result<(), VariationError> {
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

/// Reads the variations of a motion of so many frames.
fn read(
    path: &Path,
    options: &MotionVariationOptions,
    frames: usize,
) -> Result<Vec<PoseRows>, VariationError> {
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
