//! The conversion of a model folder to the files that the crate lamogen-compact embeds.

use std::collections::HashMap;
use std::error::Error;
use std::io::Write;
use std::path::Path;

use burn::tensor::Device;
use lamogen::LaMoGen;
use lamogen_model::Precision;
use lamogen_motion::write_atomically;

/// The files that are copied without changes.
const COPIED: [&str; 5] = [
    "config.json",
    "tokenizer.json",
    "words.txt",
    "mean.npy",
    "std.npy",
];

/// Writes the weights of a model folder at a lower precision, with their licence as metadata, and copies the other files.
/// Returns the size of the file of weights in bytes.
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
    // All files are read and checked before any file is written.
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
    let network = model.network().motion_diffuse();
    let network = network.ok_or("expected a network like MotionDiffuse, found an MDM")?;
    network.save(&weights, precision, metadata)?;
    for (name, bytes) in copied {
        let path = to.join(name);
        write_atomically(&path, |file| file.write_all(&bytes))
            .map_err(|error| format!("{}: {error}", path.display()))?;
    }
    Ok(std::fs::metadata(weights)?.len())
}
