//! The same numbers on every backend: flex, ndarray, and wgpu on a Vulkan driver that computes on the CPU.

use std::path::Path;

use std::ops::ControlFlow;
use std::time::Duration;

use lamogen::{DeviceName, LaMoGen, Request};
use lamogen_model::ModelConfig;
use lamogen_train::{LogLine, RunLength, RunObserver, RunPlan, RunProgress, StepReport, run};
use xtask::parity::{Distance, Short, short};
use xtask::training::RandomMotionTask;

/// Every backend of this build, the software driver before a graphics processor.
fn devices() -> Vec<DeviceName> {
    let available = DeviceName::available();
    let of = |names: &[&str]| -> DeviceName {
        let names = names.iter().map(|name| name.parse().unwrap());
        let mut found = names.filter(|name| available.contains(name));
        found
            .next()
            .unwrap_or_else(|| panic!("only these devices were found: {available:?}"))
    };
    let mut devices = vec![of(&["flex"]), of(&["ndarray"])];
    if cfg!(feature = "wgpu") {
        devices.push(of(&["wgpu:cpu", "wgpu", "wgpu:0"]));
    }
    devices
}

/// Largest distance of single evaluations and gradients.
const SINGLE: f64 = 1e-4;
/// Largest distance of the Laban gradient through wgpu. Third differences magnify the last
/// bit of the smoothed positions: the reference itself is 1.2e-4 from the same sums in 64 bits, and
/// only fused multiplications and additions in its order come closer to it than that.
const ROUNDED_ELSEWHERE: f64 = 2.5e-4;
/// Largest distance behind three guided steps.
const GUIDED: f64 = 5e-3;

fn check(what: &str, through_wgpu: bool, distances: Vec<Distance>) {
    for distance in distances {
        println!("{what}: {} {:.1e}", distance.name, distance.error);
        let limit = match distance.name {
            _ if distance.is_guided => GUIDED,
            "out.laban_grad" if through_wgpu => ROUNDED_ELSEWHERE,
            _ => SINGLE,
        };
        assert!(distance.error <= limit, "{what}: {distance:?}");
    }
}

#[test]
fn every_backend_agrees_with_the_reference_and_with_the_others() {
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/tiny_sample");
    let mut others: Vec<(DeviceName, Short)> = Vec::new();
    for name in devices() {
        let result = short(&case, &name.open().unwrap()).unwrap();
        let through_wgpu = name.to_string().starts_with("wgpu");
        check(
            &format!("{name} and the reference"),
            through_wgpu,
            result.distances_to_reference(),
        );
        for (other, other_result) in &others {
            check(
                &format!("{name} and {other}"),
                through_wgpu,
                result.distances_to(other_result),
            );
        }
        others.push((name, result));
    }
}

#[test]
fn joints_agree_to_a_hundredth_of_a_millimetre_after_fifty_steps() {
    let request = Request::new("a person jumps").frames(40).steps(50).seed(3);
    let devices = devices();
    let joints = |name: &DeviceName| {
        let model = LaMoGen::embedded(&name.open().unwrap()).unwrap();
        // Of the network: the fit to a body multiplies what differs.
        let result = model.generate(&request).unwrap();
        result.network.baseline.joints().to_vec()
    };
    let expected = joints(&devices[0]);
    for name in &devices[1..] {
        let found = joints(name);
        assert_eq!(found.len(), expected.len());
        let pairs = found.iter().flatten().zip(expected.iter().flatten());
        // Motions hold no NaN, which this would not see.
        let distance = pairs.fold(0.0f32, |largest, (a, b)| {
            let square: f32 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
            largest.max(square.sqrt())
        });
        println!("{name}: {:.2e} mm", 1000.0 * distance);
        assert!(distance < 1e-5, "{name}: {distance} m");
    }
}

/// Stops after three steps of a sitting.
struct Three;

impl RunObserver<RandomMotionTask> for Three {
    fn step(&mut self, _: &StepReport, progress: &RunProgress) -> ControlFlow<()> {
        match progress.step - progress.resumed_at {
            3 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

#[test]
fn training_stops_and_goes_on_with_the_same_losses_everywhere() {
    let config = serde_json::json!({
        "input_feats": 21, "num_frames": 24, "latent_dim": 16, "ff_size": 24, "num_layers": 2, "num_heads": 2,
        "text_latent_dim": 16, "text_ff_size": 16, "text_num_heads": 2, "num_text_layers": 1,
        "clip": { "vocab_size": 30, "context_length": 6, "width": 16, "heads": 2, "layers": 1 },
        "prediction": "sample",
    });
    let config = ModelConfig::from_json(config.to_string().as_bytes(), "test").unwrap();
    let losses = |name: &DeviceName| -> Vec<[f64; 2]> {
        let device = name.open().unwrap();
        let task = RandomMotionTask::new(config.clone(), 4, 24, &device);
        let folder = tempfile::tempdir().unwrap();
        let plan = RunPlan {
            length: RunLength::Steps(6),
            validate_every: 100,
            checkpoint_every: Duration::from_secs(3600),
        };
        let what = serde_json::json!({ "what": "practice" });
        for finished in [false, true] {
            let ended = run(&task, folder.path(), &what, &plan, &device, &mut Three).unwrap();
            assert_eq!(ended.finished, finished, "{name}");
        }
        let lines = LogLine::read(folder.path().join("losses.jsonl")).unwrap();
        let reports = lines.into_iter().map(|line| match line {
            LogLine::Step(report) => [report.loss, report.gradient_norm],
            LogLine::Validation { .. } => panic!("there is nothing to validate on"),
        });
        reports.collect()
    };
    let devices = devices();
    let expected = losses(&devices[0]);
    assert!(expected.len() == 6 && expected[5] != expected[0]);
    for name in &devices[1..] {
        for (found, expected) in losses(name).into_iter().zip(&expected) {
            for (found, expected) in found.into_iter().zip(expected) {
                assert!(
                    (found / expected - 1.0).abs() < 1e-3,
                    "{name}: {found} {expected}"
                );
            }
        }
    }
}
