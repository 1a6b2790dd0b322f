//! The time of one training step: noise, gradients, clipping, AdamW, averaging.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_guide::{Schedule, noise};
use lamogen_model::{FrameMask, ModelConfig, MotionDiffuse, TrainableDenoiser, TrainingBatch};
use lamogen_train::{
    OptimizerConfig, StepGradients, TrainError, Trainer, TrainingConfig, TrainingTask,
};
use rayon::prelude::*;

use crate::bench::Size;

/// The options of the benchmark.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Which network.
    #[arg(long, value_enum, default_value = "compact")]
    pub size: Size,
    /// Frames of each motion.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=196))]
    pub frames: u64,
    /// Motions of a batch.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub batch: u64,
    /// Steps, of which the median is taken; three before do not count.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub repeat: u64,
}

/// Returns the median time of a step in seconds.
///
/// # Errors
///
/// If a loss is not finite.
pub fn run(options: &Options, device: &Device) -> Result<f64, Box<dyn Error>> {
    let config = match options.size {
        Size::Compact => TrainingConfig::compact().model,
        Size::Full => ModelConfig::motion_diffuse(),
    };
    let task = RandomMotionTask::new(
        config,
        options.batch as usize,
        options.frames as usize,
        device,
    );
    let mut trainer = Trainer::new(&task, device);
    let mut times = Vec::new();
    for _ in 0..3 + options.repeat {
        let start = Instant::now();
        trainer.advance(None)?;
        device.sync()?;
        times.push(start.elapsed().as_secs_f64());
    }
    let mut times = times.split_off(3);
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}

/// The training of a denoiser on random motions, which are noise themselves.
pub struct RandomMotionTask {
    batch: usize,
    frames: usize,
    device: Device,
    optimization: OptimizerConfig,
    config: ModelConfig,
}

impl RandomMotionTask {
    /// Creates a task with batches of `batch` motions of `frames` frames.
    pub fn new(config: ModelConfig, batch: usize, frames: usize, device: &Device) -> Self {
        RandomMotionTask {
            batch,
            frames,
            device: device.clone(),
            optimization: OptimizerConfig::default(),
            config,
        }
    }
}

impl TrainingTask for RandomMotionTask {
    type Network = MotionDiffuse;

    fn optimization(&self) -> &OptimizerConfig {
        &self.optimization
    }

    fn initial_network(&self, device: &Device) -> MotionDiffuse {
        MotionDiffuse::initial(&self.config, 0, device)
    }

    fn compute_gradients(&self, network: &MotionDiffuse, step: u64) -> StepGradients {
        let features = self.config.input_feats;
        let shape = [self.batch, self.frames, features];
        let random_motions = |seed: u64| {
            let motions = (0..self.batch as u64).into_par_iter();
            let motions =
                motions.map(|motion| noise(seed * 10_000 + motion, self.frames, features));
            let motions: Vec<Vec<f32>> = motions.collect();
            let data = TensorData::new(motions.concat(), shape);
            Tensor::<3>::from_data(data, &self.device)
        };
        let (clean, noise) = (random_motions(2 * step), random_motions(2 * step + 1));
        let timesteps: Vec<usize> = (0..self.batch).map(|i| i * 997 % 1000).collect();
        let schedule = Schedule::linear();
        let alphas = timesteps
            .iter()
            .map(|&t| schedule.alphas_cumprod()[t] as f32);
        let alphas = TensorData::new(alphas.collect::<Vec<f32>>(), [self.batch, 1, 1]);
        let alphas = Tensor::<3>::from_data(alphas, &self.device);
        let rest: Tensor<3> = 1.0 - alphas.clone();
        let clip = &self.config.clip;
        let row = |motion: usize| {
            (1..=clip.context_length).map(move |i| match i == clip.context_length {
                true => clip.vocab_size as i32 - 1,
                false => ((i * 31 + motion * 7) % (clip.vocab_size - 1)) as i32,
            })
        };
        let tokens: Vec<i32> = (0..self.batch).flat_map(row).collect();
        let tokens = TensorData::new(tokens, [self.batch, clip.context_length]);
        let batch = TrainingBatch {
            tokens: Tensor::<2, Int>::from_data(tokens, &self.device),
            captions: (0..self.batch).collect(),
            is_without_text: vec![false; self.batch],
            x_t: clean.clone() * alphas.sqrt() + noise * rest.sqrt(),
            timesteps,
            laban: None,
            sentences: None,
            mask: FrameMask::new(&vec![self.frames; self.batch], self.frames, &self.device),
        };
        let computed = network.gradients(batch, |output| (output - clean).square().mean());
        StepGradients {
            loss: computed.loss.clone(),
            total_loss: computed.loss,
            gradients: computed.gradients,
            motions: self.batch,
            frames: self.batch * self.frames,
        }
    }

    fn validate(&self, _: &MotionDiffuse) -> Option<f64> {
        None
    }

    fn save(&self, _: &MotionDiffuse, _: &Path) -> Result<(), TrainError> {
        Ok(())
    }
}
