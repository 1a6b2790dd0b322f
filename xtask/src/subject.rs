//! The model that is measured, and how it samples.

use std::error::Error;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen::{LaMoGen, Request, TemporalSmoothing};

/// The options that select a model and its sampling.
#[derive(Clone, Debug, clap::Args)]
pub struct Subject {
    /// Folder of a model; the embedded one without.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// DDIM steps of every motion; those of the preset without, which has more for motions that have to arrive somewhere.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1000))]
    steps: Option<u64>,
    /// Frames by which predictions are smoothed along time; the model's own default without, 0 is off.
    #[arg(long)]
    pub temporal_smoothing: Option<f32>,
    /// The last timestep at which predictions are smoothed.
    #[arg(long, default_value_t = TemporalSmoothing::default().until, requires = "temporal_smoothing")]
    pub until: usize,
    /// How strongly motions follow the sentence (classifier-free guidance); the model's own default without.
    #[arg(long)]
    pub text_scale: Option<f64>,
    /// The smallest timestep whose prediction is scaled; the model's own default without.
    #[arg(long)]
    pub text_scale_until: Option<usize>,
}

impl Subject {
    /// Sets the steps of a request, if they were given.
    pub fn with_steps(&self, request: Request) -> Request {
        match self.steps {
            Some(steps) => request.steps(steps as usize),
            None => request,
        }
    }

    /// Returns the steps of the model's motions that do not have to arrive anywhere.
    pub fn steps(&self, model: &LaMoGen) -> usize {
        let steps = self.steps.map(|steps| steps as usize);
        steps.unwrap_or(model.preset().steps())
    }

    /// Loads the model.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, or the smoothing makes no sense.
    pub fn open(&self, device: &Device) -> Result<LaMoGen, Box<dyn Error>> {
        let model = match &self.model {
            Some(folder) => LaMoGen::load(folder, device)?,
            None => LaMoGen::embedded(device)?,
        };
        let text_scale = model.text_scale();
        let text_scale = text_scale.with(self.text_scale, self.text_scale_until);
        let model = model.with_text_scale(text_scale)?;
        let Some(frames) = self.temporal_smoothing else {
            return Ok(model);
        };
        let temporal_smoothing = TemporalSmoothing {
            frames,
            until: self.until,
        };
        Ok(model.with_temporal_smoothing((frames != 0.0).then_some(temporal_smoothing))?)
    }
}
