//! The embedded model as a user's folder.

use std::path::Path;

/// Writes it into a folder that is there.
pub fn write(folder: &Path) {
    for (name, bytes) in [
        ("config.json", lamogen_compact::CONFIG),
        ("model.safetensors", lamogen_compact::WEIGHTS),
        ("tokenizer.json", lamogen_compact::TOKENIZER),
        ("mean.npy", lamogen_compact::MEAN),
        ("std.npy", lamogen_compact::STD),
        ("words.txt", lamogen_compact::WORDS.as_bytes()),
    ] {
        std::fs::write(folder.join(name), bytes).unwrap();
    }
}
