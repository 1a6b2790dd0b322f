//! The identity of a run, so that a folder is only used by the run that began it.

use std::io::{self, Write};
use std::path::Path;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;
use lamogen_data::{Checksum, Dataset};
use lamogen_motion::write_atomically;
use serde::Serialize;
use serde_json::{Value, json};

use crate::tokens::CaptionTokens;

/// Returns the identity of a run: what is trained, its config, and a checksum of its data.
///
/// Two runs have different identities if their configs differ, or the names, lengths, splits, contents, caption ids or statistics
/// of their data. The motions themselves are not compared.
pub fn identity(
    what: &str,
    config: &impl Serialize,
    dataset: &Dataset,
    tokens: &CaptionTokens,
) -> Value {
    let mut checksum = Checksum::new(0);
    for (index, entry) in dataset.entries().iter().enumerate() {
        add_text(&mut checksum, &entry.name);
        add_text(&mut checksum, entry.split.name());
        checksum.add(&[u8::from(entry.mirror)]);
        checksum.add(&(entry.frames as u64).to_le_bytes());
        for word in [&entry.content, &entry.style] {
            add_text(&mut checksum, word.as_deref().unwrap_or_default());
        }
        for caption in 0..entry.captions.len() {
            for ids in tokens.phrasings(index, caption) {
                for id in ids {
                    checksum.add(&id.to_le_bytes());
                }
            }
        }
    }
    for number in dataset.mean().iter().chain(dataset.std()) {
        checksum.add(&number.to_le_bytes());
    }
    json!({
        "what": what,
        "config": config,
        "entries": dataset.entries().len(),
        "frames": dataset.entries().iter().map(|entry| entry.frames).sum::<usize>(),
        "checksum": format!("{:016x}", checksum.value()),
    })
}

/// Returns a checksum of all weights of a network, for the identity of a run that begins with them.
pub fn fingerprint(network: &impl Module) -> String {
    let mut visitor = WeightChecksum(Checksum::new(0));
    network.visit(&mut visitor);
    format!("{:016x}", visitor.0.value())
}

/// Adds the weights of a network to a checksum.
struct WeightChecksum(Checksum);

impl ModuleVisitor for WeightChecksum {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let values = param.val().try_into_vec_as::<f32>();
        for value in values.expect("floats convert to f32") {
            self.0.add(&value.to_le_bytes());
        }
    }
}

/// The error of a folder whose identity file does not allow work in it.
pub(crate) enum IdentityError {
    /// The file cannot be read or written.
    Io(io::Error),
    /// The file is not JSON.
    Format(serde_json::Error),
    /// The folder holds other work: the first value that differs, as expected and as found, each in the form `path = value`.
    Mismatch { expected: String, found: String },
}

/// Writes the identity of the work in a folder to a new file, or compares it with the identity in an existing file.
pub(crate) fn write_or_check_identity(path: &Path, identity: &Value) -> Result<(), IdentityError> {
    let bytes = match std::fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let text = serde_json::to_string_pretty(identity).expect("values are JSON");
            return write_atomically(path, |file| file.write_all(text.as_bytes()))
                .map_err(IdentityError::Io);
        }
        bytes => bytes.map_err(IdentityError::Io)?,
    };
    let stored: Value = serde_json::from_slice(&bytes).map_err(IdentityError::Format)?;
    // Both are parsed by the same reader, which may lose the last bit of a number.
    let text = identity.to_string();
    let identity: Value = serde_json::from_str(&text).expect("just written");
    // A difference in what is trained is reported before all others, since it explains them.
    let what = first_difference("what", &identity["what"], &stored["what"]);
    match what.or_else(|| first_difference("", &identity, &stored)) {
        None => Ok(()),
        Some((path, expected, found)) => Err(IdentityError::Mismatch {
            expected: format!("{path} = {expected}"),
            found: format!("{path} = {found}"),
        }),
    }
}

/// Returns the path of the first difference of two JSON values, such as `optimization.seed`, and both values there.
pub(crate) fn first_difference(path: &str, a: &Value, b: &Value) -> Option<(String, Value, Value)> {
    if let (Value::Object(a), Value::Object(b)) = (a, b) {
        let keys = a.keys().chain(b.keys());
        return keys.into_iter().find_map(|key| {
            let path = match path {
                "" => key.clone(),
                path => format!("{path}.{key}"),
            };
            let missing = &Value::Null;
            let (a, b) = (a.get(key).unwrap_or(missing), b.get(key).unwrap_or(missing));
            first_difference(&path, a, b)
        });
    }
    (a != b).then(|| (path.to_owned(), a.clone(), b.clone()))
}

/// Adds a text to a checksum, preceded by its length, so that texts in a row stay distinct.
fn add_text(checksum: &mut Checksum, text: &str) {
    checksum.add(&(text.len() as u64).to_le_bytes());
    checksum.add(text.as_bytes());
}
