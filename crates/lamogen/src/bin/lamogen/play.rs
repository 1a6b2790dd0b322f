//! `lamogen play`.

use std::path::PathBuf;

use lamogen::COMPONENTS;
use serde_json::{Map, json};

use crate::arguments::Play;
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::opened::open;
use crate::scene::Scene;
use crate::source::device;

pub fn run(options: &Play, console: &Console) -> Result<(), Failure> {
    let device = device(None)?;
    let mut motions = Vec::new();
    for path in &options.files {
        motions.extend(
            open(path, &options.reading, &device, console)?
                .scene
                .motions,
        );
    }
    let names: Vec<&str> = motions.iter().map(|shown| shown.label.as_str()).collect();
    let scene = Scene {
        title: names.join(", "),
        notes: String::new(),
        motions,
        target: None,
        free: [false; COMPONENTS],
        parts: Vec::new(),
        facts: Map::new(),
        copyright: None,
    };
    let path = match &options.out {
        Some(path) if path.extension().is_none_or(|ending| ending != "html") => {
            let found = path.display();
            let message = format!("--out: expected a name that ends in .html, found {found}");
            return Err(Failure::new(Code::Usage, message));
        }
        Some(path) => path.clone(),
        None => temporary(&options.files[0])?,
    };
    lamogen_view::save(&path, &scene.page()).map_err(|error| Failure::new(Code::Output, error))?;
    match console.json {
        true => console.say(json!({ "file": path.to_string_lossy() }).to_string())?,
        false => console.say(path.display().to_string())?,
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

/// A page's place in a new private folder among the temporary files, which nobody else can foresee or write to. It stays for the browser; the
/// system clears its temporary files.
fn temporary(file: &std::path::Path) -> Result<PathBuf, Failure> {
    let folder = tempfile::Builder::new().prefix("lamogen-").tempdir();
    let folder = folder.map_err(|error| Failure::output(&std::env::temp_dir(), error))?;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    Ok(folder.keep().join(format!("{stem}.html")))
}
