//! The public evaluation against figures of PyTorch and numpy (`golden/protocol/make.py`), and evaluators that cannot be used.

use std::fs;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_data::{BenchmarkClip, BenchmarkSplit, Caption, Split};
use lamogen_eval::protocol::{
    ClipSample, Protocol, ProtocolScores, PublicEvaluator, PublicFile, PublicFiles, Replication,
};
use lamogen_eval::{Embeddings, Estimate, mean_pair_distance};
use lamogen_motion::{POSE_FEATURES, npy};
use serde_json::Value;

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/protocol")
}

fn case() -> Value {
    let text = fs::read_to_string(golden().join("case.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn evaluator() -> PublicEvaluator {
    PublicEvaluator::load(&PublicFiles::find(golden()), &Device::flex()).unwrap()
}

/// Returns the pose features of a made-up motion; the same formula is in `make.py`.
fn features(seed: u64, frames: usize) -> Vec<f32> {
    let number = |frame: u64, feature: u64| {
        let wild = (seed * 7919
            + frame * 104_729
            + feature * 1_299_709
            + frame * feature * 31
            + frame * frame * (17 + seed % 7))
            % 2001;
        let slow = (frame * (1 + (seed + feature) % 5) + seed * 13) % 81;
        ((wild + 50 * slow) as f64 - 3000.0) / 1000.0
    };
    let rows = (0..frames as u64).flat_map(|frame| {
        (0..POSE_FEATURES as u64).map(move |feature| number(frame, feature) as f32)
    });
    rows.collect()
}

fn size(value: &Value) -> usize {
    value.as_u64().unwrap() as usize
}

fn numbers(value: &Value) -> Vec<f64> {
    let values = value.as_array().unwrap().iter();
    values.map(|value| value.as_f64().unwrap()).collect()
}

fn pairs(value: &Value) -> Vec<(usize, usize)> {
    let pairs = value.as_array().unwrap().iter();
    pairs.map(|pair| (size(&pair[0]), size(&pair[1]))).collect()
}

/// Writes the recordings of the case as HumanML3D's folder.
fn write_data(case: &Value, folder: &Path) {
    for name in ["new_joint_vecs", "texts"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    let mut names = String::new();
    for (number, recording) in case["recordings"].as_array().unwrap().iter().enumerate() {
        let (name, frames) = (recording[0].as_str().unwrap(), size(&recording[1]));
        let path = folder.join(format!("new_joint_vecs/{name}.npy"));
        npy::write(
            path,
            &features(number as u64, frames),
            &[frames, POSE_FEATURES],
        )
        .unwrap();
        let text = recording[2].as_str().unwrap();
        fs::write(folder.join(format!("texts/{name}.txt")), text).unwrap();
        names.push_str(&format!("{name}\n"));
    }
    fs::write(folder.join("test.txt"), names).unwrap();
}

fn replication(value: &Value) -> Replication {
    let order = |name: &str| {
        { value[name].as_array().unwrap().iter() }
            .map(size)
            .collect()
    };
    let samples = |name: &str| {
        let samples = value[name].as_array().unwrap().iter();
        let sample = |sample: &Value| ClipSample {
            caption: size(&sample[0]),
            start: size(&sample[1]),
            frames: size(&sample[2]),
        };
        samples.map(sample).collect()
    };
    Replication {
        order: order("order"),
        samples: samples("samples"),
        reference_order: order("reference_order"),
        reference: samples("reference"),
    }
}

/// Returns R-precision top 1 to 3, the distance to texts, FID and Diversity.
fn figures(scores: &ProtocolScores) -> Vec<f64> {
    let matching = scores.matching.unwrap();
    let [first, second, third] = matching.r_precision;
    vec![
        first,
        second,
        third,
        matching.distance,
        scores.fid,
        scores.diversity,
    ]
}

fn assert_near(found: &[f64], expected: &[f64], what: &str) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        let difference = (found - expected).abs();
        assert!(
            difference <= 1e-4 * expected.abs().max(1.0),
            "{what}: {found} instead of {expected}"
        );
    }
}

#[test]
fn the_whole_evaluation_is_that_of_the_public_code() {
    let case = case();
    let folder = tempfile::tempdir().unwrap();
    write_data(&case, folder.path());
    let split = BenchmarkSplit::open(folder.path(), Split::Test, &mut |_| ()).unwrap();
    let clips: Vec<&BenchmarkClip> = split.clips().iter().collect();
    let expected = case["clips"].as_array().unwrap();
    assert_eq!(clips.len(), expected.len());
    for (clip, expected) in clips.iter().zip(expected) {
        assert_eq!(clip.name, expected[0].as_str().unwrap());
        assert_eq!(clip.frames(), size(&expected[1]), "{}", clip.name);
        let captions = expected[2].as_array().unwrap().iter();
        let captions = captions.map(|caption| caption.as_str().unwrap());
        assert!(clip.captions.iter().map(|c| &*c.text).eq(captions));
    }

    let evaluator = evaluator();
    evaluator.check_statistics(&split).unwrap();
    let replications = case["replications"].as_array().unwrap();
    let draws: Vec<Replication> = replications.iter().map(replication).collect();
    let as_they_are = |rows: &[f32]| Ok(rows.to_vec());
    let protocol = Protocol::embed(&evaluator, &clips, &draws, &as_they_are).unwrap();
    let places: Vec<usize> = (0..clips.len()).collect();
    let mut rows = [("real", Vec::new()), ("generated", Vec::new())];
    for (number, (draw, recorded)) in draws.iter().zip(replications).enumerate() {
        let made = |place: usize, repeat: usize| {
            let seed = 5000 + 1000 * number + 10 * place + repeat;
            features(seed as u64, draw.samples[place].frames)
        };
        let motions: Vec<Vec<f32>> = places.iter().map(|&place| made(place, 0)).collect();
        let generated = evaluator.motions(&motions).unwrap();
        let own = draw.samples.iter().zip(&clips);
        let own: Vec<&[f32]> = own
            .map(|(sample, clip)| {
                let range = sample.range();
                &clip.features[range.start * POSE_FEATURES..range.end * POSE_FEATURES]
            })
            .collect();
        let real = evaluator.motions(&own).unwrap();
        let pairs_of = |name: &str| pairs(&recorded[name]);
        let diversity = pairs_of("pairs");
        for ((name, values), motions) in rows.iter_mut().zip([&real, &generated]) {
            let scores = protocol
                .scores_with_pairs(number, &places, motions, Some(&diversity))
                .unwrap();
            assert_eq!(scores.motions, 64);
            let expected = numbers(&case["rows"][*name]["each"][number]);
            assert_near(&figures(&scores), &expected, name);
            values.push(figures(&scores));
        }
        // The ready-made row has the same motions, and its own pairs.
        let ready = protocol.real_scores(number).unwrap();
        assert_near(&figures(&ready)[..5], &rows[0].1[number][..5], "real");

        let many = size(&case["many"][1]);
        let sets = draw.order[..size(&case["many"][0])].iter().map(|&place| {
            let motions: Vec<Vec<f32>> = (0..many).map(|repeat| made(place, repeat)).collect();
            evaluator.motions(&motions).unwrap()
        });
        let sets: Vec<Embeddings> = sets.collect();
        let found = mean_pair_distance(&sets, &pairs_of("many_pairs")).unwrap();
        let expected = numbers(&case["multimodality"])[number];
        assert_near(&[found], &[expected], "MultiModality");
    }
    for (name, values) in rows {
        let column = |at: usize| Estimate::of(values.iter().map(|row| row[at]));
        let found: Vec<Estimate> = (0..6).map(column).collect();
        let means: Vec<f64> = found.iter().map(|estimate| estimate.mean).collect();
        let intervals: Vec<f64> = found.iter().map(|estimate| estimate.interval).collect();
        assert_near(&means, &numbers(&case["rows"][name]["mean"]), name);
        assert_near(&intervals, &numbers(&case["rows"][name]["interval"]), name);
    }
}

#[test]
fn motions_that_are_missing_are_left_out_of_the_batches() {
    let case = case();
    let folder = tempfile::tempdir().unwrap();
    write_data(&case, folder.path());
    let split = BenchmarkSplit::open(folder.path(), Split::Test, &mut |_| ()).unwrap();
    let clips: Vec<&BenchmarkClip> = split.clips().iter().collect();
    let evaluator = evaluator();
    let draws = [Replication::draw(&clips, 1)];
    let as_they_are = |rows: &[f32]| Ok(rows.to_vec());
    let protocol = Protocol::embed(&evaluator, &clips, &draws, &as_they_are).unwrap();
    let scores = |places: &[usize]| {
        let motions: Vec<Vec<f32>> = { places.iter() }
            .map(|&place| features(place as u64, draws[0].samples[place].frames))
            .collect();
        protocol.scores(0, places, &evaluator.motions(&motions).unwrap())
    };
    // Which comes first in the list does not matter, only the order of the replication.
    let mut places = draws[0].order[2..40].to_vec();
    let found = scores(&places).unwrap();
    assert_eq!(found.motions, 32);
    places.sort_unstable();
    let sorted = scores(&places).unwrap();
    assert_near(&figures(&sorted), &figures(&found), "sorted");
    let error = scores(&places[..31]).unwrap_err().to_string();
    assert!(error.contains("at least 32 motions, found 31"), "{error}");
}

/// Copies the evaluator's folder.
fn copy(to: &Path) {
    for file in PublicFile::ALL {
        let path = to.join(file.place());
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::copy(golden().join(file.place()), path).unwrap();
    }
}

#[test]
fn a_folder_without_one_of_its_files_is_refused_or_embeds_motions_only() {
    for file in PublicFile::ALL {
        let folder = tempfile::tempdir().unwrap();
        copy(folder.path());
        fs::remove_file(folder.path().join(file.place())).unwrap();
        let files = PublicFiles::find(folder.path());
        let loaded = PublicEvaluator::load(&files, &Device::flex());
        match file {
            PublicFile::Network | PublicFile::Mean | PublicFile::Std => {
                let error = loaded.unwrap_err().to_string();
                assert!(
                    error.contains(file.place()) && error.contains("text-to-motion"),
                    "{error}"
                );
            }
            PublicFile::WordVectors | PublicFile::Words | PublicFile::WordRows => {
                let evaluator = loaded.unwrap();
                assert!(!evaluator.has_words());
                assert_eq!(evaluator.motions(&[features(1, 40)]).unwrap().len(), 1);
                let caption = Caption {
                    text: "he walks".into(),
                    tokens: Some("he/PRON walk/VERB".into()),
                };
                let error = evaluator.captions(&[&caption]).unwrap_err().to_string();
                assert!(error.contains("our_vab"), "{error}");
            }
        }
    }
}

#[test]
fn captions_without_tokens_are_named() {
    let evaluator = evaluator();
    let check = |tokens: Option<&str>| {
        let caption = Caption {
            text: "he walks".into(),
            tokens: tokens.map(str::to_owned),
        };
        let checked = evaluator.check_caption(&caption).map_err(|e| e.to_string());
        let embedded = evaluator.captions(&[&caption]).map_err(|e| e.to_string());
        assert_eq!(checked, embedded.map(drop));
        checked
    };
    check(Some("he/PRON walk/VERB")).unwrap();
    let error = check(None).unwrap_err();
    assert!(
        error.contains("he walks") && error.contains("parts of speech"),
        "{error}"
    );
    let error = check(Some("he walks")).unwrap_err();
    assert!(
        error.contains("token 1") && error.contains("`he`"),
        "{error}"
    );
}

#[test]
fn statistics_of_the_data_or_of_a_denoiser_are_refused() {
    let case = case();
    let data = tempfile::tempdir().unwrap();
    write_data(&case, data.path());
    let split = BenchmarkSplit::open(data.path(), Split::Test, &mut |_| ()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    copy(folder.path());
    let path = folder.path().join(PublicFile::Std.place());
    let std = npy::read(&path).unwrap().values;
    let check = |factor: f32| {
        let mut std = std.clone();
        for (feature, value) in std.iter_mut().enumerate() {
            if !(4..259).contains(&feature) {
                *value *= factor;
            }
        }
        npy::write(&path, &std, &[std.len()]).unwrap();
        let files = PublicFiles::find(folder.path());
        let evaluator = PublicEvaluator::load(&files, &Device::flex()).unwrap();
        evaluator
            .check_statistics(&split)
            .map_err(|e| e.to_string())
    };
    // The data's own, those of MotionDiffuse's networks, and neither.
    for (factor, parts) in [
        (5.0, ["these are 1.00 of it", "HumanML3D's own"]),
        (0.2, ["these are 0.04 of it", "MotionDiffuse"]),
        (100.0, ["these are 20.00 of it", "Comp_v6_KLD01/meta"]),
    ] {
        let error = check(factor).unwrap_err();
        for part in parts {
            assert!(error.contains(part), "{factor}: {error}");
        }
    }
    check(1.0).unwrap();
    check(1.2).unwrap();
    npy::write(&path, &[1.0; 251], &[251]).unwrap();
    let files = PublicFiles::find(folder.path());
    let error = PublicEvaluator::load(&files, &Device::flex()).unwrap_err();
    assert!(error.to_string().contains("263"), "{error}");
}
