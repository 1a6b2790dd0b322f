//! Benchmarks of the Laban features, and of the loss with its gradient: `cargo bench --bench features`.

use burn::tensor::{Device, Tensor, TensorData};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use lamogen_laban::{Goals, LabanFeatures, LabanOptions, LabanTarget, LossDivisor, Scale};
use lamogen_motion::JOINTS;

fn features(criterion: &mut Criterion) {
    let device = Device::flex();
    let mut group = criterion.benchmark_group("laban");
    for (motions, frames) in [(1, 80), (1, 196), (8, 196)] {
        let numbers: Vec<f32> = (0..motions * frames * JOINTS * 3)
            .map(|i| (i as f32 * 0.731).sin())
            .collect();
        let joints = TensorData::new(numbers, [motions, frames, JOINTS, 3]);
        let joints = Tensor::<4>::from_data(joints, &device);
        let lengths = vec![frames; motions];
        let features = LabanFeatures::new(&LabanOptions::default(), frames, &lengths, &device);
        let size = format!("{motions}x{frames}");
        group.bench_function(BenchmarkId::new("features", &size), |bencher| {
            bencher.iter(|| features.measure(joints.clone()));
        });
        let scale = Scale::new([1.5, 1.0, 1.0, 1.0]).expect("a scale");
        let goals = vec![Goals::from(scale).whole().clone(); motions];
        let baseline = features.measure(joints.clone());
        let target = LabanTarget::new(baseline, &lengths, &goals, LossDivisor::Mean, [1.0; 4]);
        group.bench_function(BenchmarkId::new("gradient", &size), |bencher| {
            bencher.iter(|| {
                let leaf = (joints.clone() * 0.9).autodiff().require_grad();
                let loss = target.loss(features.measure(leaf.clone())).sum();
                leaf.grad_remove(&mut loss.backward()).expect("a gradient")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, features);
criterion_main!(benches);
