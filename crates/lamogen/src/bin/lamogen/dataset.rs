//! A data set as the command opens it.

use std::path::Path;

use lamogen_data::{Dataset, LoadOptions};

use crate::console::Console;
use crate::failure::Failure;
use crate::pack::tell_problems;

/// Reads a data set, with a bar, and says what was left out.
pub fn open(folder: &Path, limits: &LoadOptions, console: &Console) -> Result<Dataset, Failure> {
    let bar = console.bar("files");
    let dataset = Dataset::open(folder, limits, &mut |progress| {
        bar.set_length(progress.all as u64);
        bar.set_position(progress.done as u64);
    });
    bar.finish_and_clear();
    let dataset = dataset?;
    tell_problems(dataset.problems(), console);
    Ok(dataset)
}
