//! Opening a data set.

use std::path::Path;

use lamogen_data::{Dataset, LoadOptions};

use crate::console::Console;
use crate::failure::Failure;
use crate::pack::print_problems;

/// Reads a data set with a progress bar, and prints which motions were left out.
pub fn open(folder: &Path, limits: &LoadOptions, console: &Console) -> Result<Dataset, Failure> {
    let bar = console.progress_bar("files");
    let dataset = Dataset::open(folder, limits, &mut |progress| {
        bar.set_length(progress.all as u64);
        bar.set_position(progress.done as u64);
    });
    bar.finish_and_clear();
    let dataset = dataset?;
    print_problems(dataset.problems(), console);
    Ok(dataset)
}
