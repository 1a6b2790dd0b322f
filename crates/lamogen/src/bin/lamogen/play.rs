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
        motions.extend(open(path, &options.reading, &device)?.scene.motions);
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

/// A page's place among the temporary files: always the same for a motion file, so that they do not pile up.
fn temporary(file: &std::path::Path) -> Result<PathBuf, Failure> {
    // Everybody has a folder of their own: one that somebody else made cannot be written to.
    let user = ["USER", "USERNAME"]
        .map(std::env::var)
        .into_iter()
        .find_map(Result::ok);
    let folder = std::env::temp_dir().join(format!("lamogen-{}", user.unwrap_or_default()));
    std::fs::create_dir_all(&folder).map_err(|error| Failure::output(&folder, error))?;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    Ok(folder.join(format!("{stem}.html")))
}
