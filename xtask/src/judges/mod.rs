//! Outside programs judge the files that lamogen writes.

mod motions;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use burn::tensor::Device;
use lamogen::{LaMoGen, Request, Tag};
use lamogen_files::glb::{self, GlbOptions};
use lamogen_motion::{Joint, Motion, Rotations, write_atomically};
use serde_json::json;

/// Where files and verdicts are.
const FOLDER: &str = "target/judges";
/// Khronos' validator, as npm names it.
const VALIDATOR: &str = "gltf-validator@2.0.0-dev.3.10";
/// Programs, how each is asked whether it is there, and the Debian package that brings it.
const PROGRAMS: [(&str, &str, &str); 3] = [
    ("node", "--version", "nodejs"),
    ("npm", "--version", "npm"),
    ("blender", "--version", "blender"),
];

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Files of one motion.
struct Exhibit {
    files: Vec<PathBuf>,
    /// Where the joints have to be.
    joints: PathBuf,
    is_drawn: bool,
}

/// Writes motions in all formats, then asks every judge.
pub fn run() -> ExitCode {
    let missing: Vec<&str> = PROGRAMS
        .into_iter()
        .filter(|(program, question, _)| !is_installed(program, question))
        .map(|(.., package)| package)
        .collect();
    if !missing.is_empty() {
        let packages = missing.join(" ");
        eprintln!(
            "error: not all judges are installed (Debian and Ubuntu: apt-get install {packages})"
        );
        return ExitCode::FAILURE;
    }
    let folder = Path::new(FOLDER);
    let exhibits = match exhibits(folder) {
        Ok(exhibits) => exhibits,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    };
    let judges: [(&str, Judge); 2] = [("glTF validator", validator), ("Blender", blender)];
    let mut verdict = ExitCode::SUCCESS;
    for (name, judge) in judges {
        println!("\n== {name}");
        if let Err(error) = judge(folder, &exhibits) {
            eprintln!("error: {name}: {error}");
            verdict = ExitCode::FAILURE;
        }
    }
    verdict
}

type Judge = fn(&Path, &[Exhibit]) -> Result<()>;

/// Writes what is to be judged.
fn exhibits(folder: &Path) -> Result<Vec<Exhibit>> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut exhibits = Vec::new();
    for (name, motion) in motions::all() {
        exhibits.push(exhibit(folder, name, &motion)?);
    }
    let model = LaMoGen::embedded(&Device::flex())?;
    let request = Request::new("a person jumps").tags([Tag::Strong, Tag::Sudden]);
    let generation = model.generate(&request.seconds(3.0).steps(50).seed(7))?;
    exhibits.push(exhibit(folder, "jump", &generation.guided)?);
    Ok(exhibits)
}

fn exhibit(folder: &Path, name: &str, motion: &Motion) -> Result<Exhibit> {
    let rotations = Rotations::of(motion);
    let place = |ending: &str| folder.join(format!("{name}{ending}"));
    let options = GlbOptions {
        name: name.to_owned(),
        ..GlbOptions::default()
    };
    let bare = GlbOptions {
        body: false,
        ..options.clone()
    };
    let files = vec![place(".glb"), place("_bare.glb")];
    glb::write(&files[0], &rotations, &options)?;
    glb::write(&files[1], &rotations, &bare)?;

    let joints = place(".json");
    let truth = json!({
        "frames_per_second": rotations.frames_per_second(),
        "names": Joint::ALL.map(Joint::name),
        "frames": rotations.joints().iter().map(|pose| json!(pose)).collect::<Vec<_>>(),
    });
    write_atomically(&joints, |file| Ok(serde_json::to_writer(file, &truth)?))?;
    Ok(Exhibit {
        files,
        joints,
        is_drawn: true,
    })
}

/// Khronos' glTF validator: no error, no warning.
fn validator(folder: &Path, exhibits: &[Exhibit]) -> Result<()> {
    let packages = folder.join("node");
    std::fs::create_dir_all(&packages)?;
    let mut npm = Command::new("npm");
    npm.args(["install", "--no-audit", "--no-fund", "--prefix"])
        .arg(&packages)
        .arg(VALIDATOR);
    passes(npm.stdout(Stdio::null()))?;
    let files = exhibits.iter().flat_map(|exhibit| &exhibit.files);
    let files = files.filter(|file| file.extension().is_some_and(|ending| ending == "glb"));
    passes(
        Command::new("node")
            .arg(script("validate.mjs"))
            .arg(&packages)
            .args(files),
    )
}

/// Blender's importers with their default settings: every joint where it should be, and a picture.
fn blender(folder: &Path, exhibits: &[Exhibit]) -> Result<()> {
    let work: Vec<_> = exhibits
        .iter()
        .flat_map(|exhibit| exhibit.files.iter().map(move |file| (exhibit, file)))
        .map(|(exhibit, file)| {
            let is_drawn = exhibit.is_drawn && file == &exhibit.files[0];
            // Blender writes pictures below its own folder unless told the whole path.
            let picture = std::path::absolute(file.with_extension("png")).ok();
            json!({
                "file": file,
                "joints": exhibit.joints,
                "picture": picture.filter(|_| is_drawn),
            })
        })
        .collect();
    let list = folder.join("blender.json");
    write_atomically(&list, |file| Ok(serde_json::to_writer(file, &work)?))?;
    let log = folder.join("blender.log");
    let output = Command::new("blender")
        .args(["-b", "--factory-startup", "-noaudio", "--python"])
        .arg(script("blender.py"))
        .arg("--")
        .arg(&list)
        .output()?;
    std::fs::write(&log, [&output.stdout[..], &output.stderr[..]].concat())?;
    let text = String::from_utf8_lossy(&output.stdout);
    // What Blender itself has to say stays in the log.
    for line in text.lines().filter_map(|line| line.strip_prefix("judge: ")) {
        println!("{line}");
    }
    match output.status.success() {
        true => {
            println!("pictures: {}", folder.join("*.png").display());
            Ok(())
        }
        false => Err(format!("{}; its words are in {}", output.status, log.display()).into()),
    }
}

/// A judge's script, beside this crate's sources.
fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("judges")
        .join(name)
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

fn is_installed(program: &str, question: &str) -> bool {
    let mut command = Command::new(program);
    command
        .arg(question)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}
