//! `lamogen eval` as people and scripts use it.

mod running;
mod swings;

use std::fs;
use std::path::Path;

use burn::tensor::Tensor;
use lamogen::model::{Denoiser, DenoiserInput, Prediction, Prompt, TokenBatch, Tokenizer};
use lamogen::motion::POSE_FEATURES;
use lamogen::{Device, LaMoGen};
use lamogen_data::{Dataset, LoadOptions, Split};
use lamogen_eval::Evaluator;
use lamogen_evaluation::{
    EvaluatedModel, Evaluation, EvaluationErrorKind, EvaluationObserver, EvaluationOptions, Method,
    accepted_lengths, estimate, evaluate,
};
use running::{fails, succeeds};
use serde_json::Value;

#[test]
fn the_embedded_model_takes_everyday_sentences_as_they_are() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    for sentence in lamogen_eval::truth::sentences() {
        assert_eq!(model.stand_in(&sentence.text), None, "{}", sentence.text);
    }
}

/// A data set, and an evaluator that has hardly learned anything.
fn prepare(folder: &Path) {
    swings::data(folder);
    swings::evaluator(folder);
    let train = [
        "train",
        "--evaluator",
        "--data",
        "data",
        "--config",
        "judge.json",
    ];
    let rest = ["--steps", "2", "--out", "judge"];
    succeeds(folder, &[&train[..], &rest].concat());
}

fn eval<'a>(more: &[&'a str]) -> Vec<&'a str> {
    const EVAL: [&str; 16] = [
        "eval",
        "--data",
        "data",
        "--evaluator",
        "judge/model",
        "--split",
        "train",
        "--prompts",
        "3",
        "--steps",
        "3",
        "--noise-steps",
        "1",
        "--study-prompts",
        "2",
        "--json",
    ];
    [&EVAL[..], more].concat()
}

const FEW: [&str; 4] = ["--methods", "laban,prompt", "--studies", "update"];

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn real_motions_are_held_against_real_motions_of_other_sentences() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let fid = |prompts| {
        let options = "eval --data data --evaluator judge/model --split train --steps 2 --methods text --studies --json --out";
        let mut args: Vec<&str> = options.split(' ').collect();
        args.extend([prompts, "--prompts", prompts]);
        succeeds(folder, &args);
        let figures = fs::read_to_string(folder.join(prompts).join("figures.json")).unwrap();
        json(&figures)["real_motions"]["fid"]["mean"].as_f64()
    };
    let value = fid("2").expect("the validation split has two motions");
    assert!(value > 1e-3 && value.is_finite(), "{value}");
    assert_eq!(fid("3"), None, "there are not as many others");
}

#[test]
fn a_report_has_the_papers_tables_and_the_ablations() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let more = [
        "--studies",
        "interpolation,pareto-front,presets,learning-rate,finish,divisor",
        "--out",
        "evidence",
        "--methods",
        "laban,prompt,raw,classifier",
    ];
    let (result, _) = succeeds(folder, &eval(&more));
    assert_eq!(json(&result)["missing"], 0, "{result}");
    let out = folder.join("evidence");
    let text = fs::read_to_string(out.join("report.md")).unwrap();
    for part in [
        "## Control",
        "| Laban guidance | Weight |",
        "(0.978)",
        "| Prompt editing | 0",
        "## Text and fidelity",
        "| Real motions |",
        "(`--measure rig`)",
        "| bone drift | below floor | turning | largest turn | pelvis snaps |",
        "## What stays, and the worst motion",
        "| Prompt editing | 0",
        "|  |  |  | free |",
        "## Scale interpolation",
        "| asked | 0.5 | 0.8 | 1 | 1.2 | 1.5 |",
        "## The studies",
        "over 2 of the sentences",
        "## Exactness against selectivity",
        "| modulation, emphasis 10 |",
        "| modulation with a finish, emphasis 10 |",
        "| start noise |",
        "| text alone | – | – | – |",
        "## Presets",
        "| paper, 3 steps |",
        "## Learning rate",
        "it goes to 4 times that",
        "| learning rate 0.5 |",
        "![Laban error, by learning rate](pictures/laban-error-by-learning-rate.svg)",
        "## Updates of the finished motion",
        "| 100 without guidance |",
        "## What the loss divides by",
        "| raw frame update, by the mean over time |",
        "## What smoothing does",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    let pictures = text.matches("![").count();
    assert!(pictures >= 9, "{pictures}");
    assert_eq!(page.matches("<figure>").count(), pictures);
    for name in text
        .split("](")
        .skip(1)
        .map(|rest| rest.split(')').next().unwrap())
    {
        let picture = fs::read_to_string(out.join(name)).unwrap();
        assert!(picture.contains("</svg>"), "{name}");
    }
    let figures = json(&fs::read_to_string(out.join("figures.json")).unwrap());
    let settings = figures["settings"].as_array().unwrap();
    let laban = settings
        .iter()
        .find(|setting| setting["setting"] == "laban");
    let laban = laban.unwrap();
    assert_eq!(laban["motions"], 3 * 8);
    assert!(laban["distance"]["interval"].is_null(), "of one repeat");
    assert!(laban["diversity"]["mean"].as_f64().unwrap() > 0.0);
    assert_eq!(figures["Scale interpolation"][1]["asked"], 0.8);
    assert!(laban["control"]["diagonality"].as_f64().unwrap() > 0.0);
    // What is measured is a rig.
    assert!(laban["drift"]["mean"].as_f64().unwrap() < 1e-4);
    let turning = &laban["turning"];
    for path in ["/mean/mean", "/pelvis/mean", "/spine3/largest/mean"] {
        let degrees = turning.pointer(path).and_then(Value::as_f64).unwrap();
        assert!((1e-3..=180.0).contains(&degrees), "{path}: {degrees}");
    }
    assert!(turning["pelvis_snaps"].is_u64());
    assert!(figures["real_motions"]["turning"]["neck"]["mean"]["mean"].is_f64());
    let worst = laban["worst"].as_array().unwrap();
    assert_eq!(worst.len(), 8);
    assert_eq!(worst[1]["demand"], "strong");
    assert!(worst[1]["prompt"].as_str().unwrap().contains("swing"));
    let [ratio, share] = ["ratio", "share"].map(|name| worst[1][name].as_f64().unwrap());
    assert!((share - (ratio - 1.0) / 0.5).abs() < 1e-9, "{share}");
    let most = laban["stays"]["most"].as_f64().unwrap();
    assert!(most >= 0.0 && laban["stays"]["mean"]["mean"].is_f64());
    // The same noise, so text alone is where guidance begins.
    let text = settings.iter().find(|setting| setting["setting"] == "text");
    assert_eq!(text.unwrap()["distance"]["mean"], 0.0);
}

#[test]
fn motions_are_measured_on_their_joints_if_asked_and_never_in_the_same_folder() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let few = ["--methods", "laban", "--studies"];
    let run = |more: &[&'static str]| eval(&[&few[..], more].concat());
    let figures =
        |out: &str| json(&fs::read_to_string(folder.join(out).join("figures.json")).unwrap());
    succeeds(folder, &run(&["--out", "rig"]));
    succeeds(folder, &run(&["--out", "joints", "--measure", "joints"]));
    let [rig, joints] = ["rig", "joints"].map(figures);
    let text = fs::read_to_string(folder.join("joints/report.md")).unwrap();
    assert!(text.contains("(`--measure joints`)"), "{text}");
    let number =
        |figures: &Value, path: &str| figures.pointer(path).and_then(Value::as_f64).unwrap();
    for motions in ["/settings/0", "/settings/1", "/real_motions"] {
        // Bones of a rig keep their length, generated ones in their joints too; what turns is that of the rig for both.
        let [rig_drift, drift] =
            [&rig, &joints].map(|f| number(f, &format!("{motions}/drift/mean")));
        let is_real = motions == "/real_motions";
        assert!(
            rig_drift < 1e-4 && (drift > 1e-3) == is_real,
            "{motions}: {rig_drift}, {drift}"
        );
        let [rig, joints] =
            [&rig, &joints].map(|f| number(f, &format!("{motions}/turning/mean/mean")));
        assert!((rig - joints).abs() < 1e-2, "{motions}: {rig}, {joints}");
    }
    let other = run(&["--out", "rig", "--measure", "joints"]);
    let differs = "another run: measure is \"rig\", now \"joints\"\n";
    fails(folder, &other, 2, &[differs]);
}

#[test]
fn a_run_goes_on_and_shards_make_the_same_report() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let run = |more: &[&'static str]| {
        let all = [&FEW[..], more].concat();
        json(&succeeds(folder, &eval(&all)).0)
    };
    let whole = run(&["--out", "whole"]);
    let motions = whole["motions"].as_u64().unwrap();
    // Text alone, two methods with eight tags, and a lagged update with as many; immediate ones are laban's own.
    assert_eq!(motions, 3 + 2 * 3 * 8 + 2 * 8);
    let read = |name: &str| fs::read(folder.join(name)).unwrap();
    let figures = read("whole/figures.json");

    // Stopped in the middle of a line.
    let records = read("whole/records.jsonl");
    fs::write(
        folder.join("whole/records.jsonl"),
        &records[..records.len() / 2],
    )
    .unwrap();
    assert_eq!(run(&["--out", "whole"])["motions"], motions);
    assert_eq!(
        read("whole/records.jsonl")
            .split(|byte| *byte == b'\n')
            .count() as u64,
        motions + 1
    );

    // Made with other options of the same name: made again.
    let records = read("whole/records.jsonl");
    let text = String::from_utf8(records.clone()).unwrap();
    let options = text.split("\"options\":\"").nth(1).unwrap();
    let options = options.split('"').next().unwrap();
    let others = text.replace(options, "0123456789abcdef");
    let with = text.matches(options).count();
    fs::write(folder.join("whole/records.jsonl"), others).unwrap();
    let left = run(&["--out", "whole", "--dry-run"]);
    assert_eq!(left["motions"], with as u64);
    run(&["--out", "whole"]);
    let lines = read("whole/records.jsonl")
        .split(|byte| *byte == b'\n')
        .count();
    assert_eq!(lines as u64, motions + with as u64 + 1);
    assert!(read("whole/figures.json") == figures);

    let first = run(&["--out", "parts", "--shard", "1/2"]);
    let missing = first["missing"].as_u64().unwrap();
    assert!(0 < missing && missing < motions, "{first}");
    assert!(!folder.join("parts/report.md").exists());
    assert_eq!(run(&["--out", "parts", "--merge"])["missing"], missing);
    let text = String::from_utf8(read("parts/report.md")).unwrap();
    assert!(text.contains("are not made yet"), "{text}");
    run(&["--out", "parts", "--shard", "2/2"]);
    assert_eq!(run(&["--out", "parts", "--merge"])["missing"], 0);
    assert!(
        read("parts/figures.json") == figures,
        "shards make other figures"
    );
}

#[test]
fn what_goes_wrong_has_a_code_and_a_reason_and_a_dry_run_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let with = |more: &[&'static str]| eval(&[&FEW[..], more].concat());
    let (estimate, _) = succeeds(folder, &with(&["--out", "x", "--dry-run"]));
    let estimate = json(&estimate);
    assert_eq!(estimate["motions"], 3 + 2 * 3 * 8 + 2 * 8);
    assert!(estimate["seconds"].as_f64().unwrap() > 0.0);
    assert!(!folder.join("x").exists());

    succeeds(folder, &with(&["--out", "x"]));
    let other = with(&["--out", "x", "--preset", "paper"]);
    let differs = "preset is \"precise\", now \"paper\"";
    fails(folder, &other, 2, &[differs, "another --out"]);
    let other = [&other[..], &["--dry-run"]].concat();
    fails(folder, &other, 2, &[differs]);
    let with_prompts = |count: &'static str, more: &[&'static str]| {
        let mut all = with(more);
        let place = all.iter().position(|word| *word == "--prompts").unwrap();
        all[place + 1] = count;
        all
    };
    let other = with_prompts("2", &["--out", "x", "--merge"]);
    fails(
        folder,
        &other,
        2,
        &["prompts is 3, now 2", "options of the run"],
    );
    fs::write(folder.join("file"), "{").unwrap();
    fails(folder, &with(&["--out", "file"]), 4, &["expected a folder"]);
    let whole = fs::read(folder.join("x/eval.json")).unwrap();
    fs::remove_file(folder.join("x/eval.json")).unwrap();
    for more in [&["--out", "x"][..], &["--out", "x", "--dry-run"]] {
        fails(folder, &with(more), 3, &["eval.json", "beside the records"]);
    }
    fs::write(folder.join("x/eval.json"), "{").unwrap();
    fails(folder, &with(&["--out", "x"]), 3, &["eval.json", "EOF"]);
    fs::write(folder.join("x/eval.json"), whole).unwrap();
    let mut records = fs::read(folder.join("x/records.jsonl")).unwrap();
    records.splice(0..1, *b"[");
    fs::write(folder.join("x/records.jsonl"), records).unwrap();
    fails(folder, &with(&["--out", "x"]), 3, &["line 1 is no record"]);

    fails(
        folder,
        &with(&["--out", "y", "--shard", "3/2"]),
        2,
        &["--shard"],
    );
    fails(
        folder,
        &with(&["--out", "y", "--methods", "magic"]),
        2,
        &["magic"],
    );
    let nobody = [
        "eval",
        "--data",
        "data",
        "--evaluator",
        "nobody",
        "--out",
        "y",
    ];
    fails(folder, &nobody, 3, &["nobody", "lamogen train --evaluator"]);
    // A dry run names all folders that are missing at once.
    let mut lost = with(&["--out", "y", "--dry-run", "--model", "no-model"]);
    for (option, name) in [("--data", "no-data"), ("--evaluator", "no-evaluator")] {
        let place = lost.iter().position(|word| *word == option).unwrap();
        lost[place + 1] = name;
    }
    let parts = [
        "missing: the model, no-model",
        "missing: the data, no-data",
        "missing: the evaluator, no-evaluator",
        "nothing can be estimated without no-model, no-data, no-evaluator",
    ];
    fails(folder, &lost, 3, &parts);
    let alone = with_prompts("1", &["--out", "y"]);
    fails(folder, &alone, 2, &["expected at least 2 sentences"]);
    let none = [
        "eval",
        "--data",
        "data",
        "--evaluator",
        "judge/model",
        "--out",
        "y",
        "--split",
        "test",
    ];
    fails(folder, &none, 3, &["at least 2 motions", "test split"]);
    let merge = with(&["--out", "y", "--merge"]);
    fails(folder, &merge, 3, &["eval.json", "beside the records"]);
    assert!(!folder.join("y").exists());
}

/// A network of one's own: what it sees, smoothed, and a swing as large as its sentence is long.
struct Pendulum;

impl Denoiser for Pendulum {
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
        let [_, frames, _] = input.x_t.dims();
        let swing = (0..frames * POSE_FEATURES).map(|i| {
            let (frame, feature) = (i / POSE_FEATURES, i % POSE_FEATURES);
            (0.3 * frame as f32 + feature as f32).sin()
        });
        let swing: Vec<f32> = swing.collect();
        let swing = Tensor::<1>::from_floats(&swing[..], &self.device());
        let swing = swing.reshape([1, frames, POSE_FEATURES]);
        input.x_t.tanh() * 0.1 + swing * input.embedding.unsqueeze_dim::<3>(2)
    }
}

#[derive(Default)]
struct Watch {
    notices: Vec<String>,
    progress: Vec<(usize, usize)>,
}

impl EvaluationObserver for Watch {
    fn notice(&mut self, text: &str) {
        self.notices.push(text.to_owned());
    }

    fn progress(&mut self, done: usize, total: usize, _: &str) {
        self.progress.push((done, total));
    }
}

#[test]
fn any_network_can_be_evaluated_by_a_program() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let device = Device::flex();
    let evaluator = Evaluator::load(folder.join("judge/model"), &device).unwrap();
    let lengths = accepted_lengths(&Pendulum, &evaluator);
    let limits = LoadOptions {
        min_frames: *lengths.start(),
        ..LoadOptions::default()
    };
    let dataset = Dataset::open(folder.join("data"), &limits, &mut |_| ()).unwrap();
    let normalization = dataset.normalization(&device);
    let model = LaMoGen::new(Pendulum, Tokenizer::clip(77), normalization);
    let evaluated = |fingerprint: &str| EvaluatedModel {
        model: &model,
        name: "a pendulum",
        fingerprint: fingerprint.to_owned(),
    };
    let options = EvaluationOptions {
        split: Split::Train,
        prompts: Some(2),
        steps: Some(3),
        methods: vec![Method::Laban],
        studies: Vec::new(),
        ..EvaluationOptions::default()
    };
    let out = folder.join("evidence");
    let run = |fingerprint: &str, options: &EvaluationOptions, watch: &mut Watch| {
        let model = evaluated(fingerprint);
        evaluate(&model, &evaluator, &dataset, &out, options, watch)
    };

    let estimates = estimate(
        &evaluated("first"),
        &evaluator,
        &dataset,
        &out,
        &options,
        &mut (),
    );
    let motions: usize = estimates.unwrap().iter().map(|e| e.motions).sum();
    assert!(motions > 2 && !out.exists());

    let half = EvaluationOptions {
        shard: Some((1, 2)),
        ..options.clone()
    };
    let mut watch = Watch::default();
    let first = run("first", &half, &mut watch).unwrap();
    assert_eq!(first.motions, motions);
    assert!(first.missing > 0 && first.files.is_empty());
    assert!(watch.notices[0].contains("for other shards"));

    let mut watch = Watch::default();
    let whole = run("first", &options, &mut watch).unwrap();
    let files = ["report.md", "report.html", "figures.json"].map(|name| out.join(name));
    let expected = Evaluation {
        motions,
        missing: 0,
        files: files.to_vec(),
    };
    assert_eq!(whole, expected);
    assert_eq!(watch.progress.last(), Some(&(first.missing, first.missing)));
    let text = fs::read_to_string(&files[0]).unwrap();
    assert!(
        text.contains("# Report on a pendulum") && text.contains("| Laban guidance | Weight |"),
        "{text}"
    );

    // Records of other weights are no records of these.
    let error = run("second", &options, &mut Watch::default()).unwrap_err();
    assert_eq!(error.kind, EvaluationErrorKind::Options);
    assert!(
        error
            .to_string()
            .contains("model is \"first\", now \"second\""),
        "{error}"
    );
}
