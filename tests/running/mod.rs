//! Running the command.

use std::path::Path;
use std::process::Command;

/// The command, to be run in a folder.
pub fn lamogen(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lamogen"));
    command.current_dir(folder).args(arguments);
    command
}

/// What is printed to stdout and to stderr by a command that succeeds.
pub fn succeeds(folder: &Path, arguments: &[&str]) -> (String, String) {
    ends(folder, arguments, 0)
}

/// What is printed to stdout and to stderr by a command that ends with a code.
pub fn ends(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    let output = lamogen(folder, arguments).output();
    let output = output.expect("the command starts");
    let texts = [output.stdout, output.stderr].map(|text| String::from_utf8(text).expect("UTF-8"));
    let [result, notices] = texts;
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {notices}");
    (result, notices)
}

/// Fails with a code, and says each of `parts` on stderr and nothing on stdout.
pub fn fails(folder: &Path, arguments: &[&str], code: i32, parts: &[&str]) {
    let output = lamogen(folder, arguments).output();
    let output = output.expect("the command starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {errors}");
    for part in parts {
        assert!(errors.contains(part), "{arguments:?}: {errors}");
    }
    assert!(output.stdout.is_empty(), "{arguments:?}");
}
