//! Text as token ids.
//!
//! ```text
//!                        ┌─ Tokenizer::clip       clean ─▶ words ─▶ byte pairs ─┐
//! prompt ──encode──▶ ────┤                                                      ├─▶ ids, padded or cut
//!                        └─ Tokenizer::from_file  what the tokenizer.json says ─┘
//! ```
//!
//! [`Tokenizer::clip`] is the tokenizer of OpenAI's CLIP and needs no file: the merges are part of
//! the program. [`Tokenizer::from_file`] reads a `tokenizer.json` of the Hugging Face `tokenizers`
//! library. Both pad and cut in the same way.
//!
//! ```
//! let tokenizer = lamogen_tokenizer::Tokenizer::clip(77);
//! let tokens = tokenizer.encode("A person jumps").unwrap();
//! assert_eq!(tokens.ids[..6], [49406, 320, 2533, 18911, 49407, 0]);
//! ```
//!
//! # Cleaning
//!
//! CLIP's texts go through the Python library ftfy and through `html.unescape`, twice; `clean.rs` and
//! the files below it do what ftfy 6.3.1 and Python 3.11 do. The Rust port `plsfix` 0.1.8 does not:
//! it follows an older ftfy, leaves terminal escapes in the text, and brings all of ICU. HTML's names
//! come from the crate `entities`, Unicode's normal form from `unicode-normalization`.
//!
//! # Byte pairs
//!
//! The merges are OpenAI's (`data/`, with their licence); `tokenizers` applies them. The crate
//! `instant-clip-tokenizer` has them too, but spells the special tokens otherwise, takes time
//! quadratic in the length of a word, and brings the four fifths of the list that CLIP leaves out.

#![warn(missing_docs)]

mod clean;
mod clip;
mod error;
mod file;
mod tokenizer;
mod train;
mod words;

pub use error::TokenizerError;
pub use tokenizer::{Tokenizer, Tokens};
pub use train::train_tokenizer;
pub use words::{KnownWords, words};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
