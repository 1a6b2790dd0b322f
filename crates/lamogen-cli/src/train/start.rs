//! The model that a training begins with, if it does not begin with fresh weights.

use std::path::Path;

use lamogen::model::MotionDiffuse;
use lamogen::motion::Normalization;
use lamogen::{Device, LaMoGen, Licence};

use super::{NamedFile, read_file};
use crate::failure::{Failure, FailureCode};
use crate::source::{EMBEDDED, load_embedded};

/// A model that a training begins with, and the file of its tokenizer.
pub struct StartModel {
    pub network: MotionDiffuse,
    pub normalization: Normalization,
    pub licence: Option<Licence>,
    /// The tokenizer file; `None` for CLIP's own tokenizer.
    pub tokenizer: Option<NamedFile>,
}

impl StartModel {
    /// Opens a model's folder, or the embedded model by its name.
    pub fn open(folder: &Path, device: &Device) -> Result<StartModel, Failure> {
        if folder.as_os_str() == EMBEDDED {
            return Self::new(folder, &load_embedded(device)?, embedded_tokenizer());
        }
        let model = LaMoGen::load(folder, device)?;
        let path = folder.join("tokenizer.json");
        let tokenizer = path.exists().then(|| read_file(&path));
        Self::new(folder, &model, tokenizer.transpose()?)
    }

    fn new(
        folder: &Path,
        model: &LaMoGen,
        tokenizer: Option<NamedFile>,
    ) -> Result<StartModel, Failure> {
        let network = model.network().motion_diffuse().ok_or_else(|| {
            let message = format!(
                "{}: expected a network like MotionDiffuse, found an MDM",
                folder.display()
            );
            Failure::new(FailureCode::Input, message)
        })?;
        Ok(StartModel {
            network: network.clone(),
            normalization: model.normalization().clone(),
            licence: model.licence().cloned(),
            tokenizer,
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
