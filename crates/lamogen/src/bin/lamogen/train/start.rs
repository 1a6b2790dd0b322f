//! The model that a training begins with, if it does not begin with fresh weights.

use std::path::Path;

use lamogen::{Device, LaMoGen};

use super::{NamedFile, read_file};
use crate::failure::Failure;
use crate::source::{EMBEDDED, load_embedded};

/// A model that a training begins with, and the file of its tokenizer.
pub struct StartModel {
    pub model: LaMoGen,
    /// The tokenizer file; `None` for CLIP's own tokenizer.
    pub tokenizer: Option<NamedFile>,
}

impl StartModel {
    /// Opens a model's folder, or the embedded model by its name.
    pub fn open(folder: &Path, device: &Device) -> Result<StartModel, Failure> {
        if folder.as_os_str() == EMBEDDED {
            return Ok(StartModel {
                model: load_embedded(device)?,
                tokenizer: embedded_tokenizer(),
            });
        }
        let model = LaMoGen::load(folder, device)?;
        let path = folder.join("tokenizer.json");
        let tokenizer = path.exists().then(|| read_file(&path));
        Ok(StartModel {
            model,
            tokenizer: tokenizer.transpose()?,
        })
    }
}

#[cfg(feature = "compact")]
fn embedded_tokenizer() -> Option<NamedFile> {
    let name = "the embedded model's tokenizer";
    Some((lamogen_compact::TOKENIZER.to_vec(), name.into()))
}

#[cfg(not(feature = "compact"))]
fn embedded_tokenizer() -> Option<NamedFile> {
    None
}
