//! The files of a finished model besides its weights.

use std::io::Write;
use std::path::Path;

use lamogen_data::Dataset;
use lamogen_motion::{npy, write_atomically};

use crate::error::TrainError;
use crate::tokens::CaptionTokens;

/// Writes the statistics of the features and the tokenizer that a model was trained with.
pub(crate) fn write_statistics_and_tokenizer(
    folder: &Path,
    dataset: &Dataset,
    tokens: &CaptionTokens,
) -> Result<(), TrainError> {
    for (name, numbers) in [("mean.npy", dataset.mean()), ("std.npy", dataset.std())] {
        let path = folder.join(name);
        npy::write(path, numbers, &[numbers.len()])?;
    }
    match tokens.file() {
        Some(file) => write_file(&folder.join("tokenizer.json"), file),
        None => Ok(()),
    }
}

/// Writes a file atomically: whole or not at all.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    write_atomically(path, |file| file.write_all(bytes))
        .map_err(|reason| TrainError::io(path, reason))
}
