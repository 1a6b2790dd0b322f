//! Everything that must pass before a change is one.

use std::process::{Command, ExitCode};

/// Cargo calls in the order in which their failures are quickest to mend. All use the release profile
/// and the whole workspace, so that dependencies are built once.
const STEPS: [(&str, &[&str]); 5] = [
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
];

/// Runs every step; stops at the first that fails and says which.
pub fn run() -> ExitCode {
    // Cargo names itself to what it runs.
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    for (name, arguments) in STEPS {
        eprintln!("\n== {name}: cargo {}", arguments.join(" "));
        let status = Command::new(&cargo)
            .args(arguments)
            .env("RUSTDOCFLAGS", "-D warnings")
            .status();
        match status {
            Ok(status) if status.success() => {}
            Ok(status) => {
                eprintln!("error: {name} failed ({status})");
                return ExitCode::FAILURE;
            }
            Err(error) => {
                eprintln!("error: {name}: cannot run {}: {error}", cargo.display());
                return ExitCode::FAILURE;
            }
        }
    }
    eprintln!("\nformat, lints, tests, docs and the example pass");
    ExitCode::SUCCESS
}
