//! Captions as token ids.

use lamogen_data::Dataset;
use lamogen_model::{Tokenizer, TokenizerError};

/// Token ids of every caption of every entry of a data set.
#[derive(Clone, Debug)]
pub struct CaptionTokens {
    /// `[entry][caption][token]`.
    ids: Vec<Vec<Vec<i32>>>,
    /// How many captions are longer than the context.
    cut: usize,
    tokenizer: Tokenizer,
    /// The `tokenizer.json`; none for CLIP's own.
    file: Option<Vec<u8>>,
}

impl CaptionTokens {
    /// The ids that a tokenizer gives. Captions that are longer than the network's context are cut, as prompts are. `file` is the
    /// tokenizer's own, for the folder of the finished model; none for CLIP's.
    ///
    /// # Errors
    ///
    /// If a caption cannot be encoded.
    pub fn new(
        dataset: &Dataset,
        tokenizer: Tokenizer,
        file: Option<Vec<u8>>,
    ) -> Result<Self, TokenizerError> {
        let mut cut = 0;
        let mut ids = Vec::with_capacity(dataset.entries().len());
        for entry in dataset.entries() {
            let captions = entry.captions.iter().map(|caption| {
                let tokens = tokenizer.encode(&caption.text)?;
                cut += usize::from(tokens.cut > 0);
                Ok(tokens.ids.iter().map(|&id| id as i32).collect())
            });
            ids.push(captions.collect::<Result<Vec<Vec<i32>>, TokenizerError>>()?);
        }
        Ok(CaptionTokens {
            ids,
            cut,
            tokenizer,
            file,
        })
    }

    /// The ids of a caption.
    pub(crate) fn of(&self, entry: usize, caption: usize) -> &[i32] {
        &self.ids[entry][caption]
    }

    /// The tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// The tokenizer's file, if it has one.
    pub fn file(&self) -> Option<&[u8]> {
        self.file.as_deref()
    }

    /// How many captions are cut.
    pub fn cut(&self) -> usize {
        self.cut
    }
}
