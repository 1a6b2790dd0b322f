//! What of the Laban features people see: the answers of a study on similar motions, predicted by the features.
//!
//! ```text
//! repository ──study.rs──▶ clips, triples with answers ──┐
//! clips ──measures.rs──▶ features of every way to measure┴─▶ choice.rs: predictions, weights ──report.rs──▶ page
//! ```
//!
//! The study (the public repository `pablobendiksen/motion-similarity`) showed three clips of one action, which its authors had made with other Effort
//! labels: one on the left, the neutral one, and one on the right. People said which two are most alike.

mod choice;
mod measures;
mod report;
mod study;

use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_motion::write_atomically;

use study::Study;

/// The options of the task.
#[derive(clap::Args)]
pub struct Options {
    /// A copy of the repository `pablobendiksen/motion-similarity`, with its files.
    pub folder: PathBuf,
    /// The page to write, as Markdown.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Measures the clips of the study, predicts its answers, and returns a page of Markdown.
///
/// # Errors
///
/// If a file of the study is missing or cannot be read, or the page cannot be written.
pub fn run(
    options: &Options,
    device: &Device,
    observer: &mut dyn FnMut(&str),
) -> Result<String, Box<dyn Error>> {
    let study = Study::read(&options.folder)?;
    observer(&format!(
        "{} clips, {} triples, {} answers",
        study.clips.len(),
        study.triples.len(),
        study.answers()
    ));
    let page = report::page(&study, device, observer)?;
    if let Some(path) = &options.out {
        write_page(path, &page)?;
    }
    Ok(page)
}

fn write_page(path: &Path, page: &str) -> Result<(), Box<dyn Error>> {
    write_atomically(path, |file| file.write_all(page.as_bytes()))
        .map_err(|error| format!("{}: {error}", path.display()).into())
}
