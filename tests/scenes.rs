//! What files of the command say of motions of several sentences.

mod running;

use std::fs;

use running::{fails, succeeds};
use serde_json::Value;

const SCENE: [&str; 13] = [
    "generate",
    "a person walks forward",
    "--seconds",
    "3",
    "--then",
    "a person jumps, \"high\"",
    "--seconds",
    "2",
    "--weight",
    "strong",
    "--then",
    "a person waves",
    "--part=arms:light",
];

fn number(value: &Value, path: &str) -> f64 {
    let found = value.pointer(path).and_then(Value::as_f64);
    found.unwrap_or_else(|| panic!("no number at {path}"))
}

#[test]
fn every_file_says_which_sentence_holds_when() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let out = ["csv", "json", "svg", "html", "glb"].map(|ending| format!("scene.{ending}"));
    let options = out.iter().flat_map(|name| ["--out", name]);
    let arguments: Vec<&str> = { SCENE.iter().copied() }
        .chain(["--steps", "4"])
        .chain(options)
        .collect();
    let (result, _) = succeeds(folder, &arguments);
    for line in [
        "0.00 to 3.00 s: a person walks forward",
        "3.00 to 5.00 s: a person jumps, \"high\" (Weight 1.5)",
        "5.00 to 8.00 s: a person waves (arms Weight 0.5)",
    ] {
        assert!(result.contains(line), "{line}: {result}");
    }
    // The part has goals in the last sentence alone.
    let arms = result.lines().filter(|line| *line == "arms").count();
    assert_eq!(arms, 1, "{result}");

    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    let table = read("scene.csv");
    let rows: Vec<&str> = table.lines().collect();
    assert!(rows[0].starts_with("seconds,frame,caption,baseline_weight,"));
    assert!(rows[1].starts_with("0,0,a person walks forward,"));
    assert!(rows[61].starts_with("3,60,\"a person jumps, \"\"high\"\" (Weight 1.5)\","));
    assert!(rows[101].starts_with("5,100,a person waves (arms Weight 0.5),"));

    let scene: Value = serde_json::from_str(&read("scene.json")).unwrap();
    assert_eq!(scene["sentences"][1]["goals"], "Weight 1.5");
    let (walk, jump) = (&scene["sentences"][0], &scene["sentences"][1]);
    // The values of a sentence are those of its frames.
    let values = scene.pointer("/motions/1/series/weight").unwrap();
    let values: Vec<f64> = { values.as_array().unwrap().iter() }
        .map(|value| value.as_f64().unwrap())
        .collect();
    let largest = values[60..100].iter().copied().fold(0.0, f64::max);
    assert_eq!(number(jump, "/laban/guided/weight/maximum"), largest);
    for (sentence, factor) in [(walk, 1.0), (jump, 1.5)] {
        let asked = number(sentence, "/laban/target/weight/mean");
        let alone = number(sentence, "/laban/baseline/weight/mean");
        assert!((asked / alone - factor).abs() < 1e-3, "{asked} {alone}");
    }

    // A caption for each of the two motions; the goals are those of the guided one.
    let picture = read("scene.svg");
    let captions = picture.matches("\na person waves").count();
    let with_goals = picture.matches("\na person waves (arms Weight").count();
    assert_eq!((captions, with_goals), (2, 1), "{picture}");
    let page = read("scene.html");
    let caption = r#""from":60,"text":"a person jumps, \"high\" (Weight 1.5)","until":100"#;
    assert!(page.contains(caption));
    let model = fs::read(folder.join("scene.glb")).unwrap();
    let model = String::from_utf8_lossy(&model);
    assert!(model.contains("5.00 to 8.00 s: a person waves"));
}

#[test]
fn an_error_names_its_sentence_and_no_file_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        "generate",
        "a person walks",
        "--then",
        "a person jumps",
        "--seconds",
        "1",
    ];
    fails(folder.path(), &arguments, 2, &["sentence 2", "found 1 s"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn one_sentence_needs_no_captions() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let arguments = [
        "generate",
        "a person waves",
        "--steps",
        "2",
        "--out",
        "a.csv",
        "--out",
        "a.html",
    ];
    let (result, _) = succeeds(folder, &arguments);
    assert!(!result.contains("0.00 to"), "{result}");
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    assert!(read("a.csv").starts_with("seconds,frame,weight,"));
    assert!(read("a.html").contains("\"captions\":[]"));
}
