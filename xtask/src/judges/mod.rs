//! Outside programs judge what lamogen writes.

mod exhibits;
mod motions;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use lamogen_motion::write_atomically;
use serde_json::json;

use exhibits::Exhibits;

/// Where files and pictures are.
const FOLDER: &str = "target/judges";
/// The scripts that the judges run, and what these need of npm, beside this crate's sources.
const SCRIPTS: [&str; 4] = ["package.json", "validate.mjs", "page.mjs", "blender.py"];
/// Commands that fail where something is missing, and the Debian package that brings it.
const NEEDED: [(&[&str], &str); 5] = [
    (&["node", "--version"], "nodejs"),
    (&["npm", "--version"], "npm"),
    (&["chromium", "--version"], "chromium"),
    (&["blender", "--version"], "blender"),
    // Its glTF importer's, which Debian only suggests.
    (
        &[
            "blender",
            "-b",
            "--python-exit-code",
            "1",
            "--python-expr",
            "import numpy",
        ],
        "python3-numpy",
    ),
];

/// How far joints may be from where they should be, in metres.
const TOLERANCE: f32 = 0.002;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Asked about the exhibits; the folder is that of the scripts.
type Judge = fn(&Path, &Exhibits) -> Result<()>;
const JUDGES: [(&str, Judge); 3] = [
    ("glTF validator", validator),
    ("Blender", blender),
    ("the page in a browser", browser),
];

/// Writes motions in all formats, then asks every judge; fails if a judge is not installed, cannot be asked, or
/// finds fault.
pub fn run() -> ExitCode {
    let missing: Vec<&str> = NEEDED
        .into_iter()
        .filter(|(command, _)| !succeeds(command))
        .map(|(_, package)| package)
        .collect();
    if !missing.is_empty() {
        let packages = missing.join(" ");
        eprintln!(
            "error: not all that judges is installed (Debian and Ubuntu: apt-get install {packages})"
        );
        return ExitCode::FAILURE;
    }
    let folder = Path::new(FOLDER);
    let (exhibits, scripts) = match Exhibits::write(folder)
        .and_then(|exhibits| Ok((exhibits, install(&folder.join("scripts"))?)))
    {
        Ok(ready) => ready,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    };
    let mut verdict = ExitCode::SUCCESS;
    for (name, judge) in JUDGES {
        println!("\n== {name}");
        if let Err(error) = judge(&scripts, &exhibits) {
            eprintln!("error: {name}: {error}");
            verdict = ExitCode::FAILURE;
        }
    }
    println!("\nfiles and pictures are in {FOLDER}");
    verdict
}

/// Copies the scripts to where npm may install what they need.
fn install(folder: &Path) -> Result<PathBuf> {
    std::fs::create_dir_all(folder)?;
    for name in SCRIPTS {
        let from = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("judges")
            .join(name);
        std::fs::copy(&from, folder.join(name))
            .map_err(|error| format!("{}: {error}", from.display()))?;
    }
    let mut npm = Command::new("npm");
    npm.args(["install", "--no-audit", "--no-fund"])
        .current_dir(folder);
    passes(npm.stdout(Stdio::null()))?;
    Ok(folder.to_owned())
}

/// Khronos' glTF validator: no error, no warning.
fn validator(scripts: &Path, exhibits: &Exhibits) -> Result<()> {
    let mut node = Command::new("node");
    node.arg(scripts.join("validate.mjs"));
    for take in &exhibits.takes {
        node.arg(&take.glb).arg(&take.bare_glb);
    }
    passes(&mut node)
}

/// Blender's importers: every joint where it should be at every frame, and pictures. Then what Blender exports,
/// read by lamogen.
fn blender(scripts: &Path, exhibits: &Exhibits) -> Result<()> {
    let mut work = Vec::new();
    for take in &exhibits.takes {
        // Blender writes pictures to a folder of its own unless told the whole path.
        let picture = std::path::absolute(take.glb.with_extension("png"))?;
        let (joints, again) = (&take.joints, &take.again_glb);
        work.extend([
            json!({ "file": take.glb, "joints": joints, "again": again, "picture": picture }),
            json!({ "file": take.bare_glb, "joints": joints, "again": null, "picture": null }),
            json!({ "file": take.bvh, "joints": joints, "again": null, "picture": null }),
        ]);
    }
    let list = Path::new(FOLDER).join("blender.json");
    write_atomically(&list, |file| Ok(serde_json::to_writer(file, &work)?))?;
    let output = Command::new("blender")
        .args(["-b", "--factory-startup", "-noaudio", "--python"])
        .arg(scripts.join("blender.py"))
        .arg("--")
        .arg(&list)
        .output()?;
    // Blender talks a lot; what it says beside the verdicts is kept for when they are bad.
    let log = Path::new(FOLDER).join("blender.log");
    std::fs::write(&log, [&output.stdout[..], &output.stderr[..]].concat())?;
    let text = String::from_utf8_lossy(&output.stdout);
    let verdicts: Vec<&str> = text
        .lines()
        .filter_map(|line| line.strip_prefix("judge: "))
        .collect();
    println!("{}", verdicts.join("\n"));
    if !output.status.success() || verdicts.len() != work.len() {
        return Err(format!("{}; more in {}", output.status, log.display()).into());
    }
    for take in &exhibits.takes {
        let gap = take.gap_again()?;
        let name = take.again_glb.display();
        println!(
            "{name}, exported by Blender and read again: {:.4} mm at most",
            1000.0 * gap
        );
        if gap > TOLERANCE {
            return Err(format!("{name}: expected at most {TOLERANCE} m").into());
        }
    }
    Ok(())
}

/// The page, used in Chromium as people use it.
fn browser(scripts: &Path, exhibits: &Exhibits) -> Result<()> {
    passes(
        Command::new("node")
            .arg(scripts.join("page.mjs"))
            .arg(&exhibits.page)
            .arg(Path::new(FOLDER).join("page")),
    )
}

fn passes(command: &mut Command) -> Result<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command
        .status()
        .map_err(|error| format!("cannot run {program}: {error}"))?;
    match status.success() {
        true => Ok(()),
        false => Err(format!("{program} failed ({status})").into()),
    }
}

fn succeeds(command: &[&str]) -> bool {
    let mut program = Command::new(command[0]);
    program
        .args(&command[1..])
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    program.status().is_ok_and(|status| status.success())
}
