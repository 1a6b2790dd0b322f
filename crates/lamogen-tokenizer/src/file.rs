//! Tokenizers from a `tokenizer.json` of the Hugging Face `tokenizers` library.

use std::path::PathBuf;

use crate::TokenizerError;

/// A tokenizer that its file describes. The file's padding and truncation are not used.
#[derive(Clone, Debug)]
pub(crate) struct FileTokenizer {
    inner: tokenizers::Tokenizer,
    end: u32,
    /// The ids of a text without tokens of its own.
    empty_ids: Vec<u32>,
}

impl FileTokenizer {
    /// Reads a tokenizer from JSON. `path` is used in error messages.
    pub(crate) fn from_json(
        json: &[u8],
        path: PathBuf,
        vocab_size: usize,
    ) -> Result<Self, TokenizerError> {
        let format_error = |problem: String| TokenizerError::Format {
            path: path.clone(),
            problem,
        };
        let mut inner = tokenizers::Tokenizer::from_bytes(json)
            .map_err(|error| format_error(error.to_string()))?;
        // A user's "<|endoftext|>" is treated as text, because as a token it would end the prompt early.
        inner.set_encode_special_tokens(true);
        // This crate pads and truncates by itself, whatever the file asks for.
        inner.with_padding(None);
        inner
            .with_truncation(None)
            .map_err(|error| format_error(error.to_string()))?;
        let end = inner
            .get_vocab(true)
            .into_values()
            .max()
            .ok_or_else(|| format_error("it has no tokens".into()))?;
        if end as usize >= vocab_size {
            return Err(TokenizerError::Vocabulary {
                path,
                largest: end,
                vocab_size,
            });
        }
        let probe = inner
            .encode_fast("a", true)
            .map_err(|error| format_error(error.to_string()))?;
        if probe.get_ids().last() != Some(&end) {
            return Err(TokenizerError::End {
                path,
                end,
                found: probe.get_ids().to_vec(),
            });
        }
        let empty = inner
            .encode_fast("", true)
            .map_err(|error| format_error(error.to_string()))?;
        Ok(FileTokenizer {
            empty_ids: empty.get_ids().to_vec(),
            inner,
            end,
        })
    }

    /// Returns the ids of a prompt with the special tokens that the file puts around it, or a description of the problem.
    pub(crate) fn ids(&self, prompt: &str) -> Result<Vec<u32>, String> {
        let encoding = self
            .inner
            .encode_fast(prompt, true)
            .map_err(|error| error.to_string())?;
        let ids = encoding.get_ids().to_vec();
        if ids == self.empty_ids {
            return Err("it has no token that the model knows".into());
        }
        Ok(ids)
    }

    /// Returns the number of special tokens that the file puts around those of a text.
    pub(crate) fn special_tokens(&self) -> usize {
        self.empty_ids.len()
    }

    /// Returns the ids of a text without words.
    pub(crate) fn empty_ids(&self) -> &[u32] {
        &self.empty_ids
    }

    /// Returns the id of the end token, which is the largest id.
    pub(crate) fn end(&self) -> u32 {
        self.end
    }
}
