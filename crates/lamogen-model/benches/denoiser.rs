//! Benchmark of one evaluation of the network, without and with its gradient: `cargo bench --bench denoiser`.

use burn::tensor::{Device, Int, Tensor, TensorData};
use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use lamogen_model::{Denoiser, DenoiserInput, FrameMask, ModelConfig, MotionDiffuse};

/// Returns the name, the config and the number of frames of the embedded model and of MotionDiffuse.
fn sizes() -> [(&'static str, ModelConfig, usize); 2] {
    let full = ModelConfig::motion_diffuse();
    let compact = ModelConfig::from_json(lamogen_compact::CONFIG, "config.json").expect("a config");
    [("compact", compact, 80), ("full", full, 196)]
}

fn denoiser(criterion: &mut Criterion) {
    let device = Device::flex();
    for (name, config, frames) in sizes() {
        let model = MotionDiffuse::new(&config, &device);
        let tokens: Vec<i32> = (1..=config.clip.context_length as i32).collect();
        let tokens = Tensor::<1, Int>::from_data(tokens.as_slice(), &device);
        let prompt = model.encode(&tokens.unsqueeze::<2>().into());
        let numbers = |i: usize| (i as f32 * 0.731).sin();
        let x_t: Vec<f32> = (0..frames * config.input_feats).map(numbers).collect();
        let x_t = TensorData::new(x_t, [1, frames, config.input_feats]);
        let input = DenoiserInput {
            x_t: Tensor::from_data(x_t, &device),
            timesteps: vec![500],
            time: model.embed_timesteps(&[500]),
            embedding: prompt.embedding,
            modulation: None,
            mask: FrameMask::new(&[frames], frames, &device),
        };
        let context = &prompt.context;
        let mut group = criterion.benchmark_group("denoiser");
        group.bench_function(BenchmarkId::new("evaluate", name), |bencher| {
            bencher.iter_batched(
                || input.clone(),
                |input| model.denoise(input, context),
                BatchSize::LargeInput,
            );
        });
        group.bench_function(BenchmarkId::new("gradient", name), |bencher| {
            bencher.iter_batched(
                || input.clone(),
                |input| {
                    let linearized = model.linearize(input, context);
                    let gradient = linearized.output.clone();
                    linearized.pull(gradient)
                },
                BatchSize::LargeInput,
            );
        });
        group.finish();
    }
}

criterion_group!(benches, denoiser);
criterion_main!(benches);
