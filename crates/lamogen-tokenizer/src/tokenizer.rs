//! Prompts as padded rows of ids.

use lamogen_io::placeholder;
use std::path::Path;
use std::sync::Arc;

use crate::TokenizerError;
use crate::clip::{self, ClipTokenizer};
use crate::file::FileTokenizer;

/// Turns a prompt into the ids that the text encoder was trained on.
///
/// Prompts are padded with id 0 and cut so that the end token stays; the end token has the largest
/// id, which is how CLIP's text tower finds it. Cloning is cheap.
#[derive(Clone, Debug)]
pub struct Tokenizer {
    source: Source,
    context_length: usize,
}

#[derive(Clone, Debug)]
enum Source {
    Clip(Arc<ClipTokenizer>),
    File(Arc<FileTokenizer>),
}

/// A tokenized prompt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tokens {
    /// Ids, padded with 0 to the context length.
    pub ids: Vec<u32>,
    /// How many tokens of the prompt did not fit.
    pub cut: usize,
    /// How many tokens the prompt has of its own, beside those of start and end.
    pub own: usize,
}

impl Tokenizer {
    /// CLIP's own tokenizer for a text tower with `context_length` positions, 77 in every CLIP of
    /// OpenAI's. No file is read.
    ///
    /// The ids are those of `clip.tokenize` with `truncate=True`, cleaning of the text included:
    /// 0 to 49405 for text, 49406 at the start and 49407 at the end. As there,
    ///
    /// - a literal `<|startoftext|>` or `<|endoftext|>` in a prompt gives that token, in any case of
    ///   its letters. The text tower reads up to the first end token; a prompt can end itself early;
    /// - a text without tokens is no error, it gives start and end.
    ///
    /// Building it takes tens of milliseconds: build one and clone it.
    pub fn clip(context_length: usize) -> Self {
        Tokenizer {
            source: Source::Clip(Arc::new(ClipTokenizer::new())),
            context_length,
        }
    }

    /// Reads a `tokenizer.json` for a text tower with `vocab_size` ids and `context_length`
    /// positions.
    ///
    /// A user's `<|endoftext|>` is text here, and a prompt without tokens is refused.
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
        if let Some(problem) = placeholder(json) {
            return Err(TokenizerError::Format {
                path: name.as_ref().to_owned(),
                problem: problem.to_owned(),
            });
        }
        let file = FileTokenizer::from_json(json, name.as_ref().to_owned(), vocab_size)?;
        Ok(Tokenizer {
            source: Source::File(Arc::new(file)),
            context_length,
        })
    }

    /// The ids of a prompt.
    ///
    /// # Errors
    ///
    /// If the tokenizer cannot encode it, or with a tokenizer from a file finds no token in it, or with
    /// CLIP's it is longer than 100,000 bytes.
    pub fn encode(&self, prompt: &str) -> Result<Tokens, TokenizerError> {
        let (ids, end, around) = match &self.source {
            Source::Clip(clip) => (clip.ids(prompt), clip::END, clip::AROUND),
            Source::File(file) => (file.ids(prompt), file.end(), file.around()),
        };
        let mut ids = ids.map_err(|problem| TokenizerError::Prompt {
            prompt: prompt.into(),
            problem,
        })?;
        let own = ids.len().saturating_sub(around);
        let cut = ids.len().saturating_sub(self.context_length);
        ids.resize(self.context_length, 0);
        if let (1.., Some(last)) = (cut, ids.last_mut()) {
            *last = end;
        }
        Ok(Tokens { ids, cut, own })
    }

    /// Number of ids of a padded prompt.
    pub fn context_length(&self) -> usize {
        self.context_length
    }

    /// The ids of a text without words: what a network sees that was trained with text dropout where nothing is said.
    pub fn unconditional(&self) -> Tokens {
        let mut ids = match &self.source {
            Source::Clip(_) => vec![clip::START, clip::END],
            Source::File(file) => file.empty().to_vec(),
        };
        ids.resize(self.context_length, 0);
        Tokens {
            ids,
            cut: 0,
            own: 0,
        }
    }

    /// Number of embeddings that a text tower needs for this tokenizer's ids: 49408 for CLIP's.
    pub fn vocab_size(&self) -> usize {
        let end = match &self.source {
            Source::Clip(_) => clip::END,
            Source::File(file) => file.end(),
        };
        end as usize + 1
    }
}
