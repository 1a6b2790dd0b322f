//! `lamogen eval` with the public evaluator of HumanML3D.

mod running;

use std::fs;
use std::path::{Path, PathBuf};

use burn::tensor::Tensor;
use lamogen::model::{Denoiser, DenoiserInput, Prediction, Prompt, TokenBatch, Tokenizer};
use lamogen::motion::{Normalization, POSE_FEATURES, npy};
use lamogen::{Device, LaMoGen};
use lamogen_data::{BenchmarkClip, BenchmarkSplit, Split};
use lamogen_eval::protocol::{Protocol, PublicEvaluator, PublicFile, PublicFiles, Replication};
use lamogen_eval::{Embeddings, mean_distance};
use lamogen_evaluation::{
    EvaluatedModel, EvaluationErrorKind, EvaluationOptions, MeasurementTarget,
    MultimodalityOptions, PublicBenchmark, estimate_publicly, evaluate_publicly,
};
use running::{fails, succeeds};
use serde_json::Value;

/// The folder of a small evaluator with random weights, as users have the public one.
fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../lamogen-eval/tests/golden/protocol")
}

/// Copies the evaluator's files but one.
fn copy_evaluator(folder: &Path, without: Option<PublicFile>) {
    for file in PublicFile::ALL
        .into_iter()
        .filter(|file| Some(*file) != without)
    {
        let path = folder.join(file.place());
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::copy(golden().join(file.place()), path).unwrap();
    }
}

/// Writes 36 recordings whose root and foot contacts have the deviations that the evaluator's statistics expect, in HumanML3D's form.
fn write_data(folder: &Path) {
    for name in ["new_joint_vecs", "texts"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    let std = npy::read(golden().join(PublicFile::Std.place()))
        .unwrap()
        .values;
    let mean = npy::read(golden().join(PublicFile::Mean.place()))
        .unwrap()
        .values;
    let mut names = String::new();
    for place in 0..36usize {
        let (frames, name) = (40 + place, format!("{place:06}"));
        let rows: Vec<f32> = (0..frames * POSE_FEATURES)
            .map(|i| {
                let (frame, feature) = (i / POSE_FEATURES, i % POSE_FEATURES);
                let bias = if (4..259).contains(&feature) {
                    1.0
                } else {
                    5.0
                };
                let wave = (0.3 * frame as f32 + (feature * (place + 1)) as f32).sin();
                mean[feature] + 1.4 * bias * std[feature] * wave
            })
            .collect();
        let path = folder.join(format!("new_joint_vecs/{name}.npy"));
        npy::write(path, &rows, &[frames, POSE_FEATURES]).unwrap();
        let text = "a man walks#a/DET man/NOUN walk/VERB#0.0#0.0\n\
                    someone turns left#someone/PRON turn/VERB left/ADV#0.0#0.0\n";
        fs::write(folder.join(format!("texts/{name}.txt")), text).unwrap();
        names.push_str(&format!("{name}\n"));
    }
    fs::write(folder.join("test.txt"), names).unwrap();
}

/// A network whose motions are noise that grows with the sentence.
struct Noise;

impl Denoiser for Noise {
    type Context = ();

    fn prediction(&self) -> Prediction {
        Prediction::Sample
    }

    fn pose_features(&self) -> usize {
        POSE_FEATURES
    }

    fn max_frames(&self) -> usize {
        196
    }

    fn device(&self) -> Device {
        Device::flex()
    }

    fn encode(&self, tokens: &TokenBatch) -> Prompt<()> {
        let words = tokens.ids.clone().greater_elem(0).float().sum_dim(1);
        Prompt {
            embedding: words * 0.02,
            context: (),
        }
    }

    fn embed_timesteps(&self, timesteps: &[usize]) -> Tensor<2> {
        Tensor::zeros([timesteps.len(), 1], &self.device())
    }

    fn denoise(&self, input: DenoiserInput, (): &()) -> Tensor<3> {
        input.x_t.tanh() * input.embedding.unsqueeze_dim::<3>(2)
    }
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn table_two_is_that_of_the_public_evaluation() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    write_data(&data);
    let split = BenchmarkSplit::open(&data, Split::Test, &mut |_| ()).unwrap();
    let device = Device::flex();
    let evaluator = PublicEvaluator::load(&PublicFiles::find(golden()), &device).unwrap();
    let benchmark = PublicBenchmark {
        evaluator: Some(&evaluator),
        split: &split,
    };
    let normalization =
        Normalization::from_slices(&[0.0; POSE_FEATURES], &[1.0; POSE_FEATURES], &device).unwrap();
    let model = LaMoGen::new(Noise, Tokenizer::clip(77), normalization.clone());
    let evaluated = EvaluatedModel {
        model: &model,
        name: "noise",
        fingerprint: "first".into(),
    };
    let options = EvaluationOptions {
        repeats: 2,
        steps: Some(2),
        methods: Vec::new(),
        studies: Vec::new(),
        measure: MeasurementTarget::Joints,
        multimodality: Some(MultimodalityOptions {
            texts: 3,
            motions: 4,
        }),
        ..EvaluationOptions::default()
    };
    let out = folder.path().join("out");
    let estimates = estimate_publicly(&evaluated, benchmark, &out, &options, &mut ()).unwrap();
    let motions: usize = estimates.iter().map(|estimate| estimate.motions).sum();
    // With 3 further motions of 3 texts each.
    assert_eq!(motions, 2 * (36 + 3 * 3));
    let evaluation = evaluate_publicly(&evaluated, benchmark, &out, &options, &mut ()).unwrap();
    assert_eq!((evaluation.motions, evaluation.missing), (motions, 0));

    let text = fs::read_to_string(out.join("report.md")).unwrap();
    let header = "| method | top 1 | top 2 | top 3 | FID | Diversity | MM-Dist | MultiModality |";
    assert!(text.contains(header), "{text}");
    assert!(text.contains("by the public evaluation of HumanML3D"));
    let (_, table) = text.split_once(header).unwrap();
    let row = |title: &str| {
        let row = table
            .lines()
            .find(|line| line.starts_with(&format!("| {title} |")));
        row.unwrap_or_else(|| panic!("{title} is not in {table}"))
    };
    // The paper's figures stand in brackets.
    for part in ["(0.470)", "(0.662)", "(0.767)", "(2.210)", "(9.32)"] {
        assert!(row("Text alone").contains(part), "{part}: {table}");
    }
    // Real motions have an FID of two passes; only MultiModality is none of theirs.
    assert_eq!(row("Real motions").matches('–').count(), 1, "{table}");
    assert_eq!(row("Text alone").matches('–').count(), 0, "{table}");

    // The figures are those of the protocol for the same draws.
    let figures = json(&fs::read_to_string(out.join("figures.json")).unwrap());
    let clips: Vec<&BenchmarkClip> = split.clips().iter().collect();
    let draws: Vec<Replication> = (0..2).map(|seed| Replication::draw(&clips, seed)).collect();
    let as_they_are = |rows: &[f32]| Ok(rows.to_vec());
    let protocol = Protocol::embed(&evaluator, &clips, &draws, &as_they_are).unwrap();
    let scores = [0, 1].map(|repeat| protocol.real_scores(repeat).unwrap());
    let mean = |value: &dyn Fn(usize) -> f64| (value(0) + value(1)) / 2.0;
    for (name, expected) in [
        ("fid", mean(&|repeat| scores[repeat].fid)),
        ("diversity", mean(&|repeat| scores[repeat].diversity)),
        (
            "matching",
            mean(&|repeat| scores[repeat].matching.unwrap().distance),
        ),
    ] {
        let found = figures["real_motions"][name]["mean"].as_f64().unwrap();
        assert!(
            (found - expected).abs() < 1e-9,
            "{name}: {found}, {expected}"
        );
    }
    // Those of generated motions are those of the protocol for the points of the records.
    let records = fs::read_to_string(out.join("records.jsonl")).unwrap();
    let records: Vec<Value> = records.lines().map(json).collect();
    let point = |id: String| -> Vec<f32> {
        let record = records.iter().find(|record| record["id"] == id).unwrap();
        serde_json::from_value(record["result"]["motion"]["point"].clone()).unwrap()
    };
    let places: Vec<usize> = (0..clips.len()).collect();
    let mut fid = 0.0;
    let mut multimodality = 0.0;
    for (repeat, draws) in draws.iter().enumerate() {
        let id = |place: &usize| format!("text / nothing / {place} / {repeat}");
        let points: Vec<Vec<f32>> = places.iter().map(|place| point(id(place))).collect();
        let width = points[0].len();
        let points = Embeddings::new(points.concat(), width).unwrap();
        fid += protocol.scores(repeat, &places, &points).unwrap().fid / 2.0;
        for place in &draws.order[..3] {
            let more = (1..4).flat_map(|number| point(format!("{} / {number}", id(place))));
            let set = point(id(place)).into_iter().chain(more);
            let set = Embeddings::new(set.collect(), width).unwrap();
            multimodality += mean_distance(&set).unwrap() / 6.0;
        }
    }
    let generated = &figures["settings"][0];
    for (name, expected) in [("fid", fid), ("multimodality", multimodality)] {
        let found = generated[name]["mean"].as_f64().unwrap();
        assert!(
            (found - expected).abs() < 1e-9 && found > 0.0,
            "{name}: {found}, {expected}"
        );
        assert!(generated[name]["interval"].is_f64());
    }

    // A model for longer motions only is refused.
    let long = LaMoGen::new(Noise, Tokenizer::clip(77), normalization).with_min_frames(40);
    let long = EvaluatedModel {
        model: &long,
        name: "noise",
        fingerprint: "first".into(),
    };
    let error = evaluate_publicly(&long, benchmark, &out, &options, &mut ()).unwrap_err();
    let message = error.to_string();
    assert!(
        message.contains("36 to 196 frames") && message.contains("found one of 40"),
        "{message}"
    );

    // Other options for MultiModality ask for further motions only.
    let more = EvaluationOptions {
        multimodality: Some(MultimodalityOptions {
            texts: 3,
            motions: 5,
        }),
        ..options.clone()
    };
    let estimates = estimate_publicly(&evaluated, benchmark, &out, &more, &mut ()).unwrap();
    let further: usize = estimates.iter().map(|estimate| estimate.motions).sum();
    assert_eq!(further, 2 * 3);

    // Without an evaluator the rest is there.
    let none = PublicBenchmark {
        evaluator: None,
        split: &split,
    };
    let alone = EvaluationOptions {
        prompts: Some(2),
        repeats: 1,
        methods: Vec::new(),
        ..options
    };
    let out = folder.path().join("alone");
    evaluate_publicly(&evaluated, none, &out, &alone, &mut ()).unwrap();
    let text = fs::read_to_string(out.join("report.md")).unwrap();
    assert!(
        text.contains("| Text alone | – | – | – | – | – | – |"),
        "{text}"
    );
    assert!(text.contains("## The motions themselves"));
}

#[test]
fn captions_without_tokens_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    write_data(&data);
    let evaluate = |device: &Device| {
        let split = BenchmarkSplit::open(&data, Split::Test, &mut |_| ()).unwrap();
        let evaluator = PublicEvaluator::load(&PublicFiles::find(golden()), device).unwrap();
        let normalization =
            Normalization::from_slices(&[0.0; POSE_FEATURES], &[1.0; POSE_FEATURES], device);
        let model = LaMoGen::new(Noise, Tokenizer::clip(77), normalization.unwrap());
        let evaluated = EvaluatedModel {
            model: &model,
            name: "noise",
            fingerprint: "first".into(),
        };
        let benchmark = PublicBenchmark {
            evaluator: Some(&evaluator),
            split: &split,
        };
        let out = folder.path().join("out");
        let options = EvaluationOptions::default();
        let result = evaluate_publicly(&evaluated, benchmark, &out, &options, &mut ());
        assert!(!out.exists());
        result.unwrap_err()
    };
    fs::write(data.join("texts/000007.txt"), "he walks##0.0#0.0\n").unwrap();
    let error = evaluate(&Device::flex());
    assert_eq!(error.kind, EvaluationErrorKind::Input);
    let message = error.to_string();
    assert!(
        message.starts_with("000007: expected tokens") && message.contains("he walks"),
        "{message}"
    );
}

/// The arguments of an evaluation of the embedded model.
fn eval<'a>(more: &[&'a str]) -> Vec<&'a str> {
    const EVAL: [&str; 15] = [
        "eval",
        "--data",
        "data",
        "--evaluator",
        "t2m",
        "--out",
        "out",
        "--prompts",
        "2",
        "--steps",
        "2",
        "--repeats",
        "1",
        "--methods",
        "--studies",
    ];
    [&EVAL[..], more].concat()
}

#[test]
fn a_dry_run_says_which_files_are_missing_and_goes_on() {
    for file in [PublicFile::Network, PublicFile::Std, PublicFile::Words] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        write_data(&folder.join("data"));
        copy_evaluator(&folder.join("t2m"), Some(file));
        let place = file.place();
        fails(
            folder,
            &eval(&[]),
            3,
            &[place, "--partial", "text-to-motion"],
        );
        let (result, notices) = succeeds(folder, &eval(&["--dry-run", "--json"]));
        for part in [place, file.source(), file.needed_for()] {
            assert!(notices.contains(part), "{part}: {notices}");
        }
        let result = json(&result);
        assert_eq!(result["missing_files"][0]["file"], place);
        assert!(result["motions"].as_u64().unwrap() >= 2);
        assert!(!folder.join("out").exists());
    }
}

#[test]
fn what_needs_no_missing_file_is_computed_if_asked() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_data(&folder.join("data"));
    copy_evaluator(&folder.join("t2m"), Some(PublicFile::WordVectors));
    let mut arguments = eval(&["--partial", "--mm-texts", "1", "--mm-motions", "2"]);
    let place = arguments
        .iter()
        .position(|argument| *argument == "2")
        .unwrap();
    arguments[place] = "33";
    let (_, notices) = succeeds(folder, &arguments);
    assert!(notices.contains("36 motions of 36 recordings"), "{notices}");
    let figures = json(&fs::read_to_string(folder.join("out/figures.json")).unwrap());
    let text = &figures["settings"][0];
    assert!(text["fid"]["mean"].is_f64() && text["multimodality"]["mean"].is_f64());
    assert!(text["r_precision"].is_null() && text["matching"].is_null());
}

#[test]
fn statistics_of_the_data_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_data(&folder.join("data"));
    copy_evaluator(&folder.join("t2m"), None);
    let path = folder.join("t2m").join(PublicFile::Std.place());
    let mut std = npy::read(&path).unwrap().values;
    for (feature, value) in std.iter_mut().enumerate() {
        if !(4..259).contains(&feature) {
            *value *= 5.0;
        }
    }
    npy::write(&path, &std, &[std.len()]).unwrap();
    let parts = ["std.npy", "HumanML3D's own", "Comp_v6_KLD01/meta"];
    fails(folder, &eval(&[]), 3, &parts);
    fails(folder, &eval(&["--dry-run"]), 3, &parts);
    // The packed form has 16 bits.
    fs::remove_file(folder.join("data/test.txt")).unwrap();
    fails(
        folder,
        &eval(&[]),
        3,
        &["test.txt", "HumanML3D's own folder"],
    );
}
