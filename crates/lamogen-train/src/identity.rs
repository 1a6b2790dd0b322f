//! What a run is, so that a folder is not gone on with by another.

use lamogen_data::Dataset;
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
    let mut sum = Checksum::new();
    for (place, entry) in dataset.entries().iter().enumerate() {
        sum.add_text(&entry.name);
        sum.add_text(entry.split.name());
        sum.add(&[u8::from(entry.mirror)]);
        sum.add(&(entry.frames as u64).to_le_bytes());
        for word in [&entry.content, &entry.style] {
            sum.add_text(word.as_deref().unwrap_or_default());
        }
        for caption in 0..entry.captions.len() {
            for id in tokens.of(place, caption) {
                sum.add(&id.to_le_bytes());
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
        "checksum": format!("{:016x}", sum.0),
    })
}

/// FNV-1a in 64 bits: the same on every machine and for ever.
struct Checksum(u64);

impl Checksum {
    fn new() -> Self {
        Checksum(0xcbf2_9ce4_8422_2325)
    }

    fn add_text(&mut self, text: &str) {
        self.add(&(text.len() as u64).to_le_bytes());
        self.add(text.as_bytes());
    }

    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}
