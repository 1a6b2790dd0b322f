//! From a model folder to the files that the crate lamogen-compact embeds.

use std::collections::HashMap;
use std::error::Error;
use std::io::Write;
use std::path::Path;

use burn::tensor::Device;
use lamogen::LaMoGen;
use lamogen_model::Precision;
use lamogen_motion::write_atomically;

/// Files that are taken as they are.
const COPIED: [&str; 5] = [
    "config.json",
    "tokenizer.json",
    "words.txt",
    "mean.npy",
    "std.npy",
];

/// Writes the folder's weights in few bits with their licence beside, and copies the rest. Answers
/// with the size of the weights' file.
///
/// # Errors
///
/// If a file is missing, damaged or cannot be written.
pub fn run(
    from: &Path,
    to: &Path,
    precision: Precision,
    license: String,
    attribution: String,
) -> Result<u64, Box<dyn Error>> {
    // Everything is read and checked before anything is written.
    let model = LaMoGen::load(from, &Device::flex())?;
    let read = |name: &str| {
        let path = from.join(name);
        std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))
    };
    let copied = COPIED
        .iter()
        .map(|name| Ok((*name, read(name)?)))
        .collect::<Result<Vec<(&str, Vec<u8>)>, String>>()?;
    std::fs::create_dir_all(to).map_err(|error| format!("{}: {error}", to.display()))?;
    let weights = to.join("model.safetensors");
    let metadata = HashMap::from([
        ("license".to_owned(), license),
        ("attribution".to_owned(), attribution),
    ]);
    model.network().save(&weights, precision, metadata)?;
    for (name, bytes) in copied {
        let path = to.join(name);
        write_atomically(&path, |file| file.write_all(&bytes))
            .map_err(|error| format!("{}: {error}", path.display()))?;
    }
    Ok(std::fs::metadata(weights)?.len())
}
