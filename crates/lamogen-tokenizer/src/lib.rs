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
//! CLIP was trained on text that had gone through the Python library ftfy 6.3 and `html.unescape`,
//! and so are its prompts here; what they do is the source of behaviour of `clean.rs` and the files
//! below it. The Rust port `plsfix` (0.1.8) is not used: it follows an older ftfy, leaves terminal
//! escapes in the text, and brings all of ICU. HTML's names come from the crate `entities`, merging
//! of byte pairs from `tokenizers`.

#![warn(missing_docs)]

mod clean;
mod clip;
mod error;
mod file;
mod tokenizer;

pub use error::TokenizerError;
pub use tokenizer::{Tokenizer, Tokens};
