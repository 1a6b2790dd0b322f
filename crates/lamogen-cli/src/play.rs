//! `lamogen play`: shows motion files in the browser.

use std::path::PathBuf;

use serde_json::{Map, json};

use crate::arguments::PlayArguments;
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::motion_file::open_motion_file;
use crate::scene::Scene;
use crate::source::open_device;

/// Runs `lamogen play`.
pub fn run(options: &PlayArguments, console: &Console) -> Result<(), Failure> {
    let device = open_device(None)?;
    let mut motions = Vec::new();
    for path in &options.files {
        motions.extend(
            open_motion_file(path, &options.reading, &device, console)?
                .scene
                .motions,
        );
    }
    let names: Vec<&str> = motions.iter().map(|motion| motion.label.as_str()).collect();
    let scene = Scene::of_motions(names.join(", "), motions, Map::new());
    let path = match &options.out {
        Some(path) if path.extension().is_none_or(|ending| ending != "html") => {
            let found = path.display();
            let message = format!("--out: expected a name that ends in .html, found {found}");
            return Err(Failure::new(FailureCode::Usage, message));
        }
        Some(path) => path.clone(),
        None => temporary_page_path(&options.files[0])?,
    };
    lamogen_view::save(&path, &scene.page())
        .map_err(|error| Failure::new(FailureCode::Output, error))?;
    match console.json {
        true => console.print(json!({ "file": path.to_string_lossy() }).to_string())?,
        false => console.print(path.display().to_string())?,
    }
    if !options.no_open
        && let Err(error) = open::that_detached(&path)
    {
        console.notice(format!(
            "No browser could be started ({error}); open the file by hand."
        ));
    }
    Ok(())
}

/// Returns the path of a page in a new private folder among the temporary files. Nobody else can predict the name of
/// the folder or write to it. The folder is kept for the browser; the system deletes its temporary files.
fn temporary_page_path(file: &std::path::Path) -> Result<PathBuf, Failure> {
    let folder = tempfile::Builder::new().prefix("lamogen-").tempdir();
    let folder = folder.map_err(|error| Failure::output(&std::env::temp_dir(), error))?;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    Ok(folder.keep().join(format!("{stem}.html")))
}
