//! Checks of the files that lamogen writes by other programs, the judges.

mod cluster;
mod files;
mod motions;
mod recording;
mod server;
mod vrm;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use lamogen_motion::write_atomically;
use serde_json::json;

use files::JudgedFiles;

/// The folder of the files and pictures.
const FOLDER: &str = "target/judges";
/// The scripts of the judges and their npm package file, in the folder `judges` of this crate.
const SCRIPTS: [&str; 8] = [
    "package.json",
    "browser.mjs",
    "validate.mjs",
    "page.mjs",
    "studio.mjs",
    "vrma.mjs",
    "player.mjs",
    "blender.py",
];
/// The required programs: a command that fails if the program is missing, and the Debian package that contains it.
const REQUIRED_PROGRAMS: [(&[&str], &str); 9] = [
    (&["node", "--version"], "nodejs"),
    (&["npm", "--version"], "npm"),
    (&["chromium", "--version"], "chromium"),
    (&["blender", "--version"], "blender"),
    (&["python3", "-c", "import ensurepip"], "python3-venv"),
    (&["curl", "--version"], "curl"),
    (&["slurmctld", "-V"], "slurm-wlm"),
    (&["munged", "--version"], "munge"),
    // Blender's glTF importer needs numpy, which the Debian package of Blender only suggests.
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

/// The largest accepted distance in metres between a joint and the expected joint.
const TOLERANCE: f32 = 0.002;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// A check of the files by another program. The path is the folder of the scripts.
type Judge = fn(&Path, &JudgedFiles) -> Result<()>;
const JUDGES: [(&str, Judge); 9] = [
    ("glTF validator", check_with_validator),
    ("Blender", check_with_blender),
    ("the page in a browser", check_in_browser),
    ("the studio in a browser", check_studio),
    ("three-vrm in a browser", check_with_three_vrm),
    ("schemathesis", server::check_interface),
    ("the examples of the server", server::check_examples),
    ("HyperQueue", cluster::check_under_hyperqueue),
    ("Slurm", cluster::check_under_slurm),
];

/// Writes motions in all formats and lets every judge whose name contains `only` check them. Fails if there is none, or if a
/// judge is not installed, cannot be run, or finds an error.
pub fn run(only: &str) -> ExitCode {
    let chosen = |name: &str| name.to_lowercase().contains(&only.to_lowercase());
    if !JUDGES.iter().any(|(name, _)| chosen(name)) {
        let names = JUDGES.map(|(name, _)| name).join(", ");
        eprintln!("error: expected a part of the name of a judge ({names}), found {only:?}");
        return ExitCode::FAILURE;
    }
    let missing: Vec<&str> = REQUIRED_PROGRAMS
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
    let (files, scripts) = match JudgedFiles::write(folder)
        .and_then(|files| Ok((files, install_scripts(&folder.join("scripts"))?)))
    {
        Ok(written) => written,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    };
    let mut exit_code = ExitCode::SUCCESS;
    for (name, judge) in JUDGES.into_iter().filter(|(name, _)| chosen(name)) {
        println!("\n== {name}");
        if let Err(error) = judge(&scripts, &files) {
            eprintln!("error: {name}: {error}");
            exit_code = ExitCode::FAILURE;
        }
    }
    println!("\nfiles and pictures are in {FOLDER}");
    exit_code
}

/// Copies the scripts to a folder, and installs their npm packages there. Returns the folder.
fn install_scripts(folder: &Path) -> Result<PathBuf> {
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
    run_command(npm.stdout(Stdio::null()))?;
    Ok(folder.to_owned())
}

/// Checks that Khronos' glTF validator finds no error and no warning.
fn check_with_validator(scripts: &Path, files: &JudgedFiles) -> Result<()> {
    let mut node = Command::new("node");
    node.arg(scripts.join("validate.mjs"));
    for motion in &files.motions {
        node.arg(&motion.glb).arg(&motion.bare_glb);
    }
    node.args(&files.vrm.animations);
    run_command(&mut node)
}

/// Checks that Blender imports every joint at its expected position in every frame, and lets Blender draw pictures. Then lamogen
/// reads the files that Blender exports, and their joints are checked as well.
fn check_with_blender(scripts: &Path, files: &JudgedFiles) -> Result<()> {
    let mut work = Vec::new();
    for motion in &files.motions {
        // Without an absolute path, Blender writes pictures to another folder.
        let picture = std::path::absolute(motion.glb.with_extension("png"))?;
        let (joints, again) = (&motion.joints, &motion.reexported_glb);
        work.extend([
            json!({ "file": motion.glb, "joints": joints, "again": again, "picture": picture }),
            json!({ "file": motion.bare_glb, "joints": joints, "again": null, "picture": null }),
            json!({ "file": motion.bvh, "joints": joints, "again": null, "picture": null }),
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
    // Blender prints much besides the verdicts; the whole output is kept in a log file for the case of an error.
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
    for motion in &files.motions {
        let error = motion.reexport_error()?;
        let name = motion.reexported_glb.display();
        println!(
            "{name}, exported by Blender and read again: {:.4} mm at most",
            1000.0 * error
        );
        if error > TOLERANCE {
            return Err(format!("{name}: expected at most {TOLERANCE} m").into());
        }
    }
    Ok(())
}

/// Checks the page by using it in Chromium as people use it.
fn check_in_browser(scripts: &Path, files: &JudgedFiles) -> Result<()> {
    run_command(
        Command::new("node")
            .arg(scripts.join("page.mjs"))
            .arg(&files.page)
            .arg(Path::new(FOLDER).join("page")),
    )
}

/// Checks the studio by using it in Chromium as people use it.
fn check_studio(scripts: &Path, files: &JudgedFiles) -> Result<()> {
    let bvh = &files.motions.last().ok_or("expected a motion")?.bvh;
    let vrm = files.vrm.characters.first().ok_or("expected a character")?;
    let pictures = Path::new(FOLDER).join("studio");
    run_command(
        Command::new("node")
            .arg(scripts.join("studio.mjs"))
            .arg(build_command()?)
            .arg(bvh)
            .arg(vrm)
            .arg(&pictures),
    )?;
    recording::write_recording(&pictures.join("slider"), &pictures.join("slider.gif"))
}

/// Checks that VRM animations move VRM characters as the motions say, and lets three.js draw pictures.
fn check_with_three_vrm(scripts: &Path, files: &JudgedFiles) -> Result<()> {
    run_command(
        Command::new("node")
            .arg(scripts.join("vrma.mjs"))
            .arg(&files.vrm.list)
            .arg(Path::new(FOLDER).join("vrm")),
    )
}

/// Installs a package of Python in an environment of its own in the folder of the judges. Returns the folder of its programs.
fn install_python(environment: &str, package: &str) -> Result<PathBuf> {
    let environment = Path::new(FOLDER).join(environment);
    let mut make = Command::new("python3");
    run_command(make.args(["-m", "venv"]).arg(&environment))?;
    let bin = environment.join("bin");
    let mut pip = Command::new(bin.join("python"));
    run_command(pip.args(["-m", "pip", "install", "--quiet", package]))?;
    Ok(bin)
}

/// Builds the command `lamogen`. Returns its path.
pub(crate) fn build_command() -> Result<PathBuf> {
    let mut cargo = Command::new("cargo");
    cargo.args([
        "build",
        "--release",
        "--quiet",
        "--workspace",
        "--bin",
        "lamogen",
    ]);
    run_command(&mut cargo)?;
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or("target".into());
    Ok(std::path::absolute(
        Path::new(&target).join("release/lamogen"),
    )?)
}

/// Runs a command; its failure is an error.
fn run_command(command: &mut Command) -> Result<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command
        .status()
        .map_err(|error| format!("cannot run {program}: {error}"))?;
    match status.success() {
        true => Ok(()),
        false => Err(format!("{program} failed ({status})").into()),
    }
}

/// Returns whether a command succeeds, without showing its output.
fn succeeds(command: &[&str]) -> bool {
    let mut program = Command::new(command[0]);
    program
        .args(&command[1..])
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    program.status().is_ok_and(|status| status.success())
}
