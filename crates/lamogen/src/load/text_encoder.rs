//! The text encoders of MDM in the files of their authors.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_model::{MdmText, TextEncoderKind, Tokenizer};

use super::folder_contents;
use crate::error::LoadError;

/// The weights of a text encoder. A tokenizer other than CLIP's own lies beside them.
pub(super) struct TextEncoderFiles {
    kind: TextEncoderKind,
    weights: PathBuf,
}

/// The number of tokens that MDM's code leaves of a sentence for CLIP: 20, and those of its start and end.
const CLIP_TOKENS: usize = 22;

/// The names of files with CLIP's text tower.
const CLIP_FILES: [&str; 9] = [
    "clip.safetensors",
    "clip.pt",
    "clip-vit-base-patch32/model.safetensors",
    "clip-vit-base-patch32/pytorch_model.bin",
    "ViT-B-32.safetensors",
    "ViT-B-32.pt",
    "latest.tar",
    "model/latest.tar",
    "t2m_motiondiffuse/model/latest.tar",
];

/// The names of files with DistilBERT. Its tokenizer is beside it.
const DISTILBERT_FILES: [&str; 5] = [
    "distilbert-base-uncased/model.safetensors",
    "distilbert-base-uncased/pytorch_model.bin",
    "distilbert/distilbert-base-uncased/model.safetensors",
    "distilbert/distilbert-base-uncased/pytorch_model.bin",
    "distilbert.safetensors",
];

impl TextEncoderFiles {
    /// Finds the text encoder in a model's folder or in the folder above.
    pub(super) fn find(folder: &Path, kind: TextEncoderKind) -> Result<Self, LoadError> {
        let names: &[&str] = match kind {
            TextEncoderKind::Clip => &CLIP_FILES,
            TextEncoderKind::Bert => &DISTILBERT_FILES,
        };
        let absolute = std::fs::canonicalize(folder);
        let above = { absolute.ok() }.and_then(|folder| folder.parent().map(Path::to_owned));
        let folders = [Some(folder.to_owned()), above];
        let paths = { folders.iter().flatten() }
            .flat_map(|folder| names.iter().map(move |name| folder.join(name)));
        let weights = { paths.into_iter() }.find(|path| path.exists());
        match weights {
            Some(weights) => Ok(TextEncoderFiles { kind, weights }),
            None => Err(LoadError::NoTextEncoder {
                folder: folder.to_owned(),
                encoder: name_of(kind),
                names: names.join(", "),
                found: folder_contents(folder),
            }),
        }
    }

    /// Loads the encoder, whose features must have `width` numbers, with its tokenizer.
    pub(super) fn load(
        &self,
        width: usize,
        device: &Device,
    ) -> Result<(MdmText, Tokenizer), LoadError> {
        let text = match self.kind {
            TextEncoderKind::Clip => MdmText::clip(&self.weights, device),
            TextEncoderKind::Bert => MdmText::distilbert(&self.weights, device),
        }?;
        if text.width() != width {
            return Err(LoadError::TextEncoderWidth {
                path: self.weights.clone(),
                encoder: name_of(self.kind),
                expected: width,
                found: text.width(),
            });
        }
        let tokenizer = match self.kind {
            TextEncoderKind::Clip => {
                let file = self.weights.with_file_name("tokenizer.json");
                let (vocabulary, positions) = (text.vocab_size(), text.positions());
                let tokenizer = Tokenizer::clip(CLIP_TOKENS.min(positions));
                if tokenizer.vocab_size() != vocabulary && file.exists() {
                    let tokenizer = Tokenizer::from_file(file, vocabulary, positions)?;
                    return Ok((text, tokenizer));
                }
                if tokenizer.vocab_size() != text.vocab_size() {
                    return Err(LoadError::NoTokenizer {
                        path: file,
                        clip: tokenizer.vocab_size(),
                        found: text.vocab_size(),
                    });
                }
                tokenizer
            }
            TextEncoderKind::Bert => Tokenizer::word_piece_from_file(
                self.weights.with_file_name("tokenizer.json"),
                text.vocab_size(),
                text.positions(),
            )?,
        };
        Ok((text, tokenizer))
    }
}

/// Returns the name of an encoder in messages.
fn name_of(kind: TextEncoderKind) -> &'static str {
    match kind {
        TextEncoderKind::Clip => "the text tower of CLIP ViT-B/32",
        TextEncoderKind::Bert => "distilbert-base-uncased",
    }
}
