//! A `tokenizer.json` of the Hugging Face `tokenizers` library.

use std::path::PathBuf;

use crate::TokenizerError;

/// A tokenizer as its file describes it, without the file's padding and cutting.
#[derive(Clone, Debug)]
pub(crate) struct FileTokenizer {
    inner: tokenizers::Tokenizer,
    end: u32,
    /// What a text without tokens of its own gives.
    empty: Vec<u32>,
}

impl FileTokenizer {
    /// Reads the JSON; `path` stands in error messages.
    pub(crate) fn from_json(
        json: &[u8],
        path: PathBuf,
        vocab_size: usize,
    ) -> Result<Self, TokenizerError> {
        let format = |problem: String| TokenizerError::Format {
            path: path.clone(),
            problem,
        };
        let mut inner =
            tokenizers::Tokenizer::from_bytes(json).map_err(|error| format(error.to_string()))?;
        // A user's "<|endoftext|>" is text: as a token it would end the prompt early.
        inner.set_encode_special_tokens(true);
        // Padding and cutting are done here, whatever the file asks for.
        inner.with_padding(None);
        inner
            .with_truncation(None)
            .map_err(|error| format(error.to_string()))?;
        let end = inner
            .get_vocab(true)
            .into_values()
            .max()
            .ok_or_else(|| format("it has no tokens".into()))?;
        if end as usize >= vocab_size {
            return Err(TokenizerError::Vocabulary {
                path,
                largest: end,
                vocab_size,
            });
        }
        let probe = inner
            .encode_fast("a", true)
            .map_err(|error| format(error.to_string()))?;
        if probe.get_ids().last() != Some(&end) {
            return Err(TokenizerError::End {
                path,
                end,
                found: probe.get_ids().to_vec(),
            });
        }
        let empty = inner
            .encode_fast("", true)
            .map_err(|error| format(error.to_string()))?;
        Ok(FileTokenizer {
            empty: empty.get_ids().to_vec(),
            inner,
            end,
        })
    }

    /// The ids of a prompt with those that the file puts around it, or what is wrong with it.
    pub(crate) fn ids(&self, prompt: &str) -> Result<Vec<u32>, String> {
        let encoding = self
            .inner
            .encode_fast(prompt, true)
            .map_err(|error| error.to_string())?;
        let ids = encoding.get_ids().to_vec();
        if ids == self.empty {
            return Err("it has no token that the model knows".into());
        }
        Ok(ids)
    }

    /// How many ids the file puts around those of a text.
    pub(crate) fn around(&self) -> usize {
        self.empty.len()
    }

    /// What a text without words becomes.
    pub(crate) fn empty(&self) -> &[u32] {
        &self.empty
    }

    /// The id that ends a text, which is the largest.
    pub(crate) fn end(&self) -> u32 {
        self.end
    }
}
