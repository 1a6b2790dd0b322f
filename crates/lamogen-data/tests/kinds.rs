//! Further captions of kinds of motion.

use std::collections::HashSet;
use std::path::Path;

use lamogen_data::{DataError, Dataset, PackOptions, ProblemKind, Split, pack};
use lamogen_motion::{POSE_FEATURES, npy};

/// Packs four motions, and then the result with further captions.
fn packed(folder: &Path, further: &str, seed: u64) -> Result<Dataset, DataError> {
    let source = folder.join("source");
    std::fs::create_dir_all(&source).unwrap();
    let mut lines = Vec::new();
    for (name, split, content, caption) in [
        ("kick-1", "train", "kick-left", "a kick with the left foot"),
        (
            "kick-2",
            "train",
            "kick-right",
            "a kick with the right foot",
        ),
        ("kick-3", "test", "kick-left", "the left foot kicks"),
        ("walk", "train", "walk", "an old man walks"),
    ] {
        let file = format!("{name}.features.npy");
        let rows = vec![0.1; 60 * POSE_FEATURES];
        npy::write(source.join(&file), &rows, &[60, POSE_FEATURES]).unwrap();
        lines.push(format!(
            r#"{{"file": "{file}", "captions": ["{caption}"], "split": "{split}", "content": "{content}"}}"#
        ));
    }
    std::fs::write(source.join("captions.jsonl"), lines.join("\n")).unwrap();
    std::fs::write(folder.join("further.jsonl"), further).unwrap();
    let options = PackOptions {
        captions: Some(source.join("captions.jsonl")),
        more_captions: Some(folder.join("further.jsonl")),
        seed,
        force: true,
        ..PackOptions::default()
    };
    pack(&source, folder.join("out"), &options, &mut |_| {})
}

/// Returns the captions of a motion but for its first.
fn further(data: &Dataset, name: &str) -> Vec<String> {
    let mut entries = data.entries().iter();
    let entry = entries.find(|entry| entry.name.split('.').next() == Some(name));
    let entry = entry.unwrap();
    { entry.captions[1..].iter() }
        .map(|caption| caption.text.clone())
        .collect()
}

#[test]
fn captions_of_a_kind_reach_its_motions_of_both_sides_for_training() {
    let folder = tempfile::tempdir().unwrap();
    let line = r#"{"of": {"content": ["kick-left"]}, "captions": ["his left boot hits the ball"]}"#;
    let data = packed(folder.path(), line, 0).unwrap();
    let [left, right] = ["left", "right"].map(|side| format!("his {side} boot hits the ball"));
    assert_eq!(further(&data, "kick-1"), [left.as_str()]);
    assert_eq!(further(&data, "Mkick-1"), [right.as_str()]);
    assert_eq!(further(&data, "kick-2"), [right.as_str()]);
    assert_eq!(further(&data, "Mkick-2"), [left.as_str()]);
    let others = { data.entries().iter() }.filter(|entry| !entry.name.contains("kick"));
    assert!(others.into_iter().all(|entry| entry.captions.len() == 1));
    let test: Vec<usize> = data.indices(Split::Test).collect();
    assert_eq!(data.entries()[test[0]].captions.len(), 1);
}

#[test]
fn captions_of_a_kind_are_dealt_out_so_that_all_are_used() {
    let folder = tempfile::tempdir().unwrap();
    let captions: Vec<String> = (0..90).map(|number| format!("\"kick {number}\"")).collect();
    let line = format!(
        r#"{{"of": {{"content": ["kick-left"]}}, "captions": [{}]}}"#,
        captions.join(", ")
    );
    let deal = |seed: u64| {
        let data = packed(folder.path(), &line, seed).unwrap();
        ["kick-1", "Mkick-1", "kick-2", "Mkick-2"].map(|name| further(&data, name))
    };
    let dealt = deal(0);
    // Four motions share ninety captions: 23 each.
    assert!(dealt.iter().all(|captions| captions.len() == 23));
    let used: HashSet<&String> = dealt.iter().flatten().collect();
    assert_eq!(used.len(), 90);
    assert_eq!(deal(0), dealt);
    assert_ne!(deal(1), dealt);
}

#[test]
fn a_kind_may_depend_on_the_words_of_captions_and_one_without_motions_is_listed() {
    let folder = tempfile::tempdir().unwrap();
    let lines = [
        r#"{"of": {"content": ["walk"], "words": ["old"]}, "captions": ["grandpa goes"]}"#,
        r#"{"of": {"content": ["walk"], "without": ["old"]}, "captions": ["a child goes"]}"#,
        r#"{"of": {"content": ["swim", "dive"]}, "captions": ["into the water"]}"#,
    ];
    let data = packed(folder.path(), &lines.join("\n"), 0).unwrap();
    assert_eq!(further(&data, "walk"), ["grandpa goes"]);
    let missing = { data.problems().iter() }
        .filter(|problem| problem.kind == ProblemKind::Missing)
        .map(|problem| &*problem.name);
    assert_eq!(missing.collect::<Vec<_>>(), ["walk", "swim, dive"]);

    let failed = packed(folder.path(), lines[2], 0).unwrap_err();
    assert!(failed.to_string().contains("none of these"), "{failed}");
}
