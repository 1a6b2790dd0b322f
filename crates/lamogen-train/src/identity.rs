//! What a run is, so that a folder is not gone on with by another.

use std::io::{self, Write};
use std::path::Path;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;
use lamogen_data::{Checksum, Dataset};
use lamogen_motion::write_atomically;
use serde::Serialize;
use serde_json::{Value, json};

use crate::tokens::CaptionTokens;

/// What is trained, by which config, on what: the same for the same run, and different if the config differs, or names, lengths, splits,
/// contents, captions as ids or statistics of the data. The motions themselves are not compared.
pub fn identity(
    what: &str,
    config: &impl Serialize,
    dataset: &Dataset,
    tokens: &CaptionTokens,
) -> Value {
    let mut sum = Checksum::new(0);
    for (place, entry) in dataset.entries().iter().enumerate() {
        add_text(&mut sum, &entry.name);
        add_text(&mut sum, entry.split.name());
        sum.add(&[u8::from(entry.mirror)]);
        sum.add(&(entry.frames as u64).to_le_bytes());
        for word in [&entry.content, &entry.style] {
            add_text(&mut sum, word.as_deref().unwrap_or_default());
        }
        for caption in 0..entry.captions.len() {
            for ids in tokens.phrasings(place, caption) {
                for id in ids {
                    sum.add(&id.to_le_bytes());
                }
            }
        }
    }
    for number in dataset.mean().iter().chain(dataset.std()) {
        sum.add(&number.to_le_bytes());
    }
    json!({
        "what": what,
        "config": config,
        "entries": dataset.entries().len(),
        "frames": dataset.entries().iter().map(|entry| entry.frames).sum::<usize>(),
        "checksum": format!("{:016x}", sum.value()),
    })
}

/// A number that stands for all weights of a network, for the identity of a run that begins with them.
pub fn fingerprint(network: &impl Module) -> String {
    let mut weights = Weights(Checksum::new(0));
    network.visit(&mut weights);
    format!("{:016x}", weights.0.value())
}

struct Weights(Checksum);

impl ModuleVisitor for Weights {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let values = param.val().try_into_vec_as::<f32>();
        for value in values.expect("floats convert to f32") {
            self.0.add(&value.to_le_bytes());
        }
    }
}

/// Why work does not go on in a folder.
pub(crate) enum ClaimError {
    /// Its note cannot be read or written.
    Io(io::Error),
    /// Its note is not JSON.
    Format(serde_json::Error),
    /// It holds other work: where the notes differ and what was found there, each as `place = value`.
    Other { expected: String, found: String },
}

/// Notes in a file what the work in its folder is, or compares it with what was noted.
pub(crate) fn claim(path: &Path, identity: &Value) -> Result<(), ClaimError> {
    let bytes = match std::fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let text = serde_json::to_string_pretty(identity).expect("values are JSON");
            return write_atomically(path, |file| file.write_all(text.as_bytes()))
                .map_err(ClaimError::Io);
        }
        bytes => bytes.map_err(ClaimError::Io)?,
    };
    let noted: Value = serde_json::from_slice(&bytes).map_err(ClaimError::Format)?;
    // Both through the same reader, which may lose the last bit of a number.
    let text = identity.to_string();
    let identity: Value = serde_json::from_str(&text).expect("just written");
    // What is made tells more than how.
    let what = first_difference("what", &identity["what"], &noted["what"]);
    match what.or_else(|| first_difference("", &identity, &noted)) {
        None => Ok(()),
        Some((place, expected, found)) => Err(ClaimError::Other {
            expected: format!("{place} = {expected}"),
            found: format!("{place} = {found}"),
        }),
    }
}

/// Where two values differ, and how.
pub(crate) fn first_difference(
    place: &str,
    a: &Value,
    b: &Value,
) -> Option<(String, Value, Value)> {
    if let (Value::Object(a), Value::Object(b)) = (a, b) {
        let keys = a.keys().chain(b.keys());
        return keys.into_iter().find_map(|key| {
            let place = match place {
                "" => key.clone(),
                place => format!("{place}.{key}"),
            };
            let missing = &Value::Null;
            let (a, b) = (a.get(key).unwrap_or(missing), b.get(key).unwrap_or(missing));
            first_difference(&place, a, b)
        });
    }
    (a != b).then(|| (place.to_owned(), a.clone(), b.clone()))
}

/// Adds a text so that it does not run into the next.
fn add_text(sum: &mut Checksum, text: &str) {
    sum.add(&(text.len() as u64).to_le_bytes());
    sum.add(text.as_bytes());
}
