//! The model that a command uses, and the device that it runs on.

use std::path::PathBuf;
use std::sync::OnceLock;

use lamogen::model::Denoiser;
use lamogen::{Device, DeviceName, LaMoGen};
use lamogen_data::Checksum;

use crate::arguments::{ModelArguments, TemporalSmoothingChoice};
use crate::console::Console;
use crate::failure::{Failure, FailureCode};

/// A loaded model, and where it comes from.
pub struct ModelSource {
    pub model: LaMoGen,
    /// `embedded`, or the folder of the model.
    pub name: String,
    /// The folder of the model; `None` for the embedded one.
    folder: Option<PathBuf>,
    /// The value of [`ModelSource::checksum`], once it is computed.
    checksum: OnceLock<String>,
}

/// The name of the embedded model.
pub const EMBEDDED: &str = "embedded";

impl ModelSource {
    /// Loads the model, and prints its licence if that excludes commercial use.
    pub fn open(arguments: &ModelArguments, console: &Console) -> Result<ModelSource, Failure> {
        let device = open_device(arguments.device)?;
        let mut source = match &arguments.model {
            Some(folder) => {
                console.notice(format!("Loading {} …", folder.display()));
                ModelSource {
                    model: LaMoGen::load(folder, &device)?,
                    name: folder.display().to_string(),
                    folder: Some(folder.clone()),
                    checksum: OnceLock::new(),
                }
            }
            None => ModelSource {
                model: load_embedded(&device)?,
                name: EMBEDDED.into(),
                folder: None,
                checksum: OnceLock::new(),
            },
        };
        if let Some(TemporalSmoothingChoice(temporal_smoothing)) = arguments.temporal_smoothing {
            let model = source.model.with_temporal_smoothing(temporal_smoothing);
            source.model = model.map_err(|error| Failure::new(FailureCode::Usage, error))?;
        }
        let text_scale = source.model.text_scale();
        let text_scale = text_scale.with(arguments.text_scale, arguments.text_scale_until);
        source.model = { source.model.with_text_scale(text_scale) }
            .map_err(|error| Failure::new(FailureCode::Usage, error))?;
        if let Some(method) = arguments.sampler {
            source.model = source.model.with_sampling_method(method);
        }
        console.notice_licence(source.model.licence());
        Ok(source)
    }

    /// Returns a checksum of the weights, the statistics and the tokenizer. It does not depend on the place of the
    /// folder.
    pub fn checksum(&self) -> &str {
        self.checksum.get_or_init(|| {
            let mut sum = Checksum::new(0);
            sum.add(lamogen_train::fingerprint(self.model.network()).as_bytes());
            for number in self.model.normalization().values().concat() {
                sum.add(&number.to_le_bytes());
            }
            // CLIP's own tokenizer has no file.
            let tokenizer = self.folder.as_ref();
            let tokenizer = tokenizer.map(|folder| std::fs::read(folder.join("tokenizer.json")));
            sum.add(&tokenizer.and_then(Result::ok).unwrap_or_default());
            format!("{:016x}", sum.value())
        })
    }

    /// Returns the device that the model computes on.
    pub fn device(&self) -> Device {
        self.model.network().device()
    }

    /// Returns the number of frames by which predictions are smoothed along time, if they are.
    pub fn temporal_smoothing_frames(&self) -> Option<f32> {
        Some(self.model.temporal_smoothing()?.frames)
    }
}

/// Opens the device of a name, or the first available one.
pub fn open_device(name: Option<DeviceName>) -> Result<Device, Failure> {
    let name = name.or_else(|| DeviceName::available().into_iter().next());
    let none = "this program was built without any backend that works on this machine";
    let name = name.ok_or_else(|| Failure::new(FailureCode::Usage, none))?;
    Ok(name.open()?)
}

/// Loads the embedded model.
#[cfg(feature = "compact")]
pub fn load_embedded(device: &Device) -> Result<LaMoGen, Failure> {
    Ok(LaMoGen::embedded(device)?)
}

/// Fails, since this build has no embedded model.
#[cfg(not(feature = "compact"))]
pub fn load_embedded(_: &Device) -> Result<LaMoGen, Failure> {
    let message = "this program was built without the embedded model";
    Err(Failure::new(FailureCode::Usage, message).hint("--model FOLDER names another"))
}
