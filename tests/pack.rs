//! `lamogen pack` as people and scripts use it.

mod running;

use std::path::Path;

use lamogen::motion::{RestPose, npy};
use lamogen::{Joint, Motion, files};
use lamogen_data::{Dataset, LoadOptions, Split};
use serde_json::Value;

fn succeeds(folder: &Path, arguments: &[&str]) -> (String, String) {
    running::succeeds(folder, &[&["pack"], arguments].concat())
}

fn fails(folder: &Path, arguments: &[&str], code: i32, part: &str) {
    running::fails(folder, &[&["pack"], arguments].concat(), code, &[part]);
}

/// A body that walks in a curve, so that every feature changes.
fn walk(frames: usize) -> Motion {
    let rest = RestPose::humanml3d();
    let poses = (0..frames).map(|frame| {
        let time = frame as f32 * 0.15;
        let mut pose = [[0.0; 3]; lamogen::JOINTS];
        pose[0] = [0.1 * time.sin(), 0.9, 0.03 * frame as f32];
        for joint in Joint::ALL {
            let Some(parent) = joint.parent() else {
                continue;
            };
            let [x, y, z] = rest.offset(joint);
            let (sin, cos) = (0.3 * (time + joint.index() as f32).sin()).sin_cos();
            let [px, py, pz] = pose[parent.index()];
            pose[joint.index()] = [px + x, py + cos * y - sin * z, pz + sin * y + cos * z];
        }
        let (sin, cos) = (0.4 * (0.3 * time).sin()).sin_cos();
        pose.map(|[x, y, z]| [cos * x + sin * z, y, cos * z - sin * x])
    });
    Motion::from_joints(poses.collect()).unwrap()
}

fn write(path: &Path, text: &str) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

fn open(folder: &Path) -> Dataset {
    Dataset::open(folder, &LoadOptions::default(), &mut |_| {}).unwrap()
}

#[test]
fn a_folder_of_humanml3ds_form_is_packed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let source = folder.join("HumanML3D");
    for (name, frames) in [
        ("000001", 100),
        ("000002", 60),
        ("000003", 20),
        ("000004", 90),
    ] {
        let text = "a person walks to the left.#a/DET person/NOUN walk/VERB#0.0#0.0\n";
        write(&source.join(format!("texts/{name}.txt")), text);
        let vectors = source.join(format!("new_joint_vecs/{name}.npy"));
        write(&vectors, "");
        walk(frames + 1).save_features(&vectors).unwrap();
    }
    npy::write(
        source.join("new_joint_vecs/000004.npy"),
        &[0.0; 500],
        &[2, 250],
    )
    .unwrap();
    write(&source.join("train.txt"), "000001\n000003\n000004\n");
    write(&source.join("test.txt"), "000002\n000009\n");

    let (result, notices) = succeeds(folder, &["HumanML3D", "--out", "packed"]);
    for part in [
        "train     1 clip, 2 entries, 1 of them mirror images, 0.2 min",
        "test      1 clip, 1 entry, 0.1 min",
        "1 too short",
        "1 wrong shape",
        "1 missing",
    ] {
        assert!(result.contains(part), "{part}: {result}");
    }
    assert!(
        notices.contains("000009") && notices.contains("[2, 250]"),
        "{notices}"
    );
    assert!(!notices.contains("000003"), "{notices}");

    let data = open(&folder.join("packed"));
    assert_eq!(data.entries().len(), 3);
    assert_eq!(
        data.entries()[2].captions[0].text,
        "a person walks to the right."
    );

    fails(folder, &["HumanML3D", "-o", "packed"], 4, "hint: --force");
    let plain = [
        "HumanML3D",
        "-o",
        "packed",
        "--force",
        "--no-mirror",
        "--json",
        "--min-frames",
        "20",
    ];
    let (result, _) = succeeds(folder, &plain);
    let report: Value = serde_json::from_str(&result).unwrap();
    assert_eq!(report["splits"]["train"]["entries"], 2);
    assert_eq!(report["splits"]["train"]["mirrored"], 0);
    assert_eq!(report["left_out"]["missing"], 1);
    let minutes = report["splits"]["test"]["minutes"].as_f64().unwrap();
    assert!((minutes - 0.05).abs() < 1e-9, "{minutes}");
    let problems = report["problems"].as_array().unwrap();
    assert!(
        problems.iter().any(|problem| problem["name"] == "000009"),
        "{problems:?}"
    );

    let twice = ["HumanML3D", "-o", "other", "--captions", "c.txt"];
    fails(folder, &twice, 2, "captions of its own");
    let limits = ["HumanML3D", "-o", "other", "--max-frames", "30"];
    fails(folder, &limits, 2, "40 and 30");
    let none = ["HumanML3D", "-o", "other", "--min-frames", "150"];
    fails(folder, &none, 3, "at least one motion");
    assert!(!folder.join("other").exists());
}

#[test]
fn a_folder_of_bvh_files_is_packed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir_all(folder.join("takes/more")).unwrap();
    let fast = files::WriteOptions {
        frames_per_second: Some(60.0),
        ..Default::default()
    };
    files::write(folder.join("takes/walk.bvh"), &walk(101), &fast).unwrap();
    files::write(
        folder.join("takes/more/long.bvh"),
        &walk(301),
        &Default::default(),
    )
    .unwrap();
    write(
        &folder.join("captions.jsonl"),
        "{\"file\": \"walk.bvh\", \"captions\": [\"a person turns clockwise\"], \"split\": \"train\"}\n\
         {\"file\": \"more/long.bvh\", \"captions\": [\"a person walks\"], \"split\": \"val\"}\n",
    );
    fails(folder, &["takes", "-o", "packed"], 2, "hint: --captions");
    let all = [
        "takes",
        "-o",
        "packed",
        "--captions",
        "captions.jsonl",
        "--no-mirror",
        "--mirror",
    ];
    let (result, _) = succeeds(folder, &all);
    for part in [
        "train     1 clip, 2 entries",
        "val       2 clips, 2 entries",
        "0.2 min",
    ] {
        assert!(result.contains(part), "{part}: {result}");
    }
    let data = open(&folder.join("packed"));
    let frames: Vec<usize> = data.entries().iter().map(|entry| entry.frames).collect();
    // 60 frames a second became 20; the long one was cut.
    assert_eq!(frames, [100, 150, 150, 100]);
    let image = data.split(Split::Train).last().unwrap();
    assert_eq!(image.captions[0].text, "a person turns counterclockwise");

    write(
        &folder.join("captions.jsonl"),
        "walk.bvh\tx\n{\"file\": 3}\n",
    );
    fails(
        folder,
        &["takes", "-o", "other", "--captions", "captions.jsonl"],
        3,
        "line 2",
    );
    fails(folder, &["lost", "-o", "other"], 3, "lost");
    assert!(!folder.join("other").exists());
}

#[test]
fn variations_are_made_of_a_packed_folder() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("files")).unwrap();
    walk(60).save_joints(folder.join("files/a.npy")).unwrap();
    let line = r#"{"file": "a.npy", "captions": ["a person walks"], "split": "train"}"#;
    std::fs::write(folder.join("captions.txt"), line).unwrap();
    succeeds(
        folder,
        &["files", "--captions", "captions.txt", "--out", "data"],
    );
    let vary = ["vary", "data", "--out", "varied", "--count", "2", "--json"];
    let (result, _) = running::succeeds(folder, &vary);
    assert_eq!(
        serde_json::from_str::<Value>(&result).unwrap()["variations"],
        2
    );
    let data = Dataset::open(folder.join("varied"), &LoadOptions::default(), &mut |_| {}).unwrap();
    let of = |original: &str| {
        let entries = data.entries().iter();
        entries
            .filter(|entry| entry.variation_of.as_deref() == Some(original))
            .count()
    };
    assert_eq!([of("a"), of("Ma"), data.entries().len()], [2, 2, 6]);
    assert!(!folder.join("varied.work").exists());
    running::fails(folder, &vary, 4, &["varied"]);
    running::fails(
        folder,
        &["vary", "data", "--out", "other", "--factors", "2,1"],
        2,
        &["the smaller first"],
    );
}
