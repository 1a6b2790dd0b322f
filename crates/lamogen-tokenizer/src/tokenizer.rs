//! The tokenizer, which converts prompts to padded rows of ids.

use lamogen_io::placeholder;
use std::path::Path;
use std::sync::Arc;

use crate::TokenizerError;
use crate::clip::{self, ClipTokenizer};
use crate::file::FileTokenizer;

/// A tokenizer, which converts a prompt to the ids that the text encoder was trained on.
///
/// Prompts that are too long are truncated, but keep the end token. For the text towers of CLIP's kind, prompts are padded
/// with id 0, and the end token has the largest id, by which the tower finds it. The ids of a
/// [WordPiece](Self::word_piece_from_file) tokenizer are not padded. Cloning is cheap.
#[derive(Clone, Debug)]
pub struct Tokenizer {
    kind: TokenizerKind,
    context_length: usize,
}

/// CLIP's tokenizer or one from a file.
#[derive(Clone, Debug)]
enum TokenizerKind {
    Clip(Arc<ClipTokenizer>),
    File(Arc<FileTokenizer>),
    WordPiece(Arc<FileTokenizer>),
}

/// A tokenized prompt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tokens {
    /// The ids. Those of a tokenizer for a text tower of CLIP's kind are padded with 0 to the context length.
    pub ids: Vec<u32>,
    /// The number of ids that are not padding, with the start and end tokens. The last of them is the end token.
    pub length: usize,
    /// The number of tokens that did not fit and were removed.
    pub cut: usize,
    /// The number of tokens of the prompt itself, without the start and end tokens. Removed tokens are counted.
    pub own: usize,
}

impl Tokenizer {
    /// Creates CLIP's own tokenizer for a text tower with `context_length` positions (77 in all of OpenAI's CLIP models).
    ///
    /// No file is read. The ids are those of `clip.tokenize` with `truncate=True`, including the cleaning of the text:
    /// 0 to 49405 for text, 49406 at the start and 49407 at the end. As in `clip.tokenize`,
    ///
    /// - a literal `<|startoftext|>` or `<|endoftext|>` in a prompt, in upper or lower case, gives that token. The text
    ///   tower reads up to the first end token, so a prompt can end itself early;
    /// - a text without tokens is no error, but gives the start and end tokens.
    ///
    /// Creating the tokenizer takes tens of milliseconds, so create it once and clone it.
    pub fn clip(context_length: usize) -> Self {
        Tokenizer {
            kind: TokenizerKind::Clip(Arc::new(ClipTokenizer::new())),
            context_length,
        }
    }

    /// Reads a `tokenizer.json` for a text tower with `vocab_size` ids and `context_length` positions.
    ///
    /// A literal `<|endoftext|>` in a prompt is treated as text, and a prompt without tokens is refused.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a tokenizer, has ids beyond the vocabulary, or does not end its texts with its
    /// largest id.
    pub fn from_file(
        path: impl AsRef<Path>,
        vocab_size: usize,
        context_length: usize,
    ) -> Result<Self, TokenizerError> {
        let path = path.as_ref();
        Self::from_json(&read_file(path)?, path, vocab_size, context_length)
    }

    /// Reads the `tokenizer.json` of a BERT, such as `distilbert-base-uncased`, with `vocab_size` embeddings and
    /// `context_length` positions.
    ///
    /// Such a tokenizer splits texts into word pieces between the tokens `[CLS]` and `[SEP]`. A literal `[SEP]` in a prompt
    /// is treated as text.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a tokenizer, has ids beyond the vocabulary, or does not put `[CLS]` and `[SEP]`
    /// around its texts.
    pub fn word_piece_from_file(
        path: impl AsRef<Path>,
        vocab_size: usize,
        context_length: usize,
    ) -> Result<Self, TokenizerError> {
        let path = path.as_ref();
        let json = read_file(path)?;
        check_placeholder(&json, path)?;
        let file = FileTokenizer::word_piece_from_json(&json, path.to_owned(), vocab_size)?;
        Ok(Tokenizer {
            kind: TokenizerKind::WordPiece(Arc::new(file)),
            context_length,
        })
    }

    /// Reads a tokenizer like [`from_file`](Self::from_file), but from the content of the file. `name` is used in error
    /// messages.
    ///
    /// # Errors
    ///
    /// The same as those of [`from_file`](Self::from_file).
    pub fn from_json(
        json: &[u8],
        name: impl AsRef<Path>,
        vocab_size: usize,
        context_length: usize,
    ) -> Result<Self, TokenizerError> {
        check_placeholder(json, name.as_ref())?;
        let file = FileTokenizer::from_json(json, name.as_ref().to_owned(), vocab_size)?;
        Ok(Tokenizer {
            kind: TokenizerKind::File(Arc::new(file)),
            context_length,
        })
    }

    /// Encodes a prompt as ids.
    ///
    /// # Errors
    ///
    /// If the tokenizer cannot encode the prompt; if a tokenizer from a file finds no token in it; or, with CLIP's
    /// tokenizer, if the prompt is longer than 100,000 bytes.
    pub fn encode(&self, prompt: &str) -> Result<Tokens, TokenizerError> {
        let (ids, end, special_tokens) = match &self.kind {
            TokenizerKind::Clip(clip) => (clip.ids(prompt), clip::END, clip::SPECIAL_TOKENS),
            TokenizerKind::File(file) | TokenizerKind::WordPiece(file) => {
                (file.ids(prompt), file.end(), file.special_tokens())
            }
        };
        let mut ids = ids.map_err(|problem| TokenizerError::Prompt {
            prompt: prompt.into(),
            problem,
        })?;
        let own = ids.len().saturating_sub(special_tokens);
        let cut = ids.len().saturating_sub(self.context_length);
        ids.truncate(self.context_length);
        if let (1.., Some(last)) = (cut, ids.last_mut()) {
            *last = end;
        }
        let length = ids.len();
        self.pad(&mut ids);
        Ok(Tokens {
            ids,
            length,
            cut,
            own,
        })
    }

    /// Pads ids to the context length, if the text encoder reads padding.
    fn pad(&self, ids: &mut Vec<u32>) {
        match self.kind {
            TokenizerKind::Clip(_) | TokenizerKind::File(_) => ids.resize(self.context_length, 0),
            TokenizerKind::WordPiece(_) => {}
        }
    }

    /// Returns the largest number of ids of a prompt, to which the tokenizers of CLIP's kind pad all prompts.
    pub fn context_length(&self) -> usize {
        self.context_length
    }

    /// Returns the ids of a text without words.
    ///
    /// A network that was trained with text dropout reads these ids where the text is dropped.
    pub fn unconditional(&self) -> Tokens {
        let mut ids = match &self.kind {
            TokenizerKind::Clip(_) => vec![clip::START, clip::END],
            TokenizerKind::File(file) | TokenizerKind::WordPiece(file) => file.empty_ids().to_vec(),
        };
        let length = ids.len();
        self.pad(&mut ids);
        Tokens {
            ids,
            length,
            cut: 0,
            own: 0,
        }
    }

    /// Returns the number of embeddings that a text tower needs for this tokenizer's ids (49408 for CLIP's tokenizer).
    pub fn vocab_size(&self) -> usize {
        let largest = match &self.kind {
            TokenizerKind::Clip(_) => clip::END,
            TokenizerKind::File(file) | TokenizerKind::WordPiece(file) => file.largest(),
        };
        largest as usize + 1
    }
}

/// Reads the bytes of a file.
fn read_file(path: &Path) -> Result<Vec<u8>, TokenizerError> {
    std::fs::read(path).map_err(|reason| TokenizerError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// Checks that the bytes are not something else in the place of a file, such as a pointer of Git LFS.
fn check_placeholder(bytes: &[u8], path: &Path) -> Result<(), TokenizerError> {
    match placeholder(bytes) {
        Some(problem) => Err(TokenizerError::Format {
            path: path.to_owned(),
            problem: problem.to_owned(),
        }),
        None => Ok(()),
    }
}
