//! `lamogen vary`.

use std::ops::ControlFlow;
use std::path::PathBuf;

use lamogen_data::{Dataset, LoadOptions};
use lamogen_train::{VariationOptions, vary};
use serde_json::json;

use crate::arguments::Vary;
use crate::console::Console;
use crate::dataset;
use crate::failure::Failure;
use crate::pack::tell_problems;
use crate::source::device;

pub fn run(options: &Vary, console: &Console) -> Result<(), Failure> {
    let device = device(options.device)?;
    let dataset = dataset::open(&options.data, &LoadOptions::default(), console)?;
    let variations = VariationOptions {
        count: usize::from(options.count),
        factors: options.factors,
        seed: options.seed,
        ..VariationOptions::default()
    };
    Dataset::check_free(&options.out, options.force)?;
    let mut work = options.out.clone().into_os_string();
    work.push(".work");
    let work = PathBuf::from(work);
    let bar = console.bar("motions");
    let made = vary(&dataset, &variations, &work, &device, &|done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    let made = made?.expect("the observer stops nothing");
    let count = made.len();
    let varied = dataset.with_variations(made);
    tell_problems(varied.problems(), console);
    varied.save(&options.out, options.force)?;
    // What is in the folder is in the data set now.
    std::fs::remove_dir_all(&work).map_err(|error| Failure::output(&work, error))?;
    let folder = options.out.display();
    console.say(match console.json {
        true => json!({ "folder": options.out.to_string_lossy(), "variations": count }).to_string(),
        false => format!("{folder}\n{count} variations"),
    })
}
