//! The command `lamogen` as people and scripts use it.

mod model_folder;
mod running;

use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;

fn lamogen(folder: &Path, arguments: &[&str]) -> Output {
    let output = running::lamogen(folder, arguments).output();
    output.expect("the command starts")
}

fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    running::succeeds(folder, arguments).0
}

fn fails(folder: &Path, arguments: &[&str], code: i32, part: &str) {
    running::fails(folder, arguments, code, &[part]);
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

fn number(value: &Value, path: &str) -> f64 {
    let found = value.pointer(path).and_then(Value::as_f64);
    found.unwrap_or_else(|| panic!("no number at {path}"))
}

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

const JUMP: [&str; 7] = [
    "generate",
    "a person jumps",
    "--steps",
    "10",
    "--seed",
    "7",
    "--quiet",
];

#[test]
fn one_motion_is_written_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let names = [
        "jump.glb",
        "jump.bvh",
        "jump.vrma",
        "jump.npy",
        "jump.features.npy",
        "jump.csv",
        "jump.svg",
        "jump.png",
        "jump.gif",
        "jump.html",
        "jump.json",
    ];
    let mut arguments = [
        &JUMP[..],
        &["--weight", "strong", "--time", "sudden", "--json"],
    ]
    .concat();
    for name in names {
        arguments.extend(["--out", name]);
    }
    let result = json(&succeeds(folder, &arguments));
    assert_eq!(result["files"].as_array().unwrap().len(), names.len());
    assert_eq!(result["goals"], "Weight 1.5, Time 1.2");
    assert!(number(&result, "/motions/1/laban/weight/maximum") > 0.0);

    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    for (name, start) in [
        ("jump.glb", &b"glTF"[..]),
        ("jump.bvh", b"HIERARCHY"),
        ("jump.vrma", b"glTF"),
        ("jump.npy", b"\x93NUMPY"),
        ("jump.features.npy", b"\x93NUMPY"),
        ("jump.csv", b"seconds,frame,baseline_weight"),
        ("jump.svg", b"<svg"),
        ("jump.png", b"\x89PNG"),
        ("jump.gif", b"GIF89a"),
        ("jump.html", b"<!"),
        ("jump.json", b"{"),
    ] {
        assert!(read(name).starts_with(start), "{name}");
    }
    let whole = json(&String::from_utf8(read("jump.json")).unwrap());
    assert_eq!(whole["motions"][1]["joints"].as_array().unwrap().len(), 60);
    assert_eq!(
        whole["motions"][1]["series"]["flow"]
            .as_array()
            .unwrap()
            .len(),
        60
    );

    // Every file holds the same motion; features describe steps, from where HumanML3D begins.
    let apart = |name: &str, other: &str| {
        let result = succeeds(folder, &["laban", name, "--compare", other, "--json"]);
        number(&json(&result), "/compared/distance_m")
    };
    assert!(apart("jump.npy", "jump.features.npy") < 0.1);
    assert!(apart("jump.npy", "jump.glb") < 1e-5);
    assert!(apart("jump.npy", "jump.bvh") < 1e-5);
    // What turns in a file is its own, which is what was generated; of arrays it is what would be written.
    let turning = |name: &str| {
        let measured = json(&succeeds(folder, &["laban", name, "--json"]));
        measured["motions"][0]["turning"].clone()
    };
    let generated = &result["motions"][1]["turning"];
    assert_eq!(generated["rotations"], "rig");
    assert_eq!(turning("jump.npy")["rotations"], "solved");
    for (name, rotations) in [("jump.bvh", "file"), ("jump.glb", "file")] {
        let found = turning(name);
        assert_eq!(found["rotations"], rotations, "{name}");
        for path in [
            "/mean_deg",
            "/largest_deg",
            "/seconds",
            "/pelvis/mean_deg",
            "/pelvis/largest_deg",
            "/joints/spine3/largest_deg",
            "/joints/left_shoulder/mean_deg",
        ] {
            let (found, expected) = (number(&found, path), number(generated, path));
            assert!((found - expected).abs() < 1e-2, "{name}{path}: {found}");
        }
        assert_eq!(found["joint"], generated["joint"], "{name}");
    }
    assert_eq!(generated["joints"].as_object().unwrap().len(), 22);
    assert!(number(generated, "/pelvis/mean_deg") > 0.1);
    let line = succeeds(folder, &["laban", "jump.bvh"]);
    let expected = format!("; largest {:.0}° (", number(generated, "/largest_deg"));
    assert!(line.contains(&expected), "{line}");
    let compared = succeeds(folder, &["laban", "jump.bvh", "--compare", "jump.glb"]);
    assert!(compared.contains("compared with jump.glb"), "{compared}");
    for name in ["again.bvh", "again.npy", "again.csv", "again.html"] {
        succeeds(folder, &["convert", "jump.glb", name, "--quiet"]);
    }
    let page = succeeds(
        folder,
        &[
            "play",
            "jump.glb",
            "jump.bvh",
            "--no-open",
            "--out",
            "play.html",
        ],
    );
    assert_eq!(page.trim(), "play.html");
    assert!(read("play.html").starts_with(b"<!"));
}

#[test]
fn samples_are_named_by_seed_and_baselines_are_the_text_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let arguments = [
        &JUMP[..],
        &["--samples", "2", "--baseline-only", "--out", "a.npy"],
    ]
    .concat();
    let text = succeeds(folder, &arguments);
    assert_eq!(files(folder), ["a-7.npy", "a-8.npy"]);
    assert!(
        text.contains("a-8.npy") && text.contains("peaks at"),
        "{text}"
    );

    succeeds(
        folder,
        &[&JUMP[..], &["--scale", "1.5,1,1,1", "--out", "b.json"]].concat(),
    );
    let whole = json(&std::fs::read_to_string(folder.join("b.json")).unwrap());
    assert_eq!(whole["motions"].as_array().unwrap().len(), 2);
    // A seed is a motion, whatever runs beside it.
    succeeds(folder, &[&JUMP[..], &["--out", "c.npy"]].concat());
    let apart = succeeds(
        folder,
        &["laban", "a-7.npy", "--compare", "c.npy", "--json"],
    );
    assert!(number(&json(&apart), "/compared/distance_m") == 0.0);
}

#[test]
fn what_goes_wrong_has_a_code_a_reason_and_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let with = |more: &'static [&'static str]| [&JUMP[..], more].concat();
    fails(
        folder,
        &with(&["--out", "a.fbx"]),
        2,
        "expected a name that ends in .glb, .bvh",
    );
    fails(
        folder,
        &with(&["--weight", "sudden"]),
        2,
        "sudden speaks of Time",
    );
    fails(
        folder,
        &with(&["--seconds", "1", "--out", "a.npy"]),
        2,
        "40 to 72000 frames",
    );
    fails(
        folder,
        &with(&["--weight", "9:2", "--out", "a.npy"]),
        2,
        "9 s",
    );
    fails(
        folder,
        &with(&["--temporal-smoothing", "0"]),
        2,
        "0.01 to 100 frames, found 0",
    );
    fails(
        folder,
        &with(&["--temporal-smoothing", "much"]),
        2,
        "a number of frames such as 1, or off, found much",
    );
    fails(
        folder,
        &with(&["--device", "abacus"]),
        2,
        "no device is named `abacus`",
    );
    fails(
        folder,
        &with(&["--model", "nowhere", "--out", "a.npy"]),
        3,
        "hint: `lamogen help model-folder`",
    );
    fails(
        folder,
        &with(&["--out", "no/such/a.npy"]),
        4,
        "hint: mkdir -p no/such",
    );
    fails(
        folder,
        &with(&["--out", "a.npy", "--out", "a.npy"]),
        2,
        "given twice",
    );
    fails(
        folder,
        &["generate", " ", "--out", "a.npy"],
        2,
        "the prompt is empty",
    );
    fails(folder, &["laban", "nothing.bvh"], 3, "nothing.bvh");
    std::fs::write(folder.join("bad.bvh"), "HIERARCHY\nROOT a {").unwrap();
    fails(folder, &["convert", "bad.bvh", "a.glb"], 3, "bad.bvh");
    fails(folder, &["convert", "bad.bvh", "a.txt"], 2, ".glb");
    fails(
        folder,
        &["model", "convert", "bad.bvh", "a.tar"],
        2,
        ".safetensors",
    );
    assert_eq!(files(folder), ["bad.bvh"]);
}

#[test]
fn the_model_and_the_devices_say_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let info = json(&succeeds(
        folder.path(),
        &["model", "info", "--json", "--quiet"],
    ));
    assert_eq!(info["licence"]["non_commercial"], false);
    assert_eq!(info["frames"], serde_json::json!([40, 196]));
    let devices = json(&succeeds(folder.path(), &["devices", "--json"]));
    assert!(
        devices["devices"]
            .as_array()
            .unwrap()
            .contains(&"flex".into())
    );
    // Non-commercial weights say so, once, on stderr; the embedded ones are none.
    let other = folder.path().join("other");
    std::fs::create_dir(&other).unwrap();
    model_folder::write(&other);
    let relicense =
        "model convert other/model.safetensors mine.safetensors --license CC-BY-NC-4.0 --force";
    succeeds(folder.path(), &relicense.split(' ').collect::<Vec<_>>());
    std::fs::rename(
        folder.path().join("mine.safetensors"),
        other.join("model.safetensors"),
    )
    .unwrap();
    for (model, times) in [(&[][..], 0), (&["--model", "other"], 1)] {
        let jump = [
            "generate",
            "a person jumps",
            "--steps",
            "2",
            "--out",
            "a.npy",
        ];
        let output = lamogen(folder.path(), &[&jump[..], model].concat());
        let notices = String::from_utf8(output.stderr).unwrap();
        let found = notices.matches("not for commercial use").count();
        assert_eq!(found, times, "{notices}");
    }
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        assert!(succeeds(folder.path(), &["completions", shell]).contains("baseline-only"));
    }
    for (topic, part) in [
        (&["model-folder"][..], "mean.npy"),
        (&["data"], "captions.jsonl"),
        (&["recipe"], "\"text_dropout\""),
        (&["sentences"], "sentences.npy"),
        (&["model", "convert"], "--half"),
        (&[], "generate"),
    ] {
        let arguments = [&["help"], topic].concat();
        assert!(
            succeeds(folder.path(), &arguments).contains(part),
            "{topic:?}"
        );
    }
    fails(
        folder.path(),
        &["help", "cooking"],
        2,
        "one of the topics model-folder, data",
    );
    assert!(succeeds(folder.path(), &["man"]).contains(".TH lamogen"));
    succeeds(folder.path(), &["man", "--out", "man"]);
    assert!(files(&folder.path().join("man")).contains(&"lamogen-generate.1".to_owned()));
}

fn requests(folder: &Path, lines: &[&str]) -> PathBuf {
    let path = folder.join("requests.jsonl");
    std::fs::write(&path, lines.join("\n")).unwrap();
    path
}

const LINES: [&str; 5] = [
    r#"{"prompt": "a person jumps", "id": "jump", "weight": "strong", "seconds": 2}"#,
    r#"{"prompt": "a person walks", "seconds": 2.5, "seed": 3}"#,
    "",
    r#"{"prompt": "a person waves", "id": "wave", "shape": 1.5, "seconds": 2}"#,
    r#"{"prompt": "a person runs", "id": "run", "scale": [0.5, 1, 1, 1], "seconds": 2}"#,
];

const BATCH: [&str; 9] = [
    "batch",
    "requests.jsonl",
    "--out",
    "out",
    "--steps",
    "4",
    "--format",
    "npy,bvh",
    "--json",
];

#[test]
fn a_batch_goes_on_where_it_was_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    requests(folder, &LINES);
    let made = |result: &Value| [number(result, "/made"), number(result, "/finished_before")];
    assert_eq!(made(&json(&succeeds(folder, &BATCH))), [4.0, 0.0]);
    let out = folder.join("out");
    assert_eq!(files(&out).len(), 4 * 3);
    let time = |name: &str| out.join(name).metadata().unwrap().modified().unwrap();
    let before = ["jump.npy", "wave.npy", "run.json"].map(time);

    // Killed between two motions, and while a record was being written.
    std::fs::remove_file(out.join("line-00002.json")).unwrap();
    std::fs::write(out.join("jump.json"), "{\"batch\": {\"requ").unwrap();
    assert_eq!(made(&json(&succeeds(folder, &BATCH))), [2.0, 2.0]);
    assert!(time("jump.npy") > before[0]);
    assert_eq!([time("wave.npy"), time("run.json")], before[1..]);
    assert_eq!(made(&json(&succeeds(folder, &BATCH))), [0.0, 4.0]);

    // Another request under the same name is made again, as are all with other options.
    let mut lines = LINES;
    lines[3] = r#"{"prompt": "a person waves", "id": "wave", "shape": 0.5, "seconds": 2}"#;
    requests(folder, &lines);
    assert_eq!(made(&json(&succeeds(folder, &BATCH))), [1.0, 3.0]);
    let slower: Vec<&str> = BATCH
        .iter()
        .map(|&word| if word == "4" { "5" } else { word })
        .collect();
    assert_eq!(made(&json(&succeeds(folder, &slower))), [4.0, 0.0]);
    let smoother = [&slower[..], &["--temporal-smoothing", "1.5"]].concat();
    assert_eq!(made(&json(&succeeds(folder, &smoother))), [4.0, 0.0]);
    assert_eq!(made(&json(&succeeds(folder, &smoother))), [0.0, 4.0]);
}

#[test]
fn a_batch_of_blank_lines_is_said_to_hold_no_request() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    requests(folder, &["", "  "]);
    let (result, notices) = running::succeeds(folder, &BATCH);
    assert_eq!(number(&json(&result), "/made"), 0.0);
    assert!(
        notices.contains("requests.jsonl: expected requests"),
        "{notices}"
    );
}

#[test]
fn shards_share_a_batch_without_a_gap() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    requests(folder, &LINES);
    let mut made = 0.0;
    for shard in ["1/3", "2/3", "3/3"] {
        let arguments = [&BATCH[..], &["--shard", shard, "--batch-size", "2"]].concat();
        let result = json(&succeeds(folder, &arguments));
        assert_eq!(number(&result, "/finished_before"), 0.0);
        made += number(&result, "/made");
    }
    assert_eq!(made, 4.0);
    assert_eq!(
        number(&json(&succeeds(folder, &BATCH)), "/finished_before"),
        4.0
    );
}

#[test]
fn a_merge_names_what_a_batch_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    requests(folder, &LINES);
    let merge = [&BATCH[..], &["--merge"]].concat();
    fails(folder, &merge, 3, "expected the folder of a batch");
    succeeds(folder, &[&BATCH[..], &["--shard", "1/2"]].concat());
    let (result, message) = running::ends(folder, &merge, 5);
    assert_eq!(number(&json(&result), "/finished"), 2.0);
    assert_eq!(json(&result)["missing"].as_array().unwrap().len(), 2);
    assert!(
        message.contains("line 2, line-00002: line-00002.json is not there")
            && message.contains("without --merge makes what is missing"),
        "{message}"
    );
    succeeds(folder, &BATCH);
    let out = folder.join("out");
    let before = files(&out);
    assert_eq!(number(&json(&succeeds(folder, &merge)), "/finished"), 4.0);
    assert_eq!(files(&out), before);

    // A file that is lost, and the record of a run with other options.
    std::fs::remove_file(out.join("jump.bvh")).unwrap();
    let (_, message) = running::ends(folder, &merge, 5);
    assert!(message.contains("jump.bvh is not there"), "{message}");
    let slower = [&merge[..], &["--emphasis", "2"]].concat();
    let (_, message) = running::ends(folder, &slower, 5);
    assert!(message.contains("other emphasis"), "{message}");
    fails(
        folder,
        &[&merge[..], &["--shard", "1/2"]].concat(),
        2,
        "--shard",
    );
}

#[test]
fn wrong_lines_are_named_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    requests(
        folder,
        &[
            LINES[0],
            "{\"prompt\": 3}",
            "{\"prompt\": \"a\", \"sed\": 1}",
        ],
    );
    fails(
        folder,
        &BATCH,
        2,
        "requests.jsonl, line 3: unknown field `sed`",
    );
    requests(
        folder,
        &[LINES[0], "{\"prompt\": \"a person sits\", \"seconds\": 1}"],
    );
    fails(
        folder,
        &BATCH,
        2,
        "requests.jsonl, line 2: expected 40 to 72000 frames",
    );
    assert!(!folder.join("out/jump.json").exists());
    fails(
        folder,
        &["batch", "none.jsonl", "--out", "out"],
        3,
        "none.jsonl",
    );
}

#[test]
fn a_licence_is_not_replaced_by_accident_and_damage_is_the_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("own.safetensors"), lamogen_compact::WEIGHTS).unwrap();
    let convert = [
        "model",
        "convert",
        "own.safetensors",
        "new.safetensors",
        "--license",
        "MIT",
    ];
    fails(folder, &convert, 2, "states \"CC-BY");
    assert!(!folder.join("new.safetensors").exists());
    succeeds(folder, &[&convert[..], &["--force"]].concat());
    let metadata = |name: &str| {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
        header["__metadata__"]["license"].clone()
    };
    assert_eq!(metadata("new.safetensors"), "MIT");
    // A file without a tensor, one that ends too early, and one that is something else.
    let header = b"{\"__metadata__\":{\"a\":\"b\"}}";
    let empty = [&(header.len() as u64).to_le_bytes()[..], header].concat();
    for (bytes, part) in [
        (&empty[..], "expected tensors"),
        (&lamogen_compact::WEIGHTS[..5_000_000], "safetensors"),
        (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
    ] {
        std::fs::write(folder.join("bad.safetensors"), bytes).unwrap();
        let convert = ["model", "convert", "bad.safetensors", "out.safetensors"];
        fails(folder, &convert, 3, part);
        assert!(!folder.join("out.safetensors").exists());
    }
}

#[test]
fn what_is_strange_or_unused_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let walk = [
        "generate",
        "a person walks forward",
        "--steps",
        "4",
        "--out",
        "walk.npy",
    ];
    let (_, notices) = running::succeeds(
        folder,
        &[&walk[..], &["--bvh-unit", "m", "--emphasis", "3"]].concat(),
    );
    for part in [
        "--bvh-unit changes nothing here: it is for .bvh",
        "--emphasis changes nothing here",
    ] {
        assert!(notices.contains(part), "{notices}");
    }
    let array = lamogen::motion::npy::read(folder.join("walk.npy")).unwrap();
    let mut values = array.values.clone();
    for point in values.chunks_exact_mut(3) {
        (point[1], point[2]) = (-point[1], -point[2]);
    }
    lamogen::motion::npy::write(folder.join("down.npy"), &values, &array.shape).unwrap();
    let (_, notices) = running::succeeds(folder, &["convert", "down.npy", "as-it-is.npy"]);
    assert!(
        notices.contains("down.npy: the body stands on its head"),
        "{notices}"
    );
    let (_, notices) =
        running::succeeds(folder, &["convert", "down.npy", "turned.npy", "--up", "-y"]);
    assert!(!notices.contains("stands on its head"), "{notices}");
    let turned = lamogen::motion::npy::read(folder.join("turned.npy")).unwrap();
    assert_eq!(turned.values, array.values);
    // Half as many frames a second last twice as long.
    let slow = json(&succeeds(
        folder,
        &[
            "convert",
            "walk.npy",
            "slow.npy",
            "--input-fps",
            "10",
            "--json",
        ],
    ));
    assert_eq!(number(&slow, "/frames"), 119.0);
}

#[test]
fn places_are_reported_and_bad_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let places = [
        "--path",
        "0:0,0 3:0.5,2",
        "--reach",
        "left-hand@1.5=0.5,1.5,1",
    ];
    fn walk_with<'a>(arguments: &[&'a str]) -> Vec<&'a str> {
        let walk = ["generate", "a person walks forward", "--steps", "5"];
        [&walk[..], arguments].concat()
    }
    let arguments = walk_with(&[&places[..], &["--out", "walk.json"]].concat());
    let (table, notices) = running::succeeds(folder, &arguments);
    for part in ["pelvis at 3 s", "left-hand at 1.5 s", " cm"] {
        assert!(table.contains(part), "{table}");
    }
    assert!(!notices.contains("m/s"), "{notices}");
    let record = json(&std::fs::read_to_string(folder.join("walk.json")).unwrap());
    assert_eq!(record["places"].as_array().unwrap().len(), 3);
    assert!(number(&record, "/places/1/off_m") < 0.02);
    // Nothing is asked of the components, so there is no target.
    assert!(record["target"].is_null());
    assert_eq!(
        record["places"][1]["asked_m"],
        serde_json::json!([0.5, null, 2.0])
    );
    // What is fast is said, and made.
    let fast = walk_with(&["--path", "1:0,4", "--out", "fast.npy"]);
    let (_, notices) = running::succeeds(folder, &fast);
    assert!(notices.contains("4.0 m/s from 0 s to 1 s"), "{notices}");
    let high = walk_with(&["--reach", "right-hand@1=0,100,0", "--out", "high.npy"]);
    let (_, notices) = running::succeeds(folder, &high);
    assert!(notices.contains("100 m above the floor"), "{notices}");
    // Files that show no body are named.
    let point = lamogen::Motion::from_joints(vec![[[0.0; 3]; 22]; 40]).unwrap();
    point.save_joints(folder.join("point.npy")).unwrap();
    for option in [
        ["--after", "point.npy"],
        ["--before", "point.npy"],
        ["--pose", "1=point.npy"],
    ] {
        let arguments = walk_with(&[&option[..], &["--out", "no.npy"]].concat());
        fails(
            folder,
            &arguments,
            3,
            "point.npy: expected a body with legs",
        );
        assert!(!folder.join("no.npy").exists());
    }
    for (wrong, part) in [
        (&["--path", ""][..], "found nothing"),
        (&["--path", "1:0,1 1:0,2"], "found 1 s after 1 s"),
        (&["--path", "1:0,nan"], "found NaN"),
        (&["--path", "1:0"], "found \"1:0\""),
        (&["--path", "5:0,1"], "found 5 s"),
        (
            &["--reach", "tail@1=0,1,0"],
            "left-hand, right-hand, left-foot",
        ),
        (&["--reach", "head=0,1,0"], "part@seconds=x,y,z"),
        (&["--path", "1:0,1", "--face", "north"], "found \"north\""),
        (&["--face", "90"], "--path"),
        (&["--path", "1:0,1", "--loop"], "a path or a loop"),
        (
            &["--path", "1:0,1", "--baseline-only"],
            "cannot be used with",
        ),
        (
            &["--pose", "1=sit.npy", "--baseline-only"],
            "cannot be used with",
        ),
        (
            &[
                "--baseline-only",
                "--then",
                "a person jumps",
                "--weight",
                "strong",
            ],
            "cannot be used with the words of a sentence after '--then'",
        ),
    ] {
        fails(
            folder,
            &walk_with(&[wrong, &["--out", "no.npy"]].concat()),
            2,
            part,
        );
        assert!(!folder.join("no.npy").exists());
    }
    // The lines of a batch say the same.
    let line = r#"{"prompt": "a person walks forward", "id": "walk", "path": "3:0.5,2", "face": 0, "reach": ["head@1=0,1.5,0.7"], "steps": 5}"#;
    requests(folder, &[line]);
    succeeds(
        folder,
        &[
            "batch",
            "requests.jsonl",
            "--out",
            "places",
            "--format",
            "npy",
        ],
    );
    let record = json(&std::fs::read_to_string(folder.join("places/walk.json")).unwrap());
    assert_eq!(record["places"].as_array().unwrap().len(), 2);
    assert!(number(&record, "/places/0/off_m") < 0.02);
    for (field, part) in [
        (r#""path": "1""#, "path: expected a place"),
        (
            r#""reach": ["tail@1=0,1,0"]"#,
            "reach: expected one of left-hand",
        ),
        (r#""face": 90"#, "expected a path beside face"),
        (r#""path": "1:0,1", "face": 1000"#, "found \"1000\""),
        (r#""path": "9:0,1""#, "found 9 s"),
    ] {
        let line = format!(r#"{{"prompt": "a person walks", "steps": 2, {field}}}"#);
        requests(folder, &[&line]);
        fails(
            folder,
            &["batch", "requests.jsonl", "--out", "wrong"],
            2,
            part,
        );
    }
}

#[test]
fn motions_are_put_on_a_character_whose_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // A rig that lamogen wrote is a character, too.
    succeeds(folder, &[&JUMP[..], &["--out", "hero.glb"]].concat());
    let animations = |name: &str| {
        let file = gltf_json(&std::fs::read(folder.join(name)).unwrap());
        let animations = file["animations"].as_array().unwrap();
        let names = animations
            .iter()
            .map(|animation| animation["name"].as_str().unwrap().to_owned());
        names.collect::<Vec<_>>()
    };
    let onto = [
        "--onto",
        "hero.glb",
        "--weight",
        "strong",
        "--out",
        "hero_jump.glb",
        "--out",
        "jump.bvh",
    ];
    succeeds(folder, &[&JUMP[..], &onto].concat());
    assert_eq!(
        animations("hero_jump.glb"),
        ["a person jumps", "a person jumps"]
    );
    let convert = [
        "convert",
        "jump.bvh",
        "--onto",
        "hero.glb",
        "--replace-animations",
        "hero.vrm",
    ];
    succeeds(folder, &convert);
    assert_eq!(animations("hero.vrm"), ["jump"]);
    // What is read back is the motion: the same features, although the body stands at its own height.
    let laban = |name: &str| json(&succeeds(folder, &["laban", name, "--json", "--quiet"]));
    let [before, after] = ["jump.bvh", "hero.vrm"].map(laban);
    for component in ["weight", "time", "flow", "shape"] {
        let find = |value: &Value| number(value, &format!("/motions/0/laban/{component}/mean"));
        let [before, after] = [find(&before), find(&after)];
        assert!(
            (after / before - 1.0).abs() < 0.05,
            "{component}: {before}, {after}"
        );
    }
    let jobs = requests(
        folder,
        &["{\"prompt\": \"a person walks\", \"id\": \"w\", \"steps\": 4}"],
    );
    let jobs = jobs.to_str().unwrap();
    let batch = [
        "batch", jobs, "--out", "motions", "--format", "vrm", "--onto", "hero.glb", "--quiet",
    ];
    succeeds(folder, &batch);
    assert_eq!(files(&folder.join("motions")), ["w.json", "w.vrm"]);
    assert!(succeeds(folder, &batch[..8]).contains("1 finished before"));
    // Another character is another motion.
    std::fs::copy(folder.join("hero_jump.glb"), folder.join("hero.glb")).unwrap();
    assert!(succeeds(folder, &batch[..8]).contains("1 made"));
    for (arguments, code, part) in [
        (
            &["convert", "jump.bvh", "a.vrm"][..],
            2,
            "--onto names its file",
        ),
        (
            &["convert", "jump.bvh", "--onto", "none.glb", "a.glb"],
            3,
            "none.glb",
        ),
        (
            &["convert", "jump.bvh", "--onto", "jump.bvh", "a.glb"],
            2,
            "ends in .bvh for the character jump.bvh",
        ),
        (
            &["convert", "jump.bvh", "--onto", "hero.glb", "a.gltf"],
            2,
            ".glb or .vrm",
        ),
        (
            &["convert", "jump.bvh", "--animation-name", "x", "a.glb"],
            2,
            "--onto",
        ),
        (
            &[
                "convert",
                "jump.bvh",
                "--onto",
                "hero.glb",
                "--character",
                "x",
                "a.glb",
            ],
            2,
            "named \"x\"",
        ),
    ] {
        fails(folder, arguments, code, part);
        assert!(
            !files(folder).iter().any(|name| name.starts_with("a.")),
            "{arguments:?}"
        );
    }
}

#[test]
fn vrm_animations_are_written_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let out = ["--out", "jump.vrma", "--out", "jump.npy"];
    succeeds(folder, &[&JUMP[..], &out].concat());
    let file = gltf_json(&std::fs::read(folder.join("jump.vrma")).unwrap());
    assert_eq!(
        file["extensionsUsed"],
        serde_json::json!(["VRMC_vrm_animation"])
    );
    assert_eq!(file["animations"][0]["name"], "a person jumps");
    assert_eq!(file["nodes"][0]["extras"]["prompt"], "a person jumps");
    assert!(file["asset"]["copyright"].as_str().unwrap().contains("CC"));
    // Keyframes are at 30 a second, unless --fps says otherwise.
    let rate = |name: &str| {
        let laban = json(&succeeds(folder, &["laban", name, "--json", "--quiet"]));
        number(&laban, "/source_frames_per_second")
    };
    assert_eq!(rate("jump.vrma"), 30.0);
    let fps = ["convert", "jump.vrma", "fast.vrma", "--fps", "60"];
    succeeds(folder, &fps);
    assert_eq!(rate("fast.vrma"), 60.0);
    let jobs = requests(
        folder,
        &["{\"prompt\": \"a person walks\", \"id\": \"w\", \"steps\": 4}"],
    );
    let jobs = jobs.to_str().unwrap();
    let batch = ["batch", jobs, "--out", "motions", "--format", "vrma"];
    succeeds(folder, &batch);
    assert_eq!(files(&folder.join("motions")), ["w.json", "w.vrma"]);
    // A character is not needed. Beside a file that is a character, the animation is the same as without it.
    succeeds(folder, &["convert", "jump.npy", "hero.glb"]);
    let onto = ["convert", "jump.npy", "a.vrma", "--onto", "hero.glb"];
    fails(folder, &onto, 2, "plays on every VRM character");
    assert!(!folder.join("a.vrma").exists());
    let both = ["--onto", "hero.glb", "--out", "b.glb", "--out", "b.vrma"];
    succeeds(folder, &[&JUMP[..], &both].concat());
    let bytes = |name: &str| std::fs::read(folder.join(name)).unwrap();
    assert_eq!(bytes("b.vrma"), bytes("jump.vrma"));
    // A GLB that is none is refused under this name.
    std::fs::copy(folder.join("hero.glb"), folder.join("no.vrma")).unwrap();
    fails(folder, &["laban", "no.vrma"], 3, "VRMC_vrm_animation");
}

/// Returns the JSON of a GLB file.
fn gltf_json(bytes: &[u8]) -> Value {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

#[test]
fn loops_and_their_travel_are_written_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let walk = [
        "generate",
        "a person walks forward",
        "--loop",
        "--steps",
        "6",
        "--seconds",
        "3",
    ];
    let outputs = [
        "--out", "w.glb", "--out", "w.bvh", "--out", "w.npy", "--out", "w.json", "--fps", "30",
    ];
    running::succeeds(folder, &[&walk[..], &outputs].concat());
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("w.json")).unwrap()).unwrap();
    assert_eq!(json["loop"], true);
    let travel = json["loop_travel"][1].as_f64().unwrap();
    assert!(travel > 0.5, "{travel}");
    // Ninety frames, and in the GLB the one that closes the loop.
    let shape = |name: &str| lamogen::motion::npy::read(folder.join(name)).unwrap().shape;
    assert_eq!(shape("w.npy"), [90, 22, 3]);
    let bvh = std::fs::read_to_string(folder.join("w.bvh")).unwrap();
    assert!(bvh.contains("Frames: 90\n"));
    let read = |name: &str| {
        let options = lamogen::files::ReadOptions::default();
        lamogen::files::read(folder.join(name), &options).unwrap()
    };
    assert_eq!(read("w.glb").source_frames, 91);
    let pelvis =
        |name: &str, frame: usize| read(name).motion.position(frame, lamogen::Joint::Pelvis);
    let last = read("w.glb").motion.frames() - 1;
    let travelled = pelvis("w.glb", last)[2] - pelvis("w.glb", 0)[2];
    assert!(
        (f64::from(travelled) - travel).abs() < 0.01,
        "{travelled} {travel}"
    );

    let outputs = [
        "--out",
        "p.glb",
        "--out",
        "p.bvh",
        "--out",
        "p.npy",
        "--out",
        "p.vrma",
        "--in-place",
    ];
    running::succeeds(folder, &[&walk[..], &outputs].concat());
    for name in ["p.glb", "p.bvh", "p.npy", "p.vrma"] {
        let motion = read(name).motion;
        for frame in 0..motion.frames() {
            let [x, _, z] = motion.position(frame, lamogen::Joint::Pelvis);
            assert!(x.hypot(z) < 0.2, "{name}: {x} {z} at {frame}");
        }
    }
    let text = String::from_utf8_lossy(&std::fs::read(folder.join("p.glb")).unwrap()).into_owned();
    assert!(text.contains("planted feet slide"));

    let outputs = ["--out", "r.glb", "--out", "r.bvh", "--root-motion", "root"];
    running::succeeds(folder, &[&walk[..], &outputs].concat());
    for name in ["r.glb", "r.bvh"] {
        let motion = read(name).motion;
        let last = motion.frames() - 1;
        let moved = pelvis(name, last)[2] - pelvis(name, 0)[2];
        assert!(moved > 0.5, "{name}: {moved}");
    }
    let bvh = std::fs::read_to_string(folder.join("r.bvh")).unwrap();
    assert!(bvh.starts_with("HIERARCHY\nROOT root\n"));

    let requests = "{\"prompt\": \"a person walks forward\", \"loop\": true, \"in_place\": true, \"id\": \"w\", \"seconds\": 3}\n";
    std::fs::write(folder.join("requests.jsonl"), requests).unwrap();
    let batch = [
        "batch",
        "requests.jsonl",
        "--out",
        "many",
        "--format",
        "bvh",
    ];
    running::succeeds(folder, &[&batch[..], &["--steps", "6"]].concat());
    let same = std::fs::read_to_string(folder.join("many/w.bvh")).unwrap();
    assert!(same == std::fs::read_to_string(folder.join("p.bvh")).unwrap());

    for (arguments, part) in [
        (
            &["--in-place", "--root-motion", "root"][..],
            "cannot be used with",
        ),
        (
            &["--root-motion", "root", "--out", "a.vrma"],
            "no root above the hips",
        ),
        (&["--seconds", "9.8"], "2.0 to 9.3 s"),
        (&["--root-motion", "feet"], "possible values"),
    ] {
        let walk = ["generate", "a person walks forward", "--loop"];
        fails(folder, &[&walk[..], arguments].concat(), 2, part);
    }
    let requests = "{\"prompt\": \"a\", \"in_place\": true, \"root_motion\": \"root\"}\n";
    std::fs::write(folder.join("requests.jsonl"), requests).unwrap();
    fails(folder, &batch, 2, "found both");
}
