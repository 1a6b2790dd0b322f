//! The packed form: `motions.safetensors` with all rows, and `captions.jsonl` with one line per entry.

mod line;
mod read;
mod write;

pub(crate) use read::open;
pub(crate) use write::{check_free, write};

/// The file with all rows.
pub(crate) const MOTIONS: &str = "motions.safetensors";
/// The file with all entries.
pub(crate) const CAPTIONS: &str = "captions.jsonl";
