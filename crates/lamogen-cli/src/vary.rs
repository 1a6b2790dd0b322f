//! `lamogen vary`: adds variations of its motions to a data set.

use std::ops::ControlFlow;
use std::path::PathBuf;

use lamogen_data::{Dataset, LoadOptions};
use lamogen_train::{MotionVariationOptions, vary};
use serde_json::json;

use crate::arguments::VaryArguments;
use crate::console::Console;
use crate::dataset;
use crate::failure::Failure;
use crate::pack::print_problems;
use crate::source::open_device;

/// Runs `lamogen vary`.
pub fn run(options: &VaryArguments, console: &Console) -> Result<(), Failure> {
    let device = open_device(options.device)?;
    let dataset = dataset::open(&options.data, &LoadOptions::default(), console)?;
    let variation_options = MotionVariationOptions {
        count: usize::from(options.count),
        factors: options.factors,
        seed: options.seed,
        ..MotionVariationOptions::default()
    };
    Dataset::check_free(&options.out, options.force)?;
    let mut work_folder = options.out.clone().into_os_string();
    work_folder.push(".work");
    let work_folder = PathBuf::from(work_folder);
    let bar = console.progress_bar("motions");
    let variations = vary(
        &dataset,
        &variation_options,
        &work_folder,
        &device,
        &|done, all| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
            ControlFlow::Continue(())
        },
    );
    bar.finish_and_clear();
    let variations = variations?.expect("the observer stops nothing");
    let count = variations.len();
    let varied = dataset.with_variations(variations);
    print_problems(varied.problems(), console);
    varied.save(&options.out, options.force)?;
    // The data set contains the variations of the folder now.
    std::fs::remove_dir_all(&work_folder).map_err(|error| Failure::output(&work_folder, error))?;
    let folder = options.out.display();
    console.print(match console.json {
        true => json!({ "folder": options.out.to_string_lossy(), "variations": count }).to_string(),
        false => format!("{folder}\n{count} variations"),
    })
}
