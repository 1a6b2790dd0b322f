//! Motions that are put together from recorded ones.

use std::path::Path;

use lamogen_data::{DataError, Dataset, Entry, PackOptions, pack};
use lamogen_motion::{
    FRAMES_PER_SECOND, JOINTS, Joint, Motion, POSE_FEATURES, Placement, RestPose, Rotations,
    encode_canonical, npy,
};

/// Writes the rows of a body that goes ahead, `speed` metres a frame, and lifts its left arm by up to `lift` radians.
fn clip(folder: &Path, name: &str, frames: usize, speed: f32, lift: f32) {
    let rest = RestPose::humanml3d();
    let root = (0..=frames).map(|frame| [0.0, 0.9, speed * frame as f32]);
    let local = (0..=frames).map(|frame| {
        let mut pose = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
        let half = 0.5 * lift * frame as f32 / frames as f32;
        pose[Joint::LeftShoulder.index()] = [0.0, 0.0, half.sin(), half.cos()];
        pose
    });
    let rotations = Rotations::new(rest, root.collect(), local.collect(), FRAMES_PER_SECOND);
    let rows = encode_canonical(&rotations.joints());
    let shape = [rows.len(), POSE_FEATURES];
    let path = folder.join(format!("{name}.features.npy"));
    npy::write(path, rows.as_flattened(), &shape).unwrap();
}

/// Packs a walk, a stand and a lifted arm with a recipe of compositions.
fn packed(folder: &Path, recipe: &str, seed: u64) -> Result<Dataset, DataError> {
    let source = folder.join("source");
    std::fs::create_dir_all(&source).unwrap();
    clip(&source, "walk", 100, 0.05, 0.0);
    clip(&source, "stand", 60, 0.0, 0.0);
    clip(&source, "lift", 60, 0.0, 1.0);
    let lines = [
        r#"{"file": "walk.features.npy", "captions": ["a person walks forward"], "split": "train", "content": "walk"}"#,
        r#"{"file": "stand.features.npy", "captions": ["someone stands still"], "split": "train", "content": "stand"}"#,
        r#"{"file": "lift.features.npy", "captions": ["somebody lifts the left arm", "the left arm goes up"], "split": "train", "content": "lift"}"#,
    ];
    std::fs::write(source.join("captions.jsonl"), lines.join("\n")).unwrap();
    std::fs::write(folder.join("recipe.json"), recipe).unwrap();
    let options = PackOptions {
        captions: Some(source.join("captions.jsonl")),
        compositions: Some(folder.join("recipe.json")),
        seed,
        force: true,
        ..PackOptions::default()
    };
    pack(&source, folder.join("out"), &options, &mut |_| {})
}

/// A recipe of one composition.
fn recipe(parts: &str, captions: &str) -> String {
    format!(
        r#"{{"compositions": [{{"content": "new", "count": 1, "parts": [{parts}], "captions": [{captions}]}}]}}"#
    )
}

/// Returns the entry and the motion that a recipe of one composition makes.
fn composed(parts: &str, captions: &str) -> (Entry, Motion) {
    let folder = tempfile::tempdir().unwrap();
    let data = packed(folder.path(), &recipe(parts, captions), 0).unwrap();
    let entry = find(&data, "new+1").clone();
    let motion = data.motion(&entry).unwrap();
    (entry, motion)
}

fn find<'a>(data: &'a Dataset, name: &str) -> &'a Entry {
    let mut entries = data.entries().iter();
    entries.find(|entry| entry.name == name).unwrap()
}

/// Returns the sum of the turns from frame to frame in degrees, positive to the left.
fn turn(motion: &Motion) -> f64 {
    let headings: Vec<f64> = { motion.joints().iter() }
        .map(|pose| Placement::of(pose).heading())
        .collect();
    let turns = headings.windows(2).map(|pair| {
        let turn = pair[1] - pair[0];
        turn.sin().atan2(turn.cos())
    });
    turns.sum::<f64>().to_degrees()
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f32>().sqrt()
}

#[test]
fn a_path_is_bent_to_a_circle() {
    let part = r#"{"of": {"content": ["walk"]}, "turn": [360, 360]}"#;
    let (_, motion) = composed(part, r#""a person walks in a circle to the left""#);
    assert!((turn(&motion) - 360.0).abs() < 3.0, "{}", turn(&motion));
    let joints = motion.joints();
    let ends = distance(joints[0][0], joints[joints.len() - 1][0]);
    assert!(ends < 0.2, "{ends}");
    // A circle with a circumference of 5 m is 1.6 m wide.
    let widest = joints
        .iter()
        .map(|pose| distance(pose[0], joints[0][0]))
        .fold(0.0, f32::max);
    assert!((widest - 1.59).abs() < 0.1, "{widest}");
}

#[test]
fn a_part_is_reversed_slowed_cut_and_kept_in_its_place() {
    let lift = |change: &str| {
        let part = format!(r#"{{"of": {{"content": ["lift"]}}{change}}}"#);
        composed(&part, r#""the arm""#).1
    };
    let hand = |motion: &Motion, frame: usize| motion.position(frame, Joint::LeftWrist)[1];
    let recorded = lift("");
    let last = recorded.frames() - 1;
    assert!(hand(&recorded, last) > hand(&recorded, 0) + 0.3);
    let reversed = lift(r#", "reversed": true"#);
    for frame in [0, 20, last] {
        let difference = hand(&reversed, frame) - hand(&recorded, last - frame);
        assert!(difference.abs() < 0.02, "{frame}: {difference}");
    }
    let slow = lift(r#", "speed": [0.5, 0.5]"#);
    assert!(slow.frames().abs_diff(2 * recorded.frames()) <= 2);
    assert!((hand(&slow, 80) - hand(&recorded, 40)).abs() < 0.02);
    let cut = lift(r#", "span": [0.25, 1.0]"#);
    assert!(cut.frames().abs_diff(45) <= 1, "{}", cut.frames());
    assert!((hand(&cut, 20) - hand(&recorded, 35)).abs() < 0.02);

    let part = r#"{"of": {"content": ["walk"]}, "in_place": true}"#;
    let (_, motion) = composed(part, r#""a person walks in place""#);
    let joints = motion.joints();
    // Nothing is left of the 0.05 m that the walk covers a frame, at the ends neither.
    for pose in joints {
        assert!(distance(pose[0], joints[0][0]) < 0.02, "{:?}", pose[0]);
    }
}

#[test]
fn parts_go_on_from_one_another() {
    let parts = r#"{"of": {"content": ["walk"]}, "turn": [90, 90]}, {"of": {"content": ["lift"]}}"#;
    let (entry, motion) = composed(parts, r#""a person {0}, then {1}", "first {1}""#);
    // Ten frames may be cut off on each side, and eight overlap.
    assert!((130..=152).contains(&entry.frames), "{}", entry.frames);
    let steps = motion.joints().windows(2);
    let longest = steps
        .flat_map(|pair| (0..JOINTS).map(|joint| distance(pair[0][joint], pair[1][joint])))
        .fold(0.0, f32::max);
    // The walk covers 0.05 m a frame; its outer side and what lifts the arm a little more.
    assert!(longest < 0.08, "{longest}");
    assert!((turn(&motion) - 90.0).abs() < 10.0, "{}", turn(&motion));
    let mut texts: Vec<&str> = entry.captions.iter().map(|c| &*c.text).collect();
    texts.sort();
    let expected = [
        "a person walks forward, then lifts the left arm",
        "first lifts the left arm",
    ];
    assert_eq!(texts, expected);
    assert_eq!(entry.content.as_deref(), Some("new"));
    assert_eq!(
        entry.note.as_deref(),
        Some("composed of walk.features, lift.features")
    );
}

#[test]
fn what_is_too_short_is_not_joined() {
    // Of 60 frames at three times their speed, less than a second is left.
    let part = |speed: &str| {
        format!(r#"{{"of": {{"content": ["lift"]}}, "speed": [{speed}, {speed}], "times": 3}}"#)
    };
    let made = |speed: &str| {
        let folder = tempfile::tempdir().unwrap();
        let data = packed(folder.path(), &recipe(&part(speed), r#""x""#), 0).unwrap();
        let entries = data.entries().iter();
        entries.filter(|entry| entry.name == "new+1").count()
    };
    assert_eq!((made("3"), made("1.5")), (0, 1));
}

#[test]
fn arms_and_mirror_images_come_from_other_motions() {
    let part = r#"{"of": {"content": ["walk"]}, "arms": {"content": ["lift"]}}"#;
    let folder = tempfile::tempdir().unwrap();
    let text = recipe(part, r#""walking with the left arm up""#);
    let data = packed(folder.path(), &text, 0).unwrap();
    let motion = data.motion(find(&data, "new+1")).unwrap();
    let [left, right] = [Joint::LeftWrist, Joint::RightWrist].map(|j| motion.position(58, j)[1]);
    assert!(left > right + 0.3, "{left} {right}");
    let travelled = distance(
        motion.position(0, Joint::Pelvis),
        motion.position(99, Joint::Pelvis),
    );
    assert!((travelled - 4.95).abs() < 0.1, "{travelled}");
    let image = find(&data, "Mnew+1");
    assert!(image.mirror);
    assert_eq!(image.captions[0].text, "walking with the right arm up");
    let motion = data.motion(image).unwrap();
    let [left, right] = [Joint::LeftWrist, Joint::RightWrist].map(|j| motion.position(58, j)[1]);
    assert!(right > left + 0.3, "{left} {right}");
}

#[test]
fn the_same_seed_gives_the_same_motions() {
    let text = r#"{"compositions": [{"content": "slow", "count": 3, "captions": ["x"],
        "parts": [{"of": {"content": ["walk", "lift"]}, "speed": [0.7, 1.2]}]}]}"#;
    let rows = |seed| {
        let folder = tempfile::tempdir().unwrap();
        let data = packed(folder.path(), text, seed).unwrap();
        let entries: Vec<Entry> = { data.entries().iter() }
            .filter(|entry| entry.name.starts_with("slow"))
            .cloned()
            .collect();
        assert_eq!(entries.len(), 3);
        let mut rows = Vec::new();
        for entry in &entries {
            data.features(entry, 0..entry.frames, &mut rows);
        }
        rows
    };
    assert_eq!(rows(1), rows(1));
    assert_ne!(rows(1), rows(2));
}

#[test]
fn a_bad_recipe_is_refused_with_what_is_wrong() {
    let walk = r#"{"of": {"content": ["walk"]}}"#;
    let caption = r#""x""#;
    for (text, expected) in [
        ("{".to_owned(), "EOF"),
        (
            r#"{"compositions": []}"#.into(),
            "expected compositions, found none",
        ),
        (recipe("", caption), "new: expected parts, found none"),
        (recipe(walk, ""), "new: expected captions, found none"),
        (recipe(walk, r#"" ""#), "new: captions: found an empty one"),
        (
            recipe(walk, r#""then {1}""#),
            "the number of one of 1 parts",
        ),
        (recipe(walk, r#""then {""#), "the number of one of 1 parts"),
        (
            recipe(walk, caption).replace(r#""count": 1"#, r#""count": 0"#),
            "count: expected 1 to 100000, found 0",
        ),
        (
            recipe(walk, caption).replace("walk", "swim"),
            "part 0: no motion for training has the content \"swim\"",
        ),
        (
            recipe(r#"{"of": {"content": []}}"#, caption),
            "content: expected contents, found none",
        ),
        (
            recipe(
                r#"{"of": {"content": ["walk"], "words": ["backward"]}}"#,
                caption,
            ),
            "has captions with the words",
        ),
        (
            recipe(r#"{"of": {"content": ["walk"]}, "spam": 1}"#, caption),
            "unknown field `spam`",
        ),
        (
            recipe(
                r#"{"of": {"content": ["walk"]}, "span": [0.5, 0.2]}"#,
                caption,
            ),
            "part 0: span: expected two numbers",
        ),
        (
            recipe(r#"{"of": {"content": ["walk"]}, "speed": [0, 1]}"#, caption),
            "part 0: speed: expected two numbers",
        ),
        (
            recipe(r#"{"of": {"content": ["walk"]}, "times": 0}"#, caption),
            "part 0: times: expected 1 to 20, found 0",
        ),
        (
            recipe(r#"{"of": {"content": ["walk"]}, "turn": [9, 1]}"#, caption),
            "part 0: turn: expected two angles",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let error = packed(folder.path(), &text, 0).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
        assert!(error.contains("recipe.json"), "{error}");
        assert!(!folder.path().join("out").exists());
    }
}

#[test]
fn too_few_fitting_parts_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let text = recipe(r#"{"of": {"content": ["walk"]}}"#, r#""x""#);
    let text = text.replace(r#""count": 1"#, r#""count": 5"#);
    // There is one walk, which is used once as it is.
    let data = packed(folder.path(), &text, 0).unwrap();
    let problems: Vec<String> = data.problems().iter().map(|p| p.reason.clone()).collect();
    let expected = "only 1 motions could be put together";
    assert!(
        problems.iter().any(|p| p.contains(expected)),
        "{problems:?}"
    );
}
