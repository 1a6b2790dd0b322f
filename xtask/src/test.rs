//! The checks that every change must pass.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// The Cargo commands; those with failures that are quickest to fix come first. All use the release profile and the whole
/// workspace, so that dependencies are built once.
const STEPS: [(&str, &[&str]); 7] = [
    ("format", &["fmt", "--all", "--check"]),
    (
        "lints",
        &[
            "clippy",
            "--release",
            "--workspace",
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ],
    ),
    ("tests", &["test", "--release", "--workspace"]),
    ("docs", &["doc", "--release", "--workspace", "--no-deps"]),
    (
        "example",
        &[
            "run",
            "--release",
            "--example",
            "guided_jump",
            "--",
            "--steps",
            "20",
        ],
    ),
    (
        "example over time",
        &[
            "run",
            "--release",
            "--example",
            "time_varying",
            "--",
            "--steps",
            "20",
        ],
    ),
    (
        "example with a file",
        &["run", "--release", "--example", "report_bvh"],
    ),
];

/// The features of the backends besides flex. Because they are features, burn is built a second time for them.
const BACKENDS: &str = "xtask/ndarray,xtask/wgpu";
const BACKENDS_WITHOUT_GPU: &str = "xtask/ndarray";

/// The backends that are tested besides flex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backends {
    /// Those that this machine can run.
    Possible,
    /// Those of the CPU.
    Cpu,
    /// All; the checks fail on a machine that cannot run them.
    All,
}

const NO_DRIVER: &str = "no Vulkan driver found, which the tests of the GPU backends need; one that computes on the CPU \
     will do (Debian and Ubuntu: apt-get install mesa-vulkan-drivers)";

/// Runs all checks, and stops at the first that fails. The end of the output names what this machine cannot run.
pub fn run(backends: Backends) -> ExitCode {
    let has_driver = has_vulkan_driver();
    if backends == Backends::All && !has_driver {
        eprintln!("error: {NO_DRIVER}");
        return ExitCode::FAILURE;
    }
    let cpu_only = backends == Backends::Cpu || !has_driver;
    for (name, arguments) in STEPS {
        if !passes(name, arguments) {
            return ExitCode::FAILURE;
        }
    }
    let features = match cpu_only {
        true => BACKENDS_WITHOUT_GPU,
        false => BACKENDS,
    };
    let arguments = ["test", "--release", "--workspace", "--features", features];
    if !passes(
        "backends",
        &[&arguments[..], &["--test", "backends"]].concat(),
    ) {
        return ExitCode::FAILURE;
    }
    eprintln!("\nformat, lints, tests, docs, the examples and the backends pass");
    match (cpu_only, backends) {
        (false, _) => {}
        (true, Backends::Cpu) => eprintln!("the GPU backends were left out, as --cpu-only asks"),
        (true, _) => eprintln!("the GPU backends were left out: {NO_DRIVER}"),
    }
    ExitCode::SUCCESS
}

/// Runs a Cargo command and returns whether it succeeded.
fn passes(name: &str, arguments: &[&str]) -> bool {
    // Cargo sets this variable for the programs that it runs.
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    eprintln!("\n== {name}: cargo {}", arguments.join(" "));
    let status = Command::new(&cargo)
        .args(arguments)
        .env("RUSTDOCFLAGS", "-D warnings")
        .status();
    match status {
        Ok(status) if status.success() => return true,
        Ok(status) => eprintln!("error: {name} failed ({status})"),
        Err(error) => eprintln!("error: {name}: cannot run {}: {error}", cargo.display()),
    }
    false
}

/// Returns whether a driver is registered with the Vulkan loader. Operating systems other than Linux have their own graphics
/// interface.
fn has_vulkan_driver() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    let listed =
        ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES"].map(std::env::var_os);
    if listed.iter().flatten().any(|files| !files.is_empty()) {
        return true;
    }
    let data = std::env::var_os("XDG_DATA_DIRS").filter(|folders| !folders.is_empty());
    let data = data.unwrap_or_else(|| "/usr/local/share:/usr/share".into());
    let mut folders = std::env::split_paths(&data).collect::<Vec<PathBuf>>();
    folders.push("/etc".into());
    folders.extend(std::env::var_os("XDG_DATA_HOME").map(PathBuf::from));
    folders.extend(std::env::var_os("HOME").map(|home| Path::new(&home).join(".local/share")));
    let folders = folders.into_iter();
    folders
        .map(|folder| folder.join("vulkan/icd.d"))
        .any(|folder| has_json(&folder))
}

/// Returns whether a folder has a JSON file.
fn has_json(folder: &Path) -> bool {
    let Ok(entries) = folder.read_dir() else {
        return false;
    };
    let is_json = |path: PathBuf| path.extension().is_some_and(|ending| ending == "json");
    entries.flatten().any(|entry| is_json(entry.path()))
}
