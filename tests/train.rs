//! `lamogen train` as people and scripts use it.

mod running;
mod swings;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use lamogen::model::AnyConfig;
use lamogen::motion::npy;
use lamogen::{Device, LaMoGen, Request};
use serde_json::Value;
use swings::data;

fn succeeds(folder: &Path, arguments: &[&str]) -> (String, String) {
    running::succeeds(folder, &[&["train"], arguments].concat())
}

/// Makes one step of some; only the last one finishes the run.
fn sits(folder: &Path, arguments: &[&str], is_last: bool) -> String {
    let code = if is_last { 0 } else { 6 };
    running::ends(folder, &[&["train"], arguments].concat(), code).0
}

fn fails(folder: &Path, arguments: &[&str], code: i32, parts: &[&str]) {
    running::fails(folder, &[&["train"], arguments].concat(), code, parts);
}

const RUN: [&str; 6] = ["--data", "data", "--config", "tiny.json", "--out", "run"];

fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&RUN[..], more].concat()
}

#[test]
fn a_run_leaves_a_model_that_generates_with_its_losses_and_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    let more = [
        "--steps",
        "8",
        "--validate-every",
        "4",
        "--license",
        "CC0-1.0",
        "--json",
    ];
    let (result, notices) = succeeds(folder, &with(&more));
    let result: Value = serde_json::from_str(&result).unwrap();
    assert_eq!(
        (&result["finished"], &result["step"]),
        (&true.into(), &8.into())
    );
    assert!(result["best_validation_loss"].as_f64().unwrap() > 0.0);
    assert!(
        notices.contains("8 motions") && notices.contains("step 4/8"),
        "{notices}"
    );
    for name in [
        "losses.svg",
        "samples/step-00000004.svg",
        "samples/step-00000008.svg",
    ] {
        let picture = fs::read_to_string(folder.join("run").join(name)).unwrap();
        assert!(picture.contains("</svg>"), "{name}");
    }
    let losses = fs::read_to_string(folder.join("run/losses.jsonl")).unwrap();
    assert_eq!(losses.lines().count(), 8 + 2);
    for name in ["model", "best"] {
        let model = LaMoGen::load(folder.join("run").join(name), &Device::flex()).unwrap();
        assert_eq!(model.licence().unwrap().name, "CC0-1.0");
        let request = Request::new("a person swings").seconds(2.5).steps(5);
        assert_eq!(model.generate(&request).unwrap().guided.frames(), 50);
    }
    // Asked again, there is nothing to do.
    let (again, _) = succeeds(folder, &with(&more));
    assert_eq!(serde_json::from_str::<Value>(&again).unwrap()["step"], 8);
}

#[test]
fn an_mdm_is_trained_and_generates() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    let recipe = serde_json::json!({
        "model": {
            "arch": "trans_enc", "layers": 1, "latent_dim": 16, "ff_size": 24, "diffusion_steps": 20,
            "clip": { "vocab_size": 300, "context_length": 10, "width": 64, "heads": 1, "layers": 1 },
        },
        "denoising": { "frames_per_batch": 200, "text_dropout": 0.1 },
    });
    fs::write(folder.join("mdm.json"), recipe.to_string()).unwrap();
    let train = ["--data", "data", "--config", "mdm.json", "--out", "run"];
    let more = ["--steps", "4", "--license", "CC0-1.0"];
    let (result, _) = succeeds(folder, &[&train[..], &more].concat());
    assert!(result.contains("after 4 steps"), "{result}");
    let strips = folder.join("run/samples/step-00000004.svg");
    assert!(fs::read_to_string(strips).unwrap().contains("</svg>"));
    let model = LaMoGen::load(folder.join("run/model"), &Device::flex()).unwrap();
    assert!(matches!(model.config(), AnyConfig::Mdm(config) if config.ff_size == 24));
    assert_eq!(model.licence().unwrap().name, "CC0-1.0");
    assert_eq!(
        (
            model.text_scale().scale,
            model.default_steps(model.preset())
        ),
        (2.5, 20)
    );
    assert!(model.known_words().is_some());
    let arguments = ["generate", "a person swings", "--model", "run/model"];
    let more = [
        "--weight",
        "strong",
        "--seconds",
        "2",
        "--out",
        "motion.npy",
    ];
    running::succeeds(folder, &[&arguments[..], &more].concat());
    assert!(folder.join("motion.npy").exists());

    let from = ["--from", "run/model", "--steps", "2"];
    let other = ["--data", "data", "--config", "mdm.json", "--out", "other"];
    fails(
        folder,
        &[&other[..], &from].concat(),
        3,
        &["run/model", "MDM"],
    );
    let embedded = ["--from", "embedded", "--steps", "2"];
    fails(
        folder,
        &[&other[..], &embedded].concat(),
        2,
        &["--from", "MDM"],
    );
}

#[test]
fn sittings_go_on_where_the_last_one_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    let more = ["--steps", "3", "--time-limit", "0"];
    for step in 1..3 {
        let result = sits(folder, &with(&more), false);
        assert!(
            result.contains(&format!("stopped after step {step}")),
            "{result}"
        );
    }
    let (result, _) = succeeds(folder, &with(&more));
    assert!(result.contains("after 3 steps"), "{result}");
}

#[test]
#[cfg(unix)]
fn an_interrupt_leaves_a_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    let more = ["--steps", "1000000", "--quiet", "--json"];
    let mut command = running::lamogen(folder, &[&["train"], &with(&more)[..]].concat());
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = child.spawn().unwrap();
    let losses = folder.join("run/losses.jsonl");
    let start = Instant::now();
    while fs::metadata(&losses).map_or(0, |file| file.len()) == 0 {
        assert!(
            start.elapsed() < Duration::from_secs(120),
            "no step was made"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    let killed = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(killed.unwrap().success());
    let output = child.wait_with_output().unwrap();
    // A code of its own, so that nothing goes on with half a model.
    assert_eq!(output.status.code(), Some(6));
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["finished"], false);
    let step = result["step"].as_u64().unwrap();
    assert!(
        folder
            .join(format!("run/checkpoints/step-{step:08}/state.json"))
            .exists()
    );
}

#[test]
fn a_model_is_trained_further_with_what_it_knows() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    succeeds(folder, &with(&["--steps", "4", "--license", "CC0-1.0"]));
    // Other data, with other statistics and words.
    for place in 0..10 {
        let name = folder.join(format!("data/texts/{place:06}.txt"));
        fs::write(name, "somebody turns#turn/VERB#0.0#0.0\n").unwrap();
    }
    for place in 0..4 {
        let name = folder.join(format!("data/new_joint_vecs/{place:06}.npy"));
        let array = npy::read(&name).unwrap();
        let louder: Vec<f32> = array.values.iter().map(|value| 3.0 * value).collect();
        npy::write(&name, &louder, &array.shape).unwrap();
    }
    let further = |out, more: &[&'static str]| {
        let all = ["--data", "data", "--from", "run/model", "--steps", "3"];
        [&all[..], &["--out", out], more].concat()
    };
    // The recipe that comes with the program has other sizes: those of the model count.
    succeeds(folder, &further("whole", &[]));
    for step in 0..3 {
        sits(folder, &further("parts", &["--time-limit", "0"]), step == 2);
    }
    let file = |run: &str, name: &str| fs::read(folder.join(run).join("model").join(name)).unwrap();
    for name in ["config.json", "tokenizer.json", "mean.npy", "std.npy"] {
        assert!(file("run", name) == file("whole", name), "{name} differs");
    }
    let weights = ["run", "whole", "parts"].map(|run| file(run, "model.safetensors"));
    assert!(weights[0] != weights[1], "nothing was learned");
    assert!(weights[1] == weights[2], "a stop changed the weights");
    let load = |run: &str| LaMoGen::load(folder.join(run).join("model"), &Device::flex()).unwrap();
    assert_eq!(load("whole").licence().unwrap().name, "CC0-1.0");
    // Three steps away from where it began, and far from a fresh network's.
    let request = Request::new("a person swings").seconds(2.5).steps(5);
    let motion = |run: &str| load(run).generate(&request).unwrap().guided;
    let fresh = ["--data", "data", "--config", "tiny.json", "--steps", "3"];
    succeeds(folder, &[&fresh[..], &["--out", "fresh"]].concat());
    let [near, far] = ["whole", "fresh"].map(|other| motion("run").distance(&motion(other)));
    assert!(near < far, "{near} is not below {far}");

    let other = [&fresh[..], &["--out", "whole"]].concat();
    fails(folder, &other, 2, &["whole", "expected"]);
    let config = fs::read_to_string(folder.join("tiny.json")).unwrap();
    let wide = config.replace("\"ff_size\":24", "\"ff_size\":32");
    assert_ne!(config, wide);
    fs::write(folder.join("wide.json"), wide).unwrap();
    let wide = further("x", &["--config", "wide.json"]);
    fails(folder, &wide, 2, &["ff_size = 32", "ff_size = 24"]);
    let nowhere = [
        "--data", "data", "--from", "nowhere", "--steps", "3", "--out", "x",
    ];
    fails(folder, &nowhere, 3, &["nowhere"]);
}

#[test]
fn minutes_become_steps() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    let (result, _) = succeeds(folder, &with(&["--minutes", "0.02", "--json"]));
    let result: Value = serde_json::from_str(&result).unwrap();
    assert_eq!(result["finished"], true);
    assert!(result["step"].as_u64().unwrap() >= 50);
    assert_eq!(result["step"], result["steps"]);
}

#[test]
fn what_goes_wrong_has_a_code_and_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    fails(folder, &RUN, 2, &["--steps"]);
    let steps = ["--steps", "2"];
    fs::write(folder.join("broken.json"), "{\"model\": 3}").unwrap();
    let broken = [
        "--data",
        "data",
        "--config",
        "broken.json",
        "--out",
        "x",
        "--steps",
        "2",
    ];
    fails(folder, &broken, 2, &["broken.json", "hint"]);
    let none = [
        "--data",
        "data",
        "--config",
        "none.json",
        "--out",
        "x",
        "--steps",
        "2",
    ];
    fails(folder, &none, 3, &["none.json"]);
    let nowhere = [
        "--data",
        "nowhere",
        "--config",
        "tiny.json",
        "--out",
        "x",
        "--steps",
        "2",
    ];
    fails(folder, &nowhere, 3, &["nowhere"]);
    let tokenizer = with(&["--steps", "2", "--tokenizer", "none.json"]);
    fails(folder, &tokenizer, 3, &["none.json"]);
    // A run of another length in the same folder.
    succeeds(folder, &with(&steps));
    fails(folder, &with(&["--steps", "3"]), 2, &["2 steps", "3 steps"]);
    // A network that is made for longer motions than there are.
    let config = fs::read_to_string(folder.join("tiny.json")).unwrap();
    let long = config.replace("\"num_frames\":60", "\"num_frames\":900,\"min_frames\":800");
    assert_ne!(config, long);
    fs::write(folder.join("long.json"), long).unwrap();
    let long = [
        "--data",
        "data",
        "--config",
        "long.json",
        "--out",
        "x",
        "--steps",
        "2",
    ];
    fails(folder, &long, 3, &["too short", "800"]);
}

#[test]
fn an_evaluator_is_trained_and_stops_and_goes_on_too() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    data(folder);
    swings::evaluator(folder);
    let all = [
        "--evaluator",
        "--data",
        "data",
        "--config",
        "judge.json",
        "--steps",
        "6",
        "--validate-every",
        "3",
    ];
    let whole = [&all[..], &["--out", "whole"]].concat();
    let (result, notices) = succeeds(folder, &whole);
    assert!(result.contains("after 6 steps"), "{result}");
    assert!(notices.contains("test: too few motions"), "{notices}");
    let parts = [&all[..], &["--out", "parts", "--time-limit", "0"]].concat();
    for step in 0..6 {
        sits(folder, &parts, step == 5);
    }
    for name in [
        "model.safetensors",
        "config.json",
        "tokenizer.json",
        "mean.npy",
        "std.npy",
    ] {
        let [whole, parts] = ["whole", "parts"]
            .map(|run| fs::read(folder.join(run).join("model").join(name)).unwrap());
        assert!(whole == parts, "{name} differs");
    }
    // The folder is one of an evaluator.
    let denoiser = [
        "--data",
        "data",
        "--config",
        "tiny.json",
        "--steps",
        "6",
        "--out",
        "whole",
    ];
    fails(folder, &denoiser, 2, &["what", "evaluator", "denoiser"]);
}
