//! Whatever a user gets wrong is said clearly, and nothing panics.

mod model_folder;

use std::ops::ControlFlow;
use std::path::Path;

use lamogen::model::Tokenizer;
use lamogen::motion::npy;
use lamogen::{
    Component, Device, Error, Factor, Guidance, LaMoGen, Motion, Pass, Request, Scale, ScaleCurve,
    Tag, TextScale,
};
use serde_json::json;
use tempfile::TempDir;

fn refusal(request: Request) -> String {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let error = model
        .generate(&request)
        .expect_err("the request makes no sense");
    assert!(matches!(error, Error::Request { .. }), "{error}");
    error.to_string()
}

fn says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

fn jump() -> Request {
    Request::new("a person jumps")
        .tag(Tag::Strong)
        .frames(40)
        .steps(5)
}

#[test]
fn an_empty_prompt() {
    for prompt in ["", "  \n\t"] {
        says(&refusal(Request::new(prompt)), &["prompt is empty"]);
    }
}

#[test]
fn a_prompt_longer_than_the_context_is_cut_and_says_so() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let long = Request::new("a person walks and ".repeat(20))
        .frames(40)
        .steps(2);
    assert!(model.generate(&long).unwrap().cut_tokens > 20);
    assert_eq!(model.generate(&jump()).unwrap().cut_tokens, 0);
}

#[test]
fn a_length_that_the_model_cannot_do() {
    for (request, found) in [
        (jump().frames(0), "0 frames"),
        (jump().frames(39), "39 frames"),
        (jump().frames(72_001), "72001 frames"),
        (jump().seconds(0.0), "0 s"),
        (jump().seconds(3601.0), "3601 s"),
        (jump().seconds(-1.0), "-1 s"),
        (jump().seconds(f32::NAN), "NaN s"),
    ] {
        says(
            &refusal(request),
            &[
                "a person jumps",
                "40 to 72000 frames",
                "2.0 to 3600.0 s",
                found,
            ],
        );
    }
}

#[test]
fn no_steps_and_too_many() {
    for steps in [0, 1001, usize::MAX] {
        says(
            &refusal(jump().steps(steps)),
            &["1 to 1000", &steps.to_string()],
        );
    }
}

#[test]
fn tags_that_contradict_each_other() {
    says(
        &refusal(jump().tag(Tag::Light)),
        &["strong", "light", "Weight"],
    );
    says(&refusal(jump().scale(Scale::NEUTRAL)), &["tags or a scale"]);
}

#[test]
fn a_key_past_the_end_of_the_motion() {
    let factor = Factor::parse(Component::Shape, "0:1 2.5:near").unwrap();
    let scale = ScaleCurve::default().with(Component::Shape, factor);
    let walk = Request::new("a person walks").scale(scale);
    says(
        &refusal(walk.frames(50)),
        &["a person walks", "Shape", "2.5 s", "ends at 2.5 s"],
    );
}

#[test]
fn guidance_that_makes_no_sense() {
    let guidance = Guidance {
        learning_rate: f64::NAN,
        ..Guidance::fast()
    };
    says(
        &refusal(jump().guidance(guidance)),
        &["learning rate", "NaN"],
    );
}

#[test]
fn one_bad_request_stops_a_batch_before_its_work() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let mut steps = 0;
    let requests = [jump(), jump().frames(1)];
    let error = model
        .generate_all_with(&requests, &mut |_| {
            steps += 1;
            ControlFlow::Continue(())
        })
        .unwrap_err();
    says(&error.to_string(), &["found 1 frames"]);
    assert_eq!(steps, 0);
    assert!(model.generate_all(&[]).unwrap().is_empty());
}

#[test]
fn a_target_beyond_all_numbers() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let scale = Scale::new([1.0, 1.0, 1.0, 1e30]).unwrap();
    let request = Request::new("a person jumps")
        .scale(scale)
        .frames(40)
        .steps(5);
    let error = model.generate(&request).unwrap_err();
    says(
        &error.to_string(),
        &["a person jumps", "loss of Shape", "step 1 of 5"],
    );
}

#[test]
fn a_stopped_run_returns_what_it_has() {
    let model = LaMoGen::embedded(&Device::flex())
        .unwrap()
        .with_batch_size(1);
    let requests = [jump(), jump().seed(2)];
    let mut seen = Vec::new();
    let mut second = 0;
    let error = model
        .generate_all_with(&requests, &mut |progress| {
            seen.push((progress.done, progress.total));
            let step = progress.step;
            second += usize::from(step.pass == Pass::Guided && step.index == 1);
            match second {
                2 => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        })
        .unwrap_err();
    // For each five steps, a fit of at most 60, five guided steps, a fit of at most 300.
    assert_eq!((seen[0], seen[9]), ((1, 740), (10, 740)));
    assert!(seen.iter().enumerate().all(|(i, (done, _))| *done == i + 1));
    says(
        &error.to_string(),
        &[
            "stopped",
            "step 2 of 5 of the guided pass",
            "1 request was finished",
        ],
    );
    let Error::Stopped(stopped) = error else {
        panic!("{error}");
    };
    assert_eq!((stopped.pass, stopped.index), (Pass::Guided, 1));
    let (place, finished) = &stopped.partial.finished[0];
    assert_eq!((*place, finished.guided.frames()), (0, 40));
    let unfinished = &stopped.partial.unfinished[0];
    assert_eq!(unfinished.request, 1);
    assert_eq!(unfinished.loss.len(), 2);
    assert_eq!(unfinished.baseline.as_ref().unwrap().frames(), 40);
    assert_eq!(unfinished.prediction.as_ref().unwrap().frames(), 40);
}

#[test]
fn a_run_that_is_stopped_in_a_fit_keeps_the_bodies_so_far() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    for fit in [1, 2] {
        let mut begun = 0;
        let error = model.generate_with(&jump(), &mut |progress| {
            let step = progress.step;
            begun += usize::from(step.pass == Pass::Body && step.index == 0);
            match begun == fit && step.pass == Pass::Body && step.index == 3 {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        });
        let error = error.unwrap_err();
        says(
            &error.to_string(),
            &["stopped", "step 4 of", "of the body pass"],
        );
        let Error::Stopped(stopped) = error else {
            panic!("{error}");
        };
        assert_eq!((stopped.pass, stopped.index), (Pass::Body, 3));
        let unfinished = &stopped.partial.unfinished[0];
        let baseline = unfinished.baseline.as_ref().unwrap();
        assert!(baseline.is_rigid() && baseline.frames() == 40);
        let prediction = unfinished.prediction.as_ref();
        assert_eq!(prediction.map(Motion::is_rigid), (fit == 2).then_some(true));
    }
}

#[test]
fn a_failure_keeps_what_was_finished_and_says_where_it_was() {
    let model = LaMoGen::embedded(&Device::flex())
        .unwrap()
        .with_batch_size(1);
    let scale = Scale::new([1.0, 1e30, 1.0, 1.0]).unwrap();
    let hopeless = Request::new("a person bows").scale(scale);
    let requests = [jump(), hopeless.frames(40).steps(5), jump().seed(3)];
    let error = model.generate_all(&requests).unwrap_err();
    says(
        &error.to_string(),
        &["request 2 of 3", "a person bows", "loss of Time"],
    );
    let Error::Failed(failed) = error else {
        panic!("{error}");
    };
    let [(place, finished)] = &failed.partial.finished[..] else {
        panic!("one request was finished before");
    };
    assert_eq!((*place, finished.guided.frames()), (0, 40));
    let unfinished = &failed.partial.unfinished[0];
    assert_eq!(unfinished.request, 1);
    assert_eq!(unfinished.baseline.as_ref().unwrap().frames(), 40);
}

#[test]
fn a_prompt_of_special_tokens_is_text() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let special = Request::new("<|endoftext|>").frames(40).steps(2);
    let jump = Request::new("<|endoftext|> a person jumps")
        .frames(40)
        .steps(2);
    let [special, jump] = [special, jump].map(|request| model.generate(&request).unwrap());
    assert_ne!(special.baseline, jump.baseline);
}

/// The embedded model as a user's folder.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    model_folder::write(folder.path());
    folder
}

fn load(folder: &Path) -> Result<LaMoGen, String> {
    LaMoGen::load(folder, &Device::flex()).map_err(|error| error.to_string())
}

#[test]
fn a_whole_folder_is_the_embedded_model() {
    let folder = folder();
    let embedded = LaMoGen::embedded(&Device::flex()).unwrap();
    // Its config says how it is best sampled.
    let loaded = load(folder.path()).unwrap();
    assert!(loaded.temporal_smoothing().is_some());
    assert_eq!(loaded.temporal_smoothing(), embedded.temporal_smoothing());
    assert_eq!(loaded.preset(), lamogen::Preset::Precise);
    assert_eq!(loaded.preset(), embedded.preset());
    assert_eq!(loaded.licence(), embedded.licence());
    let request = jump().preset(lamogen::Preset::Fast).steps(5);
    let [loaded, embedded] = [loaded, embedded].map(|model| model.generate(&request).unwrap());
    assert_eq!(loaded.guided, embedded.guided);
}

#[test]
fn how_a_model_is_sampled_has_to_make_sense() {
    let folder = folder();
    let path = folder.path().join("config.json");
    let config: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let with = |sampling: serde_json::Value| {
        let mut config = config.clone();
        config["sampling"] = sampling;
        std::fs::write(&path, config.to_string()).unwrap();
        load(folder.path())
    };
    let model =
        with(json!({ "preset": "fast", "temporal_smoothing": 0, "text_scale": 2.5, "text_scale_until": 5 })).unwrap();
    assert_eq!(model.preset(), lamogen::Preset::Fast);
    let text_scale = TextScale {
        scale: 2.5,
        until: 5,
    };
    assert_eq!(
        (model.temporal_smoothing(), model.text_scale()),
        (None, text_scale)
    );
    // Without any it is what it was for MotionDiffuse's own.
    for nothing in [json!(null), json!({})] {
        let model = with(nothing).unwrap();
        assert_eq!(model.preset(), lamogen::Preset::Paper);
        assert_eq!(
            (model.temporal_smoothing(), model.text_scale()),
            (None, TextScale::default())
        );
    }
    for (sampling, part) in [
        (
            json!({ "preset": "exact" }),
            "expected a preset (precise, fast, paper), found `exact`",
        ),
        (json!({ "temporal_smoothing": -1 }), "sampling: "),
        (json!({ "text_scale": -2 }), "sampling: "),
        (
            json!({ "text_scale": 2, "text_scale_until": 1000 }),
            "expected a text scale until a timestep below 1000",
        ),
        (
            json!({ "stand_in": "  " }),
            "expected a sentence as stand_in, found an empty text",
        ),
        (json!({ "smoothing": 1 }), "unknown field `smoothing`"),
    ] {
        let error = with(sampling).err().unwrap();
        assert!(
            error.contains("config.json") && error.contains(part),
            "{error}"
        );
    }
}

#[test]
fn motion_diffuses_folders_are_known() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("meta")).unwrap();
    for name in ["mean.npy", "std.npy"] {
        let (from, to) = (
            folder.path().join(name),
            folder.path().join("meta").join(name),
        );
        std::fs::rename(from, to).unwrap();
    }
    load(folder.path()).unwrap();
}

#[test]
fn a_prompt_that_is_cleaned_away() {
    // CLIP's tokenizer turns references of HTML into characters and drops white space.
    let clip = Tokenizer::clip(32);
    let network = LaMoGen::embedded(&Device::flex()).unwrap();
    let model = LaMoGen::new(
        network.network().clone(),
        clip,
        network.normalization().clone(),
    );
    for prompt in ["&nbsp;", "&nbsp; \u{a0}", "\u{7}"] {
        let error = model.generate(&Request::new(prompt)).unwrap_err();
        says(&error.to_string(), &["the prompt is empty"]);
    }
}

#[test]
fn what_no_shape_tells_is_not_guessed() {
    // The embedded model has other heads than MotionDiffuse and predicts motion: without its config
    // it would run, and be wrong.
    let folder = folder();
    std::fs::remove_file(folder.path().join("config.json")).unwrap();
    says(
        &load(folder.path()).err().unwrap(),
        &["config.json", "49408", "12288"],
    );
}

#[test]
fn a_missing_file_is_named() {
    for name in ["config.json", "tokenizer.json", "mean.npy", "std.npy"] {
        let folder = folder();
        std::fs::remove_file(folder.path().join(name)).unwrap();
        says(&load(folder.path()).err().unwrap(), &[name, "No such file"]);
    }
    let folder = folder();
    std::fs::remove_file(folder.path().join("model.safetensors")).unwrap();
    let message = load(folder.path()).err().unwrap();
    says(
        &message,
        &[
            "model.safetensors, latest.tar or model/latest.tar",
            "found config.json, mean.npy",
        ],
    );
    says(
        &load(Path::new("no/such/folder")).err().unwrap(),
        &["no/such/folder", "no folder that can be read"],
    );
}

#[test]
fn a_truncated_checkpoint_and_one_that_is_none() {
    let folder = folder();
    let path = folder.path().join("model.safetensors");
    std::fs::write(&path, &lamogen_compact::WEIGHTS[..1_000_000]).unwrap();
    says(
        &load(folder.path()).err().unwrap(),
        &["model.safetensors", "ends within"],
    );
    std::fs::remove_file(path).unwrap();
    std::fs::write(folder.path().join("latest.tar"), "not weights").unwrap();
    says(
        &load(folder.path()).err().unwrap(),
        &["latest.tar", "not a readable checkpoint"],
    );
}

#[test]
fn weights_of_other_sizes_than_the_config() {
    let folder = folder();
    let config = String::from_utf8(lamogen_compact::CONFIG.to_vec()).unwrap();
    let wider = config.replace("\"ff_size\": 256", "\"ff_size\": 512");
    assert_ne!(config, wider);
    std::fs::write(folder.path().join("config.json"), wider).unwrap();
    let message = load(folder.path()).err().unwrap();
    says(
        &message,
        &[
            "model.safetensors",
            "linear1.weight",
            "[256, 128]",
            "[512, 128]",
        ],
    );
    let other = config.replace("\"input_feats\": 263", "\"input_feats\": 251");
    std::fs::write(folder.path().join("config.json"), other).unwrap();
    says(
        &load(folder.path()).err().unwrap(),
        &["config.json", "263", "251"],
    );
}

#[test]
fn a_tokenizer_with_ids_beyond_the_embedding() {
    let folder = folder();
    let config = String::from_utf8(lamogen_compact::CONFIG.to_vec()).unwrap();
    let smaller = config.replace("\"vocab_size\": 12288", "\"vocab_size\": 12000");
    std::fs::write(folder.path().join("config.json"), smaller).unwrap();
    says(
        &load(folder.path()).err().unwrap(),
        &["tokenizer.json", "12287", "11999"],
    );
}

#[test]
fn statistics_of_another_length_or_without_sense() {
    let folder = folder();
    let path = folder.path().join("std.npy");
    for (values, parts) in [
        (vec![1.0; 251], ["std.npy", "263", "251"]),
        (
            vec![0.0; 263],
            ["std.npy", "feature 0 (root yaw)", "found 0"],
        ),
        (vec![f32::NAN; 263], ["std.npy", "above 0", "NaN"]),
    ] {
        npy::write(&path, &values, &[values.len()]).unwrap();
        says(&load(folder.path()).err().unwrap(), &parts);
    }
}

#[test]
fn a_folder_that_cannot_be_written_to() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let result = model.generate(&jump()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file.txt");
    std::fs::write(&file, "in the way").unwrap();
    let error = result
        .guided
        .save_joints(file.join("jump.npy"))
        .unwrap_err();
    says(&error.to_string(), &["file.txt", "jump.npy"]);
    let error = lamogen_view::save(file.join("strip.svg"), "<svg/>").unwrap_err();
    says(&error.to_string(), &["file.txt", "strip.svg"]);
}
