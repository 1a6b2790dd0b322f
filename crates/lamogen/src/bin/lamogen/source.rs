//! The model that a command works with.

use std::cell::OnceCell;
use std::path::PathBuf;

use lamogen::model::Denoiser;
use lamogen::{Device, DeviceName, LaMoGen};
use lamogen_data::Checksum;

use crate::arguments::{SourceArguments, TemporalSmoothingChoice};
use crate::console::Console;
use crate::failure::{Code, Failure};

/// A loaded model.
pub struct Source {
    pub model: LaMoGen,
    /// `embedded`, or its folder.
    pub name: String,
    /// The model's folder; none for the embedded one.
    folder: Option<PathBuf>,
    checksum: OnceCell<String>,
}

/// The name of the embedded model.
pub const EMBEDDED: &str = "embedded";

impl Source {
    /// Loads it, and says its licence if that excludes commercial use.
    pub fn open(arguments: &SourceArguments, console: &Console) -> Result<Source, Failure> {
        let device = device(arguments.device)?;
        let mut source = match &arguments.model {
            Some(folder) => {
                console.notice(format!("Loading {} …", folder.display()));
                Source {
                    model: LaMoGen::load(folder, &device)?,
                    name: folder.display().to_string(),
                    folder: Some(folder.clone()),
                    checksum: OnceCell::new(),
                }
            }
            None => Source {
                model: embedded(&device)?,
                name: EMBEDDED.into(),
                folder: None,
                checksum: OnceCell::new(),
            },
        };
        if let Some(TemporalSmoothingChoice(temporal_smoothing)) = arguments.temporal_smoothing {
            let model = source.model.with_temporal_smoothing(temporal_smoothing);
            source.model = model.map_err(|error| Failure::new(Code::Usage, error))?;
        }
        if let Some(scale) = arguments.text_scale {
            let model = source.model.with_text_scale(scale);
            source.model = model.map_err(|error| Failure::new(Code::Usage, error))?;
        }
        console.licence(source.model.licence());
        Ok(source)
    }

    /// A number that stands for what the model is: its weights, statistics and tokenizer, wherever its folder lies.
    pub fn checksum(&self) -> &str {
        self.checksum.get_or_init(|| {
            let mut sum = Checksum::new(0);
            sum.add(lamogen_train::fingerprint(self.model.network()).as_bytes());
            for number in self.model.normalization().values().concat() {
                sum.add(&number.to_le_bytes());
            }
            // CLIP's own has no file.
            let tokenizer = self.folder.as_ref();
            let tokenizer = tokenizer.map(|folder| std::fs::read(folder.join("tokenizer.json")));
            sum.add(&tokenizer.and_then(Result::ok).unwrap_or_default());
            format!("{:016x}", sum.value())
        })
    }

    /// Where the model computes.
    pub fn device(&self) -> Device {
        self.model.network().device()
    }

    /// The frames by which predictions are smoothed along time, if they are.
    pub fn temporal_smoothing_frames(&self) -> Option<f32> {
        Some(self.model.temporal_smoothing()?.frames)
    }
}

/// The device of a name, or the first there is.
pub fn device(name: Option<DeviceName>) -> Result<Device, Failure> {
    let name = name.or_else(|| DeviceName::available().into_iter().next());
    let none = "this program was built without any backend that works on this machine";
    let name = name.ok_or_else(|| Failure::new(Code::Usage, none))?;
    Ok(name.open()?)
}

#[cfg(feature = "compact")]
pub fn embedded(device: &Device) -> Result<LaMoGen, Failure> {
    Ok(LaMoGen::embedded(device)?)
}

#[cfg(not(feature = "compact"))]
pub fn embedded(_: &Device) -> Result<LaMoGen, Failure> {
    let message = "this program was built without the embedded model";
    Err(Failure::new(Code::Usage, message).hint("--model FOLDER names another"))
}
