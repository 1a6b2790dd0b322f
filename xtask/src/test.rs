//! Everything that must pass before a change is one.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Cargo calls in the order in which their failures are quickest to mend. All use the release profile
/// and the whole workspace, so that dependencies are built once.
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

/// The backends beside flex. They are features, so burn is built a second time for them.
const BACKENDS: &str = "xtask/ndarray,xtask/wgpu";
const BACKENDS_WITHOUT_GPU: &str = "xtask/ndarray";

/// Which backends are tested beside flex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backends {
    /// What this machine can run.
    Possible,
    /// Those of the CPU.
    Cpu,
    /// All: a machine that cannot run them fails.
    All,
}

const NO_DRIVER: &str = "no Vulkan driver found, which the tests of the GPU backends need; one that computes on the CPU \
     will do (Debian and Ubuntu: apt-get install mesa-vulkan-drivers)";

/// Runs every step; stops at the first that fails and says which. What this machine cannot run is said at the end.
pub fn run(backends: Backends) -> ExitCode {
    let can = has_vulkan_driver();
    if backends == Backends::All && !can {
        eprintln!("error: {NO_DRIVER}");
        return ExitCode::FAILURE;
    }
    let cpu_only = backends == Backends::Cpu || !can;
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

fn passes(name: &str, arguments: &[&str]) -> bool {
    // Cargo names itself to what it runs.
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

/// Whether a driver is registered with the Vulkan loader. Other systems than Linux bring their own
/// graphics interface.
fn has_vulkan_driver() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    let named =
        ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES"].map(std::env::var_os);
    if named.iter().flatten().any(|files| !files.is_empty()) {
        return true;
    }
    let data = std::env::var_os("XDG_DATA_DIRS").filter(|folders| !folders.is_empty());
    let data = data.unwrap_or_else(|| "/usr/local/share:/usr/share".into());
    let mut places = std::env::split_paths(&data).collect::<Vec<PathBuf>>();
    places.push("/etc".into());
    places.extend(std::env::var_os("XDG_DATA_HOME").map(PathBuf::from));
    places.extend(std::env::var_os("HOME").map(|home| Path::new(&home).join(".local/share")));
    let places = places.into_iter();
    places
        .map(|place| place.join("vulkan/icd.d"))
        .any(|folder| has_json(&folder))
}

fn has_json(folder: &Path) -> bool {
    let Ok(entries) = folder.read_dir() else {
        return false;
    };
    let is_json = |path: PathBuf| path.extension().is_some_and(|ending| ending == "json");
    entries.flatten().any(|entry| is_json(entry.path()))
}
