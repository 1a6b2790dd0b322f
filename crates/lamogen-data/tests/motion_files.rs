//! Tests of packing a folder of motion files.

use std::path::Path;

use lamogen_data::{DataError, Dataset, LoadOptions, PackOptions, ProblemKind, Split, pack};
use lamogen_motion::{BoneDrift, Joint, Motion, RestPose, Rotations};

/// Returns the motion of a body one and a half times as large as HumanML3D's. It walks and turns; the left arm swings
/// most.
fn walk(frames: usize) -> Motion {
    let rest = RestPose::humanml3d();
    let poses = (0..frames).map(|frame| {
        let time = frame as f32 * 0.15;
        let mut pose = [[0.0f32; 3]; lamogen_motion::JOINTS];
        pose[0] = [0.1 * (time * 0.2).sin(), 0.95, 0.03 * frame as f32];
        for joint in Joint::ALL {
            let Some(parent) = joint.parent() else {
                continue;
            };
            let [x, y, z] = rest.offset(joint);
            let swing: f32 = match joint {
                Joint::LeftKnee => 0.4,
                Joint::RightKnee => -0.4,
                Joint::LeftElbow => 1.2,
                Joint::RightElbow => 0.2,
                _ => 0.05,
            };
            let (sin, cos) = (swing * time.sin()).sin_cos();
            let [px, py, pz] = pose[parent.index()];
            pose[joint.index()] = [px + cos * x - sin * y, py + sin * x + cos * y, pz + z];
        }
        let (sin, cos) = (0.4 * (time * 0.3).sin()).sin_cos();
        pose.map(|[x, y, z]| [cos * x + sin * z, y, cos * z - sin * x].map(|x| x * 1.5))
    });
    Motion::from_joints(poses.collect()).unwrap()
}

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

fn save(folder: &Path, name: &str, motion: &Motion) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    lamogen_files::write(path, motion, &Default::default()).unwrap();
}

fn read(folder: &Path, captions: &str) -> Result<Dataset, DataError> {
    write(folder, "captions.txt", captions);
    let out = folder.join("out");
    let options = PackOptions {
        captions: Some(folder.join("captions.txt")),
        force: true,
        ..PackOptions::default()
    };
    pack(folder, &out, &options, &mut |_| {})
        .map(|_| Dataset::open(&out, &LoadOptions::default(), &mut |_| {}).unwrap())
}

#[test]
fn motion_files_are_cut_mirrored_and_put_on_humanml3ds_body() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    save(folder, "walk.bvh", &walk(81));
    save(folder, "takes/long.glb", &walk(401));
    save(folder, "takes/joints.npy", &walk(61));
    save(folder, "short.bvh", &walk(40));
    save(folder, "silent.bvh", &walk(60));
    write(folder, "broken.bvh", "HIERARCHY\nROOT");
    let data = read(
        folder,
        "{\"file\": \"walk.bvh\", \"captions\": [\"a person swings the left arm\"], \"split\": \"train\", \"content\": \"swing-left\", \"style\": \"old\", \"source\": \"me\"}\n\
         {\"file\": \"takes/long.glb\", \"captions\": [\"a long walk\"], \"split\": \"test\"}\n\
         {\"file\": \"takes/long.glb\", \"captions\": [\"a part\"], \"start\": 1, \"end\": 4}\n\
         {\"file\": \"takes/joints.npy\", \"captions\": [\"x\", \"y\"], \"split\": \"val\"}\n\
         short.bvh\tshort\nbroken.bvh\tbroken\nlost.bvh\tlost\n",
    )
    .unwrap();
    let found: Vec<(&str, usize, Split, bool)> = { data.entries().iter() }
        .map(|entry| (&*entry.name, entry.frames, entry.split, entry.mirror))
        .collect();
    assert_eq!(
        found,
        [
            ("walk", 80, Split::Train, false),
            ("takes/long_1", 133, Split::Test, false),
            ("takes/long_2", 133, Split::Test, false),
            ("takes/long_3", 134, Split::Test, false),
            ("takes/long@1-4", 60, Split::Test, false),
            ("takes/joints", 60, Split::Validation, false),
            ("Mwalk", 80, Split::Train, true),
        ]
    );
    let image = &data.entries()[6];
    assert_eq!(image.captions[0].text, "a person swings the right arm");
    assert_eq!(image.content.as_deref(), Some("swing-right"));
    assert_eq!(image.style.as_deref(), Some("old"));
    assert_eq!(image.trial.as_deref(), Some("walk.bvh"));

    // Every motion has the size of HumanML3D's body and moves as the file does.
    let body = RestPose::humanml3d();
    for entry in data.entries() {
        let mut rows = Vec::new();
        data.features(entry, 0..entry.frames, &mut rows);
        let motion = Motion::from_pose_features(rows.as_chunks().0.to_vec()).unwrap();
        let lengths = BoneDrift::of(&motion).lengths;
        for joint in [Joint::LeftKnee, Joint::RightWrist, Joint::Head] {
            let joint = if entry.mirror {
                joint.mirrored()
            } else {
                joint
            };
            let stored = if entry.mirror {
                joint.mirrored()
            } else {
                joint
            };
            let expected: f32 = body
                .offset(stored)
                .iter()
                .map(|x| x * x)
                .sum::<f32>()
                .sqrt();
            let found = lengths[joint.index()];
            assert!((found - expected).abs() < 3e-3, "{}: {found}", entry.name);
        }
        let swings = |joint: Joint| {
            let sides = motion.joints().iter().map(|pose| pose[joint.index()]);
            let heights: Vec<f32> = sides.map(|[_, y, _]| y).collect();
            let ends = heights
                .iter()
                .fold((f32::MAX, f32::MIN), |e, y| (e.0.min(*y), e.1.max(*y)));
            ends.1 - ends.0
        };
        let (most, least) = match entry.mirror {
            false => (Joint::LeftElbow, Joint::RightElbow),
            true => (Joint::RightElbow, Joint::LeftElbow),
        };
        assert!(swings(most) > 3.0 * swings(least), "{}", entry.name);
    }
}

#[test]
fn what_is_left_out_of_motion_files_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    save(folder, "walk.bvh", &walk(81));
    save(folder, "short.bvh", &walk(40));
    save(folder, "deep/down/silent.bvh", &walk(60));
    write(folder, "broken.bvh", "HIERARCHY\nROOT");
    let captions = "{\"file\": \"walk.bvh\", \"captions\": [\"x\"], \"split\": \"train\"}\n\
                    short.bvh\tshort\nbroken.bvh\tbroken\nlost.bvh\tlost\n";
    write(folder, "captions.txt", captions);
    let options = PackOptions {
        captions: Some(folder.join("captions.txt")),
        ..PackOptions::default()
    };
    let data = pack(folder, folder.join("out"), &options, &mut |_| {}).unwrap();
    let found: Vec<(ProblemKind, &str)> = { data.problems().iter() }
        .map(|problem| (problem.kind, &*problem.name))
        .collect();
    assert_eq!(
        found,
        [
            (ProblemKind::NoCaption, "deep/down/silent.bvh"),
            (ProblemKind::TooShort, "short"),
            (ProblemKind::Unreadable, "broken.bvh"),
            (ProblemKind::Missing, "lost.bvh"),
        ]
    );
}

#[test]
fn features_in_arrays_are_taken_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let motion = walk(71);
    save(folder, "walk.features.npy", &motion);
    save(folder, "walk.npy", &motion);
    let line = |file: &str| {
        format!("{{\"file\": \"{file}\", \"captions\": [\"x\"], \"split\": \"train\"}}\n")
    };
    let data = read(folder, &(line("walk.features.npy") + &line("walk.npy"))).unwrap();
    let heights: Vec<f32> = { data.entries().iter().take(2) }
        .map(|entry| {
            let mut rows = Vec::new();
            data.features(entry, 0..1, &mut rows);
            rows[3]
        })
        .collect();
    // The large body keeps its size in a file of features, and loses it in a file of joints.
    let ratio = heights[0] / heights[1];
    assert!((ratio - 1.5).abs() < 0.1, "{heights:?}");
}

#[test]
fn a_motion_of_humanml3ds_body_is_not_changed() {
    let poses = walk(60)
        .joints()
        .iter()
        .map(|pose| pose.map(|point| point.map(|x| x / 1.5)))
        .collect();
    let motion = Motion::from_joints(poses).unwrap();
    let rotations = Rotations::of(&motion).on(&RestPose::humanml3d());
    let distance = rotations.distance(&motion);
    assert!(distance.largest < 0.03, "{distance:?}");
}

#[test]
fn captions_are_required_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    save(folder, "walk.bvh", &walk(81));
    let out = folder.join("out");
    let message = pack(folder, &out, &PackOptions::default(), &mut |_| {}).unwrap_err();
    assert!(
        matches!(message, DataError::Uncaptioned { .. }),
        "{message}"
    );
    let message = read(folder, "walk.bvh\ta person walks\nwalk.bvh a man\n").unwrap_err();
    assert!(
        message.to_string().contains("captions.txt, line 2"),
        "{message}"
    );
    let message = read(
        folder,
        "{\"file\": \"walk.bvh\", \"captions\": [\"x\"], \"split\": \"test\"}\n",
    );
    let message = message.unwrap_err().to_string();
    assert!(message.contains("no motion is for training"), "{message}");
    assert!(!out.exists());
}

#[test]
fn a_pose_before_the_movement_is_left_out_unless_a_start_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let motion = walk(81);
    let mut poses = motion.joints().to_vec();
    // The first pose is half a metre away.
    for joint in Joint::ALL {
        let [x, y, z] = poses[0][joint.index()];
        poses[0][joint.index()] = [x + 0.5, y, z];
    }
    save(
        folder,
        "calibrated.npy",
        &Motion::from_joints(poses).unwrap(),
    );
    save(folder, "walk.npy", &motion);
    let line = |file: &str, more: &str| {
        format!("{{\"file\": \"{file}\", \"captions\": [\"x\"], \"split\": \"train\"{more}}}\n")
    };
    let lines = [
        line("calibrated.npy", ""),
        line("calibrated.npy", ", \"start\": 0"),
        line("walk.npy", ""),
    ];
    let data = read(folder, &lines.concat()).unwrap();
    let frames: Vec<usize> = { data.entries().iter().take(3) }
        .map(|entry| entry.frames)
        .collect();
    assert_eq!(frames, [79, 80, 80]);
    let notes: Vec<bool> = { data.entries().iter().take(3) }
        .map(|entry| entry.note.is_some())
        .collect();
    assert_eq!(notes, [true, false, false]);
}
