//! The errors of this crate.

use std::path::PathBuf;

/// An error of a tokenizer or a prompt.
#[derive(Debug, thiserror::Error)]
pub enum TokenizerError {
    /// The file cannot be read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io {
        path: PathBuf,
        reason: std::io::Error,
    },
    /// The file is not a tokenizer.
    #[error("{path}: not a tokenizer: {problem}")]
    #[allow(missing_docs)]
    Format { path: PathBuf, problem: String },
    /// The tokenizer has more ids than the network has embeddings.
    #[error(
        "{path}: the tokenizer's ids go up to {largest}, but the model has embeddings for {vocab_size} ids only, 0 to {last}",
        last = .vocab_size.saturating_sub(1)
    )]
    #[allow(missing_docs)]
    Vocabulary {
        path: PathBuf,
        largest: u32,
        vocab_size: usize,
    },
    /// The tokenizer does not end a text with its largest id.
    #[error(
        "{path}: expected texts to end with the tokenizer's largest id, {end}; a probe gave {found:?}"
    )]
    #[allow(missing_docs)]
    End {
        path: PathBuf,
        end: u32,
        found: Vec<u32>,
    },
    /// The tokenizer is not that of a BERT.
    #[error(
        "{path}: expected a WordPiece tokenizer that puts [CLS] and [SEP] around a text, as that of distilbert-base-uncased; a probe gave {found:?}"
    )]
    #[allow(missing_docs)]
    WordPiece { path: PathBuf, found: Vec<u32> },
    /// The prompt cannot be encoded.
    #[error("the prompt {prompt:?} cannot be tokenized: {problem}")]
    #[allow(missing_docs)]
    Prompt { prompt: String, problem: String },
    /// A tokenizer cannot be trained.
    #[error("no tokenizer can be learned: {problem}")]
    #[allow(missing_docs)]
    Learning { problem: String },
}
