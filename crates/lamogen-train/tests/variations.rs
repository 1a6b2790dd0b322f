//! Making variations of motions, and resuming the work after a stop.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::Device;
use lamogen_data::{Dataset, LoadOptions, PackOptions, pack};
use lamogen_laban::{LabanOptions, LabanSeries};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Motion, RestPose, Rotations};
use lamogen_train::{MotionVariationOptions, VariationError, vary};

/// A motion of somebody who stands and swings the arms.
fn swinging(frames: usize, pace: f32) -> Motion {
    let pose = |frame: usize| {
        let mut local = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
        let half = 0.6 * (pace * frame as f32).sin();
        for joint in [Joint::LeftShoulder, Joint::RightShoulder] {
            local[joint.index()] = [0.0, 0.0, half.sin(), half.cos()];
        }
        local
    };
    let rest = RestPose::humanml3d();
    let root = vec![[0.0, rest.leg() + 0.06, 0.0]; frames];
    let local = (0..frames).map(pose).collect();
    Motion::from_rotations(Rotations::new(rest, root, local, FRAMES_PER_SECOND)).unwrap()
}

fn dataset(folder: &Path) -> Dataset {
    let files = folder.join("files");
    std::fs::create_dir_all(&files).unwrap();
    let mut lines = String::new();
    for (name, pace, split) in [("a", 0.3, "train"), ("b", 0.4, "train"), ("c", 0.5, "val")] {
        let file = format!("{name}.npy");
        swinging(50, pace).save_joints(files.join(&file)).unwrap();
        lines += &format!(
            "{{\"file\": \"{file}\", \"captions\": [\"swinging\"], \"split\": \"{split}\"}}\n"
        );
    }
    let captions = folder.join("captions.jsonl");
    std::fs::write(&captions, lines).unwrap();
    let options = PackOptions {
        captions: Some(captions),
        ..PackOptions::default()
    };
    let out = folder.join("data");
    pack(&files, &out, &options, &mut |_| ()).unwrap();
    Dataset::open(&out, &LoadOptions::default(), &mut |_| ()).unwrap()
}

fn means(rows: &[[f32; 263]]) -> [f32; 4] {
    let motion = Motion::from_pose_features(rows.to_vec()).unwrap();
    let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
    series.known_means(0..rows.len())
}

#[test]
fn variations_have_other_features_and_stopped_work_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(folder.path());
    let options = MotionVariationOptions {
        count: 4,
        ..MotionVariationOptions::default()
    };
    let work = folder.path().join("work");
    let all = |_, _| ControlFlow::Continue(());
    let whole = vary(
        &data,
        &options,
        &folder.path().join("whole"),
        &Device::flex(),
        &all,
    )
    .unwrap();
    let whole = whole.expect("the work was not stopped");
    // Only the two original motions of the training split have variations; mirror images have none of their own.
    assert_eq!(whole.len(), 2 * 4);
    let (mut far, mut followed) = (0, 0);
    for variation in &whole {
        let entry = &data.entries()[variation.entry];
        assert_eq!(variation.rows.len(), entry.frames);
        let mut rows = Vec::new();
        data.features(entry, 0..entry.frames, &mut rows);
        let before = means(rows.as_chunks().0);
        let after = means(&variation.rows);
        let factors: Vec<f32> = { variation.note.rsplit('[').next().unwrap() }
            .trim_end_matches(']')
            .split(", ")
            .map(|number| number.parse().unwrap())
            .collect();
        assert_eq!(factors.len(), 4, "{}", variation.note);
        for ((factor, before), after) in factors.iter().zip(before).zip(after) {
            let found = after / before;
            // Goals of two components may conflict; mostly, the change has the right direction if the factor is far from 1.
            if factor.ln().abs() > 0.4 {
                far += 1;
                followed += usize::from(factor.ln() * found.ln() > 0.0);
            }
        }
    }
    assert!(
        far >= 4 && 4 * followed >= 3 * far,
        "{followed} of {far} factors far from 1 were followed"
    );

    // The work is stopped after the first motion and resumed: the result is the same.
    let finished = AtomicUsize::new(0);
    let first = |_, _| {
        finished.fetch_add(1, Ordering::Relaxed);
        ControlFlow::Break(())
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let stopped = pool
        .install(|| vary(&data, &options, &work, &Device::flex(), &first))
        .unwrap();
    assert!(stopped.is_none());
    assert_eq!(finished.load(Ordering::Relaxed), 1);
    let resumed = vary(&data, &options, &work, &Device::flex(), &all)
        .unwrap()
        .unwrap();
    assert_eq!(resumed, whole);

    let other = MotionVariationOptions { seed: 1, ..options };
    let refused = vary(&data, &other, &work, &Device::flex(), &all).unwrap_err();
    assert!(
        matches!(refused, VariationError::OtherWork { .. }),
        "{refused}"
    );
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(folder.path());
    let usual = MotionVariationOptions::default();
    for (options, part) in [
        (MotionVariationOptions { count: 0, ..usual }, "found 0"),
        (
            MotionVariationOptions {
                factors: [2.0, 1.0],
                ..usual
            },
            "the smaller first",
        ),
        (
            MotionVariationOptions {
                factors: [f32::NAN, 1.0],
                ..usual
            },
            "NaN",
        ),
        (
            MotionVariationOptions {
                evaluations: 0,
                ..usual
            },
            "evaluation",
        ),
    ] {
        let work = folder.path().join("work");
        let refused = vary(&data, &options, &work, &Device::flex(), &|_, _| {
            ControlFlow::Continue(())
        });
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains(part), "{refused}");
        assert!(!work.exists());
    }
}
