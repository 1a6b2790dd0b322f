//! Tokenizers from a `tokenizer.json` of the Hugging Face `tokenizers` library.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::TokenizerError;

/// A tokenizer that its file describes. The file's padding and truncation are not used.
#[derive(Clone, Debug)]
pub(crate) struct FileTokenizer {
    inner: tokenizers::Tokenizer,
    end: u32,
    largest: u32,
    /// The ids of a text without tokens of its own.
    empty_ids: Vec<u32>,
}

impl FileTokenizer {
    /// Reads a tokenizer whose end token has the largest id. `path` is used in error messages.
    pub(crate) fn from_json(
        json: &[u8],
        path: PathBuf,
        vocab_size: usize,
    ) -> Result<Self, TokenizerError> {
        let mut tokenizer = Self::read(json, &path, vocab_size)?;
        let (probe, end) = (tokenizer.probe(&path)?, tokenizer.largest);
        if probe.last() != Some(&end) {
            return Err(TokenizerError::End {
                path,
                end,
                found: probe,
            });
        }
        tokenizer.end = end;
        Ok(tokenizer)
    }

    /// Reads a tokenizer that puts BERT's tokens `[CLS]` and `[SEP]` around a text. `path` is used in error messages.
    pub(crate) fn word_piece_from_json(
        json: &[u8],
        path: PathBuf,
        vocab_size: usize,
    ) -> Result<Self, TokenizerError> {
        let mut tokenizer = Self::read(json, &path, vocab_size)?;
        let probe = tokenizer.probe(&path)?;
        let vocabulary = |token| tokenizer.inner.token_to_id(token);
        let ends = [probe.first(), probe.last()].map(|id| id.copied());
        match (vocabulary("[CLS]"), vocabulary("[SEP]")) {
            (Some(start), Some(end)) if ends == [Some(start), Some(end)] => tokenizer.end = end,
            _ => return Err(TokenizerError::WordPiece { path, found: probe }),
        }
        Ok(tokenizer)
    }

    /// Encodes a short text.
    fn probe(&self, path: &Path) -> Result<Vec<u32>, TokenizerError> {
        let probe = self.inner.encode_fast("a", true);
        let probe = probe.map_err(|error| TokenizerError::Format {
            path: path.to_owned(),
            problem: error.to_string(),
        })?;
        Ok(probe.get_ids().to_vec())
    }

    /// Reads a tokenizer whose end token is not known yet.
    fn read(json: &[u8], path: &Path, vocab_size: usize) -> Result<Self, TokenizerError> {
        let format_error = |problem: String| TokenizerError::Format {
            path: path.to_owned(),
            problem,
        };
        check_file(json).map_err(format_error)?;
        let mut inner = tokenizers::Tokenizer::from_bytes(json)
            .map_err(|error| format_error(error.to_string()))?;
        // A user's "<|endoftext|>" is treated as text, because as a token it would end the prompt early.
        inner.set_encode_special_tokens(true);
        // This crate pads and truncates by itself, whatever the file asks for.
        inner.with_padding(None);
        inner
            .with_truncation(None)
            .map_err(|error| format_error(error.to_string()))?;
        let largest = inner
            .get_vocab(true)
            .into_values()
            .max()
            .ok_or_else(|| format_error("it has no tokens".into()))?;
        if largest as usize >= vocab_size {
            return Err(TokenizerError::Vocabulary {
                path: path.to_owned(),
                largest,
                vocab_size,
            });
        }
        let empty = inner
            .encode_fast("", true)
            .map_err(|error| format_error(error.to_string()))?;
        Ok(FileTokenizer {
            empty_ids: empty.get_ids().to_vec(),
            inner,
            end: largest,
            largest,
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

    /// Returns the id of the end token.
    pub(crate) fn end(&self) -> u32 {
        self.end
    }

    /// Returns the largest id.
    pub(crate) fn largest(&self) -> u32 {
        self.largest
    }
}

/// Checks what the library takes from a file without a check of its own, and panics on later: templates of special tokens,
/// and merges of parts of words.
fn check_file(json: &[u8]) -> Result<(), String> {
    let file: Value = serde_json::from_slice(json).map_err(|error| error.to_string())?;
    file.get("model").map_or(Ok(()), check_merges)?;
    file.get("post_processor").map_or(Ok(()), check_template)
}

/// Checks that the second part of every merge begins as continued words do.
fn check_merges(model: &Value) -> Result<(), String> {
    let prefix = model
        .get("continuing_subword_prefix")
        .and_then(Value::as_str);
    let merges = model.get("merges").and_then(Value::as_array);
    let (Some(prefix), Some(merges)) = (prefix, merges) else {
        return Ok(());
    };
    for (index, merge) in merges.iter().enumerate() {
        // A pair is an array of two texts, or a text with a space between them.
        let second = match merge.as_str() {
            Some(pair) => pair.split_once(' ').map(|(_, second)| second),
            None => merge.get(1).and_then(Value::as_str),
        };
        if let Some(second) = second.filter(|second| !second.starts_with(prefix)) {
            return Err(format!(
                "model.merges[{index}]: expected a second part that begins with {prefix:?}, found {second:?}"
            ));
        }
    }
    Ok(())
}

/// Checks a post-processor, and those within it.
fn check_template(processor: &Value) -> Result<(), String> {
    if let Some(processors) = processor.get("processors").and_then(Value::as_array) {
        processors.iter().try_for_each(check_template)?;
    }
    let Some(pieces) = processor.get("single").and_then(Value::as_array) else {
        return Ok(());
    };
    for piece in pieces {
        // The fields of a piece may have names or be an array in their order.
        let id = |kind: &str| {
            piece
                .get(kind)
                .and_then(|piece| piece.get("id").or(piece.get(0)))
        };
        if let Some(id) = id("SpecialToken").and_then(Value::as_str)
            && processor
                .get("special_tokens")
                .and_then(|all| all.get(id))
                .is_none()
        {
            return Err(format!(
                "post_processor: expected {id:?} among the special_tokens, found it only in the template"
            ));
        }
        if id("Sequence").is_some_and(|id| id != "A") {
            return Err("post_processor: expected the sequence A in the template of a single text, found another".into());
        }
    }
    Ok(())
}
