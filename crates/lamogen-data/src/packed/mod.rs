//! The packed form: `motions.safetensors` with all rows, `captions.jsonl` with a line an entry.

mod line;
mod read;
mod write;

pub(crate) use read::open;
pub(crate) use write::{check_free, write};

/// The file of all rows.
pub(crate) const MOTIONS: &str = "motions.safetensors";
/// The file of all entries.
pub(crate) const CAPTIONS: &str = "captions.jsonl";
