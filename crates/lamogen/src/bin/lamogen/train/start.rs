//! The model that a training begins with, where it is not a fresh one.

use std::path::Path;

use lamogen::{Device, LaMoGen};

use super::{Named, read};
use crate::failure::Failure;
use crate::source::{EMBEDDED, embedded};

/// A model to go on from, with the file of its tokenizer.
pub struct Start {
    pub model: LaMoGen,
    /// None for CLIP's own.
    pub tokenizer: Option<Named>,
}

impl Start {
    /// Opens a model's folder, or the embedded model by its name.
    pub fn open(folder: &Path, device: &Device) -> Result<Start, Failure> {
        if folder.as_os_str() == EMBEDDED {
            return Ok(Start {
                model: embedded(device)?,
                tokenizer: embedded_tokenizer(),
            });
        }
        let model = LaMoGen::load(folder, device)?;
        let path = folder.join("tokenizer.json");
        let tokenizer = path.exists().then(|| read(&path));
        Ok(Start {
            model,
            tokenizer: tokenizer.transpose()?,
        })
    }
}

#[cfg(feature = "compact")]
fn embedded_tokenizer() -> Option<Named> {
    let name = "the embedded model's tokenizer";
    Some((lamogen_compact::TOKENIZER.to_vec(), name.into()))
}

#[cfg(not(feature = "compact"))]
fn embedded_tokenizer() -> Option<Named> {
    None
}
