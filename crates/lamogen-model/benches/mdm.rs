//! MDM at its public sizes, on the CPU: one evaluation with classifier-free guidance, and its gradient.

use criterion::{Criterion, criterion_group, criterion_main};

use burn::tensor::{Device, Int, Tensor};
use lamogen_model::{
    Denoiser, DenoiserInput, DistilBertConfig, FrameMask, Mdm, MdmConfig, MdmText, MdmTextConfig,
    ModelConfig,
};

const FRAMES: usize = 196;

fn network(args: &str, device: &Device) -> Mdm {
    let config = MdmConfig::from_json(args.as_bytes(), "args.json").expect("a config");
    let text = match config.text_width {
        512 => MdmTextConfig::Clip {
            tower: ModelConfig::motion_diffuse().clip,
            output: 512,
        },
        width => MdmTextConfig::DistilBert(DistilBertConfig {
            vocab_size: 1000,
            positions: 64,
            width,
            heads: 12,
            layers: 1,
            ff_size: 64,
        }),
    };
    Mdm::new(&config, MdmText::new(&text, device), device)
}

fn evaluations(criterion: &mut Criterion) {
    let device = Device::flex();
    for (name, args) in [
        ("trans_enc", "{}"),
        (
            "trans_dec",
            r#"{"arch": "trans_dec", "text_encoder_type": "bert"}"#,
        ),
    ] {
        let network = network(args, &device);
        let ids = Tensor::<2, Int>::from_data([[1, 2, 3, 4, 5, 6, 7, 8]], &device).into();
        let prompt = network.encode(&ids);
        let unconditional = network.unconditional(&prompt, &ids);
        let x_t = Tensor::<1, Int>::arange(0..(FRAMES * 263) as i64, &device);
        let input = DenoiserInput {
            x_t: x_t.float().sin().reshape([1, FRAMES, 263]),
            timesteps: vec![7],
            time: network.embed_timesteps(&[7]),
            embedding: prompt.embedding.clone(),
            modulation: None,
            mask: FrameMask::new(&[FRAMES], FRAMES, &device),
        };
        let mut group = criterion.benchmark_group(format!("{name}, {FRAMES} frames"));
        group.sample_size(10);
        group.bench_function("guided evaluation", |bencher| {
            bencher.iter(|| {
                let input = input.clone();
                let context = &prompt.context;
                network.denoise_with_unconditional(input, context, &unconditional)
            });
        });
        group.bench_function("gradient", |bencher| {
            bencher.iter(|| {
                let linearized = network.linearize(input.clone(), &prompt.context);
                let ones = linearized.output.ones_like();
                linearized.pull(ones)
            });
        });
    }
}

criterion_group!(benches, evaluations);
criterion_main!(benches);
