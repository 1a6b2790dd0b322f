//! Benchmarks of both passes at the sizes of the embedded model: `cargo bench --bench steps`.

use burn::tensor::{Device, Int, Tensor, TensorData};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use lamogen_guide::{Batch, Guidance, Sampler, noise};
use lamogen_laban::{Goals, Scale};
use lamogen_model::{Denoiser, ModelConfig, MotionDiffuse};
use lamogen_motion::{Normalization, POSE_FEATURES, npy};

const FRAMES: usize = 80;
/// The number of steps of a pass. The measured times are those of a whole pass.
const STEPS: usize = 5;

fn normalization(device: &Device) -> Normalization {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, value: f32| {
        let path = folder.path().join(name);
        npy::write(&path, &[value; POSE_FEATURES], &[POSE_FEATURES]).expect("a file");
        path
    };
    let (mean, std) = (write("mean.npy", 0.0), write("std.npy", 1.0));
    Normalization::from_files(mean, std, POSE_FEATURES, device).expect("statistics")
}

fn steps(criterion: &mut Criterion) {
    let device = Device::flex();
    let config = ModelConfig::from_json(lamogen_compact::CONFIG, "config.json").expect("a config");
    let model = MotionDiffuse::new(&config, &device);
    let normalization = normalization(&device);
    let sampler = Sampler::new(&model, &normalization, STEPS).expect("a few steps");
    let scale = Goals::from(Scale::new([1.5, 1.0, 1.0, 1.0]).expect("a scale"));
    let mut group = criterion.benchmark_group(format!("{STEPS} steps, {FRAMES} frames"));
    for motions in [1, 8] {
        let tokens: Vec<i32> = (1..=config.clip.context_length as i32).collect();
        let tokens = TensorData::new(tokens.repeat(motions), [motions, tokens.len()]);
        let start: Vec<f32> = (0..motions as u64)
            .flat_map(|seed| noise(seed, FRAMES, POSE_FEATURES))
            .collect();
        let start = TensorData::new(start, [motions, FRAMES, POSE_FEATURES]);
        let batch = Batch {
            prompt: model.encode(&Tensor::<2, Int>::from_data(tokens, &device).into()),
            noise: Tensor::from_data(start, &device),
            lengths: vec![FRAMES; motions],
            step_noise: None,
            continuation: None,
            known: None,
        };
        let baseline = || sampler.baseline(&batch, &mut ()).expect("a baseline");
        group.bench_function(BenchmarkId::new("baseline", motions), |bencher| {
            bencher.iter(baseline);
        });
        let start = baseline();
        let (scales, guidance) = (vec![scale.clone(); motions], Guidance::fast());
        group.bench_function(BenchmarkId::new("guided", motions), |bencher| {
            bencher.iter(|| {
                let guided = sampler.guided(&batch, start.clone(), &scales, &guidance, &mut ());
                guided.expect("finite numbers").motion
            });
        });
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
