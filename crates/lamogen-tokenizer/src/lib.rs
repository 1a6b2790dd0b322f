//! Conversion of text to token ids.
//!
//! ```text
//!                        ┌─ Tokenizer::clip       clean ─▶ words ─▶ byte pairs ─┐
//! prompt ──encode──▶ ────┤                                                      ├─▶ ids, padded or truncated
//!                        └─ Tokenizer::from_file  what the tokenizer.json says ─┘
//! ```
//!
//! [`Tokenizer::clip`] is the tokenizer of OpenAI's CLIP and needs no file, because its merges are part of the program.
//! [`Tokenizer::from_file`] reads a `tokenizer.json` of the Hugging Face `tokenizers` library. Both tokenizers pad and
//! truncate in the same way.
//!
//! ```
//! let tokenizer = lamogen_tokenizer::Tokenizer::clip(77);
//! let tokens = tokenizer.encode("A person jumps").unwrap();
//! assert_eq!(tokens.ids[..6], [49406, 320, 2533, 18911, 49407, 0]);
//! ```
//!
//! # Cleaning
//!
//! CLIP passes its texts through the Python library ftfy and then twice through `html.unescape`. `clean.rs` and the files
//! in `clean/` do the same as ftfy 6.3.1 and Python 3.11. The Rust port `plsfix` 0.1.8 differs: it follows an older ftfy,
//! leaves terminal escapes in the text, and depends on all of ICU. The names of HTML's character references come from the
//! crate `entities`, and Unicode's normal form from `unicode-normalization`.
//!
//! # Byte pairs
//!
//! The merges are OpenAI's (`data/`, with their licence), and the crate `tokenizers` applies them. The crate
//! `instant-clip-tokenizer` has the same merges, but it spells the special tokens differently, takes time quadratic in the
//! length of a word, and includes the four fifths of the list that CLIP does not use.

#![warn(missing_docs)]

mod clean;
mod clip;
mod error;
mod file;
mod function_words;
mod tokenizer;
mod train;
mod words;

pub use error::TokenizerError;
pub use tokenizer::{Tokenizer, Tokens};
pub use train::train_tokenizer;
pub use words::{WordList, words};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
