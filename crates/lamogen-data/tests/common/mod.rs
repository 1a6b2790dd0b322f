//! Small data sets for tests.

use std::path::Path;

use lamogen_data::{Dataset, LoadOptions};
use lamogen_motion::{POSE_FEATURES, npy};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Returns rows of random numbers.
pub fn rows(seed: u64, frames: usize) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let numbers = (0..frames * POSE_FEATURES).map(|_| random.random_range(-1.0..1.0));
    numbers.collect()
}

/// Writes a clip in HumanML3D's form.
pub fn clip(folder: &Path, name: &str, rows: &[f32], text: &str) {
    for folder in [folder.join("new_joint_vecs"), folder.join("texts")] {
        std::fs::create_dir_all(folder).unwrap();
    }
    let path = folder.join(format!("new_joint_vecs/{name}.npy"));
    npy::write(path, rows, &[rows.len() / POSE_FEATURES, POSE_FEATURES]).unwrap();
    write(folder, &format!("texts/{name}.txt"), text);
}

/// Writes a text file into a folder.
pub fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

pub fn open(folder: &Path) -> Dataset {
    Dataset::open(folder, &LoadOptions::default(), &mut |_| {}).unwrap()
}

/// Returns the error message of a folder that cannot be opened.
pub fn error(folder: &Path) -> String {
    let opened = Dataset::open(folder, &LoadOptions::default(), &mut |_| {});
    opened.unwrap_err().to_string()
}
