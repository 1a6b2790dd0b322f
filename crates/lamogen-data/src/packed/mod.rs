//! The packed form: `motions.safetensors` with all rows, `captions.jsonl` with a line an entry.

mod line;
mod read;

pub(crate) use read::open;

/// The file of all rows.
pub(crate) const MOTIONS: &str = "motions.safetensors";
/// The file of all entries.
pub(crate) const CAPTIONS: &str = "captions.jsonl";
