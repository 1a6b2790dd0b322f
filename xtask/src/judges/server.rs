//! The server as other programs use it: by its OpenAPI document, and by the examples of its documentation.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::files::JudgedFiles;
use super::{FOLDER, Result, build_command, install_python, run_command};
use crate::running_server::RunningServer;

/// The token of the judged server. Every judge knows it.
const TOKEN: &str = "token-of-the-judges";

/// Lets schemathesis ask for what the OpenAPI document of the server says, and for what it does not.
pub(super) fn check_interface(_: &Path, _: &JudgedFiles) -> Result<()> {
    let bin = std::path::absolute(install_python("schemathesis-venv", "schemathesis")?)?;
    // Motions longer than the default would only take time. On a busy machine the paper's preset takes minutes.
    let options = ["--quiet", "--max-seconds", "3", "--time-limit", "600"];
    let options = [&options[..], &["--token", TOKEN]].concat();
    let server = RunningServer::start(&build_command()?, &options)?;
    let mut judge = Command::new(bin.join("schemathesis"));
    judge
        .arg("run")
        .arg(format!("http://{}/api/v1/openapi.json", server.address()))
        .args(["--header", &format!("Authorization: Bearer {TOKEN}")])
        .args(["--max-examples", "25", "--seed", "1", "--no-shrink"])
        .args(["--continue-on-failure", "--generation-database", "none"])
        .args(["--request-timeout", "600"])
        // What a factor or a path may say as a text, and how long a model's motions are, is beyond a schema.
        .args(["--exclude-checks", "positive_data_acceptance"])
        // It writes its cases to the folder in which it runs.
        .current_dir(FOLDER);
    run_command(&mut judge)
}

/// A program of a page of the documentation.
struct Example {
    /// The language after the fence, such as `python`.
    language: String,
    code: String,
}

/// Returns the programs of a page, in their order.
fn examples(page: &str) -> Vec<Example> {
    let mut examples = Vec::new();
    let mut open: Option<Example> = None;
    for line in page.lines() {
        match (&mut open, line.strip_prefix("```")) {
            (None, Some(language)) => {
                open = Some(Example {
                    language: language.to_owned(),
                    code: String::new(),
                });
            }
            (Some(_), Some(_)) => examples.extend(open.take()),
            (Some(example), None) => {
                example.code += line;
                example.code.push('\n');
            }
            (None, None) => {}
        }
    }
    examples
}

/// Runs the examples of `docs/server.md` in curl, Python and JavaScript against a server, and reads the files that they write. The one for
/// Godot, which no package installs, is parsed.
pub(super) fn check_examples(_: &Path, _: &JudgedFiles) -> Result<()> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/server.md");
    let page = fs::read_to_string(page)?;
    let command = build_command()?;
    let server = RunningServer::start(&command, &["--quiet"])?;
    let folder = Path::new(FOLDER).join("server");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder)?;
    let here = |code: &str| code.replace("127.0.0.1:8765", server.address());

    let all = examples(&page);
    let find = |language: &str, part: &str| {
        let found = all
            .iter()
            .find(|example| example.language == language && example.code.contains(part));
        found
            .ok_or_else(|| format!("docs/server.md: expected an example in {language} with {part}"))
    };
    let shell = here(&find("sh", "curl")?.code);
    run_command(
        Command::new("sh")
            .args(["-e", "-c", &shell])
            .current_dir(&folder),
    )?;
    fs::write(
        folder.join("ask.py"),
        here(&find("python", "generate(")?.code),
    )?;
    let output = Command::new("python3")
        .arg("ask.py")
        .current_dir(&folder)
        .output()?;
    let printed = String::from_utf8_lossy(&output.stdout);
    if !output.status.success() || printed.trim().parse::<f64>().is_err() {
        let errors = String::from_utf8_lossy(&output.stderr);
        return Err(format!("expected the Python to print a number: {printed}{errors}").into());
    }
    // The example ends with the bytes in a constant.
    let keep =
        "\nimport { writeFileSync } from \"node:fs\";\nwriteFileSync(\"script.glb\", glb);\n";
    let script = here(&find("js", "const glb")?.code) + keep;
    fs::write(folder.join("ask.mjs"), script)?;
    run_command(Command::new("node").arg("ask.mjs").current_dir(&folder))?;

    fs::write(folder.join("ask.gd"), &find("gdscript", "generate")?.code)?;
    let bin = std::path::absolute(install_python("gdtoolkit-venv", "gdtoolkit")?)?;
    let mut parse = Command::new(bin.join("gdparse"));
    run_command(parse.arg("ask.gd").current_dir(&folder))?;

    let mut generate = Command::new(&command);
    generate.args([
        "generate",
        "a person jumps",
        "--weight",
        "strong",
        "--seconds",
        "3",
    ]);
    generate.args([
        "--seed",
        "7",
        "--out",
        "expected.glb",
        "--out",
        "expected.bvh",
        "--quiet",
    ]);
    run_command(generate.current_dir(&folder))?;
    for (written, expected) in [
        ("jump.glb", "expected.glb"),
        ("jump.bvh", "expected.bvh"),
        ("script.glb", "expected.glb"),
    ] {
        if fs::read(folder.join(written))? != fs::read(folder.join(expected))? {
            return Err(format!("{written}: expected the bytes of lamogen generate").into());
        }
        println!("{written} has the bytes of lamogen generate");
    }
    Ok(())
}
