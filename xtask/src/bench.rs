//! The time of one evaluation of a network, and of one step of each pass.

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen::LaMoGen;
use lamogen_guide::{Batch, ClassifierFree, Guidance, Sampler, noise};
use lamogen_laban::Scale;
use lamogen_model::{
    ClipTextConfig, Denoiser, DenoiserInput, FrameMask, Mdm, MdmConfig, MdmText, MdmTextConfig,
    ModelConfig, MotionDiffuse, Tokens,
};
use lamogen_motion::Normalization;

/// The network that is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Size {
    /// The embedded model.
    Compact,
    /// MotionDiffuse's sizes, with random weights.
    Full,
}

/// The options of a benchmark.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Which network.
    #[arg(long, value_enum, default_value = "compact")]
    pub size: Size,
    /// Time the model of a folder instead.
    #[arg(long, conflicts_with = "size")]
    pub model: Option<PathBuf>,
    /// Time MDM at its public sizes (trans_enc, random weights, classifier-free guidance) instead.
    #[arg(long, conflicts_with_all = ["size", "model"])]
    pub mdm: bool,
    /// Frames of each motion.
    #[arg(long, default_value_t = 196, value_parser = clap::value_parser!(u64).range(1..=196))]
    pub frames: u64,
    /// Motions at once.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub batch: u64,
    /// DDIM steps that are timed together, then divided.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub steps: u64,
    /// Measurements, of which the median is taken.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub repeat: u64,
}

/// The median times in seconds.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// One evaluation of the network.
    pub denoiser: f64,
    /// One step of the baseline pass.
    pub baseline_step: f64,
    /// One step of the guided pass.
    pub guided_step: f64,
}

/// Times a network on a device.
///
/// # Errors
///
/// If a pass fails.
pub fn run(options: &Options, device: &Device) -> Result<Times, Box<dyn Error>> {
    let loaded = match &options.model {
        Some(folder) => LaMoGen::load(folder, device)?,
        None => LaMoGen::embedded(device)?,
    };
    let normalization = loaded.normalization();
    if options.mdm {
        let network = mdm(device);
        let ids = Tensor::<2, Int>::from_data([[1, 2, 3, 4, 5, 6, 7, 8]], device);
        let wordless = Tokens {
            ids: vec![0],
            length: 1,
            cut: 0,
            own: 0,
        };
        let scaled = ClassifierFree::new(&network, 2.5, &wordless)?;
        return time(&scaled, ids, normalization, options, device);
    }
    let full;
    let network = match (options.size, &options.model) {
        (Size::Full, None) => {
            full = MotionDiffuse::new(&ModelConfig::motion_diffuse(), device);
            &full
        }
        _ => {
            let network = loaded.network().motion_diffuse();
            network.ok_or("expected a MotionDiffuse, found an MDM")?
        }
    };
    let clip = &network.config().clip;
    let ids: Vec<i32> = (1..=clip.context_length as i32)
        .map(|i| match i as usize == clip.context_length {
            true => clip.vocab_size as i32 - 1,
            false => i % 997,
        })
        .collect();
    let ids = Tensor::<1, Int>::from_data(ids.as_slice(), device).unsqueeze();
    time(network, ids, normalization, options, device)
}

/// Creates an MDM of the public sizes. Its text tower is small, because it runs once a motion.
fn mdm(device: &Device) -> Mdm {
    let config = MdmConfig::from_json(b"{}", "args.json").expect("the defaults are a config");
    let text = MdmTextConfig::Clip {
        tower: ClipTextConfig {
            vocab_size: 1000,
            context_length: 22,
            width: 64,
            heads: 1,
            layers: 1,
        },
        output: config.text_width,
    };
    Mdm::new(&config, MdmText::new(&text, device), device)
}

/// Times a network. `ids` are the tokens of the sentence of all motions, `[1, tokens]`.
fn time<D: Denoiser>(
    model: &D,
    ids: Tensor<2, Int>,
    normalization: &Normalization,
    options: &Options,
    device: &Device,
) -> Result<Times, Box<dyn Error>> {
    let (frames, motions) = (options.frames as usize, options.batch as usize);
    let batch = batch(model, ids, frames, motions, device);
    let steps = options.steps as usize;
    let sampler = Sampler::new(model, normalization, steps)?;
    let guidance = Guidance::paper();
    let scales = vec![Scale::new([1.5, 1.0, 1.0, 1.0])?.into(); motions];

    let input = DenoiserInput {
        x_t: batch.noise.clone(),
        timesteps: vec![500],
        time: model.embed_timesteps(&[500]),
        embedding: batch.prompt.embedding.clone(),
        modulation: None,
        mask: FrameMask::new(&batch.lengths, frames, device),
    };
    let median_time = |task: &mut dyn FnMut() -> Result<Tensor<3>, Box<dyn Error>>| {
        median(options.repeat as usize, task)
    };
    let denoiser = median_time(&mut || Ok(model.denoise(input.clone(), &batch.prompt.context)))?;
    let baseline_step = median_time(&mut || Ok(sampler.baseline(&batch, &mut ())?))?;
    let baseline = sampler.baseline(&batch, &mut ())?;
    let guided_step = median_time(&mut || {
        let guided = sampler.guided(&batch, baseline.clone(), &scales, &guidance, &mut ())?;
        Ok(guided.motion)
    })?;
    Ok(Times {
        denoiser,
        baseline_step: baseline_step / steps as f64,
        guided_step: guided_step / steps as f64,
    })
}

/// Creates a batch of motions with random noise and one sentence.
fn batch<D: Denoiser>(
    model: &D,
    ids: Tensor<2, Int>,
    frames: usize,
    motions: usize,
    device: &Device,
) -> Batch<D::Context> {
    let start: Vec<f32> = (0..motions as u64)
        .flat_map(|seed| noise(seed, frames, model.pose_features()))
        .collect();
    let start = TensorData::new(start, [motions, frames, model.pose_features()]);
    Batch {
        prompt: model.encode(&ids.repeat_dim(0, motions).into()),
        noise: Tensor::from_data(start, device),
        lengths: vec![frames; motions],
        step_noise: None,
        continuation: None,
        known: None,
    }
}

/// Returns the median time of a task in seconds, after one run that is not timed. The task ends when its result can be read.
fn median(
    repeat: usize,
    task: &mut dyn FnMut() -> Result<Tensor<3>, Box<dyn Error>>,
) -> Result<f64, Box<dyn Error>> {
    let mut seconds = || -> Result<f64, Box<dyn Error>> {
        let start = Instant::now();
        task()?.into_data();
        Ok(start.elapsed().as_secs_f64())
    };
    seconds()?;
    let mut times = (0..repeat)
        .map(|_| seconds())
        .collect::<Result<Vec<_>, _>>()?;
    times.sort_by(f64::total_cmp);
    Ok(times[repeat / 2])
}

/// Returns the peak memory of this process in MiB; `None` if the operating system does not report it.
pub fn peak_memory() -> Option<f64> {
    peak_memory_of(std::process::id())
}

/// Returns the peak memory of a running process in MiB; `None` if the operating system does not report it.
pub fn peak_memory_of(process: u32) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}
