//! Text as token ids.

use std::path::{Path, PathBuf};

/// Turns a prompt into the ids that the text encoder was trained on.
///
/// Wraps a `tokenizer.json` of the Hugging Face `tokenizers` library. Prompts are padded with id 0
/// and cut so that the end token stays; the end token has the largest id, which is how CLIP's text
/// tower finds it.
#[derive(Clone, Debug)]
pub struct Tokenizer {
    inner: tokenizers::Tokenizer,
    context_length: usize,
    end: u32,
    /// What a text without tokens of its own gives.
    empty: Vec<u32>,
}

/// A tokenized prompt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tokens {
    /// Ids, padded with 0 to the context length.
    pub ids: Vec<u32>,
    /// How many tokens of the prompt did not fit.
    pub cut: usize,
}

/// What is wrong with a tokenizer or a prompt.
#[derive(Debug, thiserror::Error)]
pub enum TokenizerError {
    /// The file cannot be read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// The file is no tokenizer.
    #[error("{path}: not a tokenizer: {problem}")]
    #[allow(missing_docs)]
    Format { path: PathBuf, problem: String },
    /// The tokenizer knows more ids than the network has embeddings.
    #[error(
        "{path}: the tokenizer's ids go up to {largest}, but the model has embeddings for 0 to {last} only",
        last = .vocab_size - 1
    )]
    #[allow(missing_docs)]
    Vocabulary {
        path: PathBuf,
        largest: u32,
        vocab_size: usize,
    },
    /// The tokenizer does not close a text with its largest id.
    #[error(
        "{path}: expected texts to end with the tokenizer's largest id, {end}; a probe gave {found:?}"
    )]
    #[allow(missing_docs)]
    End {
        path: PathBuf,
        end: u32,
        found: Vec<u32>,
    },
    /// The prompt cannot be encoded.
    #[error("the prompt {prompt:?} cannot be tokenized: {problem}")]
    #[allow(missing_docs)]
    Prompt { prompt: String, problem: String },
}

impl Tokenizer {
    /// Reads a `tokenizer.json` for a text tower with `vocab_size` ids and `context_length`
    /// positions.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is no tokenizer, has ids beyond the vocabulary, or does not end
    /// its texts with its largest id.
    pub fn from_file(
        path: impl AsRef<Path>,
        vocab_size: usize,
        context_length: usize,
    ) -> Result<Self, TokenizerError> {
        let path = path.as_ref();
        let json = std::fs::read(path).map_err(|reason| TokenizerError::Io {
            path: path.to_owned(),
            reason,
        })?;
        Self::from_json(&json, path, vocab_size, context_length)
    }

    /// As [`from_file`](Self::from_file), from the file's content; `name` stands in error messages.
    ///
    /// # Errors
    ///
    /// As [`from_file`](Self::from_file).
    pub fn from_json(
        json: &[u8],
        name: impl AsRef<Path>,
        vocab_size: usize,
        context_length: usize,
    ) -> Result<Self, TokenizerError> {
        let path = name.as_ref().to_owned();
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
        Ok(Tokenizer {
            empty: empty.get_ids().to_vec(),
            inner,
            context_length,
            end,
        })
    }

    /// The ids of a prompt.
    ///
    /// # Errors
    ///
    /// If the tokenizer cannot encode it, or finds no token in it.
    pub fn encode(&self, prompt: &str) -> Result<Tokens, TokenizerError> {
        let encoding =
            self.inner
                .encode_fast(prompt, true)
                .map_err(|error| TokenizerError::Prompt {
                    prompt: prompt.into(),
                    problem: error.to_string(),
                })?;
        let mut ids = encoding.get_ids().to_vec();
        if ids == self.empty {
            return Err(TokenizerError::Prompt {
                prompt: prompt.into(),
                problem: "it has no token that the model knows".into(),
            });
        }
        let cut = ids.len().saturating_sub(self.context_length);
        ids.resize(self.context_length, 0);
        if let (1.., Some(last)) = (cut, ids.last_mut()) {
            *last = self.end;
        }
        Ok(Tokens { ids, cut })
    }

    /// Number of ids of a padded prompt.
    pub fn context_length(&self) -> usize {
        self.context_length
    }
}
