//! The command when it is cut short, cannot say anything, or is given something else than a file.

mod model_folder;
mod running;

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use running::{ends, fails, lamogen, succeeds};
use serde_json::Value;

const BATCH: [&str; 7] = [
    "batch",
    "requests.jsonl",
    "--out",
    "out",
    "--format",
    "npy,bvh",
    "--json",
];

fn batch(folder: &Path, more: &[&str], code: i32) -> Value {
    let (result, notices) = ends(folder, &[&BATCH, more].concat(), code);
    match result.is_empty() {
        true => Value::Null,
        false => serde_json::from_str(&result).unwrap_or_else(|_| panic!("{result}{notices}")),
    }
}

fn requests(folder: &Path, lines: &str) {
    fs::write(folder.join("requests.jsonl"), lines).unwrap();
}

const WALK: &str = r#"{"prompt": "a person walks", "id": "walk", "seconds": 2}"#;

#[test]
fn a_record_never_speaks_of_files_that_another_run_wrote() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    requests(folder, WALK);
    let steps = |steps, code| batch(folder, &["--steps", steps], code);
    assert_eq!(steps("2", 0)["made"], 1);
    assert_eq!(steps("2", 0)["finished_before"], 1);
    let array = folder.join("out/walk.npy");
    let before = fs::read(&array).unwrap();
    // The array of other options is written, the rig cannot be: a disk would be full here.
    let rig = folder.join("out/walk.bvh");
    let kept = fs::read(&rig).unwrap();
    fs::remove_file(&rig).unwrap();
    fs::create_dir(&rig).unwrap();
    steps("3", 4);
    assert!(fs::read(&array).unwrap() != before);
    fs::remove_dir(&rig).unwrap();
    fs::write(&rig, kept).unwrap();
    let again = steps("2", 0);
    assert_eq!(
        (&again["made"], &again["finished_before"]),
        (&1.into(), &0.into())
    );
    assert!(fs::read(&array).unwrap() == before);
}

#[test]
fn a_model_and_a_file_to_be_like_are_known_by_what_is_in_them() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let model = folder.join("model");
    fs::create_dir(&model).unwrap();
    model_folder::write(&model);
    let like = r#"{"prompt": "a person walks", "id": "like", "seconds": 2, "like": "other.npy"}"#;
    requests(folder, &format!("{WALK}\n{like}\n"));
    let other = |seed| {
        let arguments = [
            "generate",
            "a person runs",
            "--steps",
            "2",
            "--seed",
            seed,
            "--out",
            "other.npy",
        ];
        succeeds(folder, &arguments);
    };
    other("1");
    let run = || {
        let made = batch(folder, &["--steps", "2", "--model", "model"], 0);
        [made["made"].clone(), made["finished_before"].clone()].map(|count| count.as_u64().unwrap())
    };
    assert_eq!(run(), [2, 0]);
    assert_eq!(run(), [0, 2]);
    // The same name, another motion.
    other("2");
    assert_eq!(run(), [1, 1]);
    assert_eq!(run(), [0, 2]);
    // The same folder, other statistics.
    let mut mean = lamogen_compact::MEAN.to_vec();
    let last = mean.len() - 4;
    mean[last..].copy_from_slice(&0.25f32.to_le_bytes());
    fs::write(model.join("mean.npy"), mean).unwrap();
    assert_eq!(run(), [2, 0]);
    assert_eq!(run(), [0, 2]);
}

#[test]
#[cfg(unix)]
fn a_signal_leaves_no_temporary_file_and_what_was_finished_counts() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let lines = (0..400).map(|seed| {
        format!("{{\"prompt\": \"a person walks\", \"seconds\": 9, \"seed\": {seed}}}\n")
    });
    requests(folder, &lines.collect::<String>());
    // What a process that was killed has left a while ago.
    fs::create_dir(folder.join("out")).unwrap();
    let left = folder.join("out/.lamogen-left");
    let hour_ago = std::time::SystemTime::now() - Duration::from_secs(3600);
    File::create(&left).unwrap().set_modified(hour_ago).unwrap();
    let arguments = [&BATCH[..], &["--steps", "2", "--format", "html,gif"]].concat();
    let child = lamogen(folder, &arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let child = child.unwrap();
    let start = Instant::now();
    while !folder.join("out/line-00002.json").exists() {
        assert!(
            start.elapsed() < Duration::from_secs(120),
            "no motion was made"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    let killed = std::process::Command::new("kill")
        .args(["-TERM", &child.id().to_string()])
        .status();
    assert!(killed.unwrap().success());
    let output = child.wait_with_output().unwrap();
    match output.status.code() {
        // A motion was being made.
        Some(6) => {
            let notices = String::from_utf8(output.stderr).unwrap();
            assert!(
                notices.contains(" of 400 motions are finished"),
                "{notices}"
            );
        }
        // Files were being written.
        code => assert_eq!(code, Some(130)),
    }
    let names = fs::read_dir(folder.join("out")).unwrap().flatten();
    let names: Vec<String> = names
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    let temporary: Vec<&String> = names.iter().filter(|name| name.starts_with('.')).collect();
    assert!(temporary.is_empty(), "{temporary:?}");
}

/// Runs a command and stops it, later and later until it has kept a file. Returns what it has said. `check` receives the exit codes
/// before.
#[cfg(unix)]
fn stopped_once(folder: &Path, arguments: &[&str], kept: &Path, check: impl Fn(i32)) -> String {
    let notices = [2, 4, 8, 16, 32].into_iter().find_map(|seconds| {
        let child = lamogen(folder, arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let child = child.unwrap();
        std::thread::sleep(Duration::from_secs(seconds));
        let killed = std::process::Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status();
        assert!(killed.unwrap().success());
        let output = child.wait_with_output().unwrap();
        let notices = String::from_utf8(output.stderr).unwrap();
        match (output.status.code(), kept.exists()) {
            (Some(6), true) => Some(notices),
            (Some(code @ (6 | 130)), false) => {
                check(code);
                None
            }
            (other, _) => panic!("exit code {other:?}: {notices}"),
        }
    });
    notices.expect("a stretch takes less than half a minute")
}

#[test]
#[cfg(unix)]
fn a_long_line_of_a_batch_that_is_stopped_keeps_its_finished_stretches() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let long = r#"{"prompt": "a person walks", "id": "long", "seconds": 3000, "seed": 3}"#;
    requests(folder, &format!("{WALK}\n{long}\n"));
    let options = ["--steps", "2", "--batch-size", "1"];
    let arguments = [&BATCH[..], &options].concat();
    let out = |name: &str| folder.join("out").join(name);
    let notices = stopped_once(folder, &arguments, &out("long-unfinished.bvh"), |code| {
        // Code 6 comes with the short motion.
        assert!(code == 130 || out("walk.json").exists());
    });
    assert!(
        notices.contains("long-unfinished.bvh has the first ")
            && notices.contains(" s of 3000.0 s (text alone)")
            && notices.contains("stopped; 1 of 2 motions are finished"),
        "{notices}"
    );
    succeeds(folder, &["laban", "out/long-unfinished.bvh"]);
    let facts = fs::read_to_string(out("long-unfinished.json")).unwrap();
    let facts: Value = serde_json::from_str(&facts).unwrap();
    assert_eq!(
        (&facts["unfinished"], &facts["seed"]),
        (&true.into(), &3.into())
    );
    // It does not count as finished, and the finished motion supersedes it.
    let left = batch(folder, &[&options[..2], &["--merge"]].concat(), 5);
    assert_eq!(left["finished"], 1);
    requests(folder, &format!("{WALK}\n{}\n", long.replace("3000", "2")));
    assert_eq!(batch(folder, &options, 0)["made"], 1);
    assert!(out("long.bvh").exists());
    for ending in ["npy", "bvh", "json"] {
        assert!(!out(&format!("long-unfinished.{ending}")).exists());
    }
}

#[test]
#[cfg(unix)]
fn a_long_motion_that_is_stopped_keeps_its_finished_stretches() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let arguments = [
        "generate",
        "a person walks forward",
        "--seconds",
        "3000",
        "--then",
        "a person jumps",
        "--weight",
        "strong",
        "--steps",
        "2",
        "--out",
        "walk.npy",
        "--out",
        "walk.csv",
    ];
    let unfinished = folder.join("walk-unfinished.npy");
    let notices = stopped_once(folder, &arguments, &unfinished, |code| {
        assert_eq!(code, 130);
        assert_eq!(fs::read_dir(folder).unwrap().count(), 0);
    });
    assert!(
        notices.contains("walk-unfinished.npy has the first ")
            && notices.contains(" s of 3003.0 s (text alone)")
            && notices.contains("stopped; 0 of 1 motions are finished"),
        "{notices}"
    );
    let (report, _) = succeeds(folder, &["laban", "walk-unfinished.npy", "--json"]);
    let report: Value = serde_json::from_str(&report).unwrap();
    let frames = report["motions"][0]["frames"].as_u64().unwrap();
    assert!((100..60_060).contains(&frames), "{frames}");
    let table = fs::read_to_string(folder.join("walk-unfinished.csv")).unwrap();
    assert_eq!(table.lines().count() as u64, frames + 1);
    // Nothing was done for the goals yet.
    assert!(!table.contains("Weight 1.5"));
    assert!(!folder.join("walk.npy").exists());
}

#[test]
#[cfg(target_os = "linux")]
fn what_cannot_be_said_stops_no_work() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    requests(folder, WALK);
    let full = || File::options().write(true).open("/dev/full").unwrap();
    let arguments = [&BATCH[..], &["--steps", "2"]].concat();
    let run = lamogen(folder, &arguments).stderr(full()).output().unwrap();
    assert_eq!(run.status.code(), Some(0));
    assert!(folder.join("out/walk.json").exists());
    // An error keeps its code.
    let run = lamogen(folder, &["laban", "nothing.bvh"])
        .stderr(full())
        .output()
        .unwrap();
    assert_eq!(run.status.code(), Some(3));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let run = lamogen(folder, &["laban", "nothing.bvh"])
        .stderr(writer)
        .output()
        .unwrap();
    assert_eq!(run.status.code(), Some(3));
}

/// What the command prints when it is given something on standard input.
fn given(folder: &Path, arguments: &[&str], input: &[u8]) -> (i32, String, String) {
    let child = lamogen(folder, arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = child.unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    let output = child.wait_with_output().unwrap();
    let [result, notices] =
        [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    (output.status.code().unwrap(), result, notices)
}

#[test]
fn standard_input_is_a_file_too() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let arguments = ["generate", "a person walks", "--steps", "2", "--quiet"];
    let files = ["walk.bvh", "walk.glb", "walk.npy"];
    let outs = files.iter().flat_map(|file| ["--out", file]);
    succeeds(
        folder,
        &arguments.into_iter().chain(outs).collect::<Vec<_>>(),
    );
    for file in files {
        let bytes = fs::read(folder.join(file)).unwrap();
        let (code, result, notices) = given(folder, &["laban", "-", "--json"], &bytes);
        assert_eq!(code, 0, "{notices}");
        let result: Value = serde_json::from_str(&result).unwrap();
        assert_eq!(result["file"], "standard input");
        assert_eq!(result["motions"][0]["frames"], 60, "{file}");
        let ending = &file[5..];
        let (code, _, notices) = given(
            folder,
            &["convert", "-", "again.npy", "--from", ending],
            &bytes,
        );
        assert_eq!(code, 0, "{notices}");
    }
    let (code, result, notices) = given(
        folder,
        &["batch", "-", "--out", "out", "--steps", "2", "--json"],
        WALK.as_bytes(),
    );
    assert_eq!(code, 0, "{notices}");
    assert_eq!(serde_json::from_str::<Value>(&result).unwrap()["made"], 1);
    for (arguments, input, code, part) in [
        (
            &["laban", "-"][..],
            &b"what?"[..],
            3,
            "standard input: expected a motion in BVH",
        ),
        (
            &["laban", "-", "--from", "bvh"],
            b"what?",
            3,
            "standard input",
        ),
        (
            &["batch", "-", "--out", "out"],
            b"{\"prompt\": 3}",
            2,
            "standard input, line 1",
        ),
    ] {
        let (found, _, notices) = given(folder, arguments, input);
        assert_eq!(found, code, "{notices}");
        assert!(notices.contains(part), "{notices}");
    }
    fails(
        folder,
        &["laban", "walk.bvh", "--from", "bvh"],
        2,
        &["expected standard input (-), found walk.bvh"],
    );
}

#[test]
fn numbers_beyond_all_measure_are_refused_with_their_limit() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let far = lamogen::Motion::from_joints(vec![[[1e30, 0.0, 0.0]; 22]; 40]).unwrap();
    far.save_joints(folder.join("far.npy")).unwrap();
    for out in ["far.bvh", "far.glb"] {
        fails(
            folder,
            &["convert", "far.npy", out],
            4,
            &["within 1000000 m", "pelvis at frame 0"],
        );
        assert!(!folder.join(out).exists());
    }
    let near = lamogen::Motion::from_joints(vec![[[0.0; 3]; 22]; 72_000]).unwrap();
    near.save_joints(folder.join("hour.npy")).unwrap();
    let fast = ["convert", "hour.npy", "hour.bvh", "--fps", "10000"];
    fails(
        folder,
        &fast,
        4,
        &["at most 1000000 frames, found 36000000"],
    );
    for unit in ["1e20", "1e-20", "0"] {
        let arguments = ["convert", "hour.npy", "hour.bvh", "--bvh-unit", unit];
        fails(folder, &arguments, 2, &["0.000001 to 1000000 metres"]);
    }
    let long = "a person walks ".repeat(1000);
    let arguments = ["generate", &long, "--out", "long.png"];
    fails(
        folder,
        &arguments,
        2,
        &["15000 characters; expected at most 2000"],
    );
}
