//! Quick.
use burn::tensor::Device;
use lamogen_data::{Dataset, LoadOptions};
use lamogen_model::Tokenizer;
use lamogen_train::*;
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let dataset = Dataset::open(&a[1], &LoadOptions::default(), &mut |_| ()).unwrap();
    let config = TrainingConfig::from_file(&a[4]).unwrap();
    let steps: u64 = a[3].parse().unwrap();
    let tok = Tokenizer::from_file(&a[2], 1024, 32).unwrap();
    let tokens = CaptionTokens::new(&dataset, tok, None).unwrap();
    let task = Denoising::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
    let mut t = Trainer::new(&task, &Device::flex());
    let start = Instant::now();
    let mut sum = 0.0;
    for _ in 0..steps {
        let s = Instant::now();
        let r = t.advance(Some(steps)).unwrap();
        sum += r.loss;
        if r.step.is_multiple_of(100) {
            println!(
                "{} {:.1}s step {:.3}s loss {:.4} norm {:.3} {} motions {} frames",
                r.step,
                start.elapsed().as_secs_f64(),
                s.elapsed().as_secs_f64(),
                sum / 100.0,
                r.gradient_norm,
                r.motions,
                r.frames
            );
            sum = 0.0;
        }
        if r.step.is_multiple_of(500) {
            println!("   validation {:.4}", task.validate(t.average()).unwrap());
        }
    }
    std::fs::create_dir_all(&a[5]).unwrap();
    task.save(t.average(), std::path::Path::new(&a[5])).unwrap();
}
