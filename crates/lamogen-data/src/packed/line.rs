//! A line of `captions.jsonl`.

use serde::{Deserialize, Serialize};

use crate::entry::{Caption, Entry};
use crate::split::Split;

/// An entry in the form of the file. Unknown fields are ignored.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct EntryLine {
    name: String,
    split: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    source: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    trial: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    content: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    style: Option<String>,
    clip: usize,
    /// The first row of the entry, counted over the whole file.
    start: usize,
    frames: usize,
    #[serde(default)]
    mirror: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    variation_of: Option<String>,
    captions: Vec<String>,
    /// The words of each caption with their parts of speech, one item per caption.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tokens: Option<Vec<Option<String>>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    note: Option<String>,
}

impl EntryLine {
    /// Converts the line to an entry. It does not check the clip and the rows.
    ///
    /// # Errors
    ///
    /// If the split is unknown, a caption is empty, or there are not as many items of tokens as captions.
    fn into_entry(self) -> Result<Entry, String> {
        let split: Split = { self.split.parse() }.map_err(|error| format!("{error}"))?;
        let tokens = match self.tokens {
            Some(tokens) if tokens.len() != self.captions.len() => {
                let [captions, tokens] = [self.captions.len(), tokens.len()];
                return Err(format!(
                    "expected tokens for {captions} captions, found {tokens}"
                ));
            }
            Some(tokens) => tokens,
            None => vec![None; self.captions.len()],
        };
        if self
            .captions
            .iter()
            .any(|caption| caption.trim().is_empty())
        {
            return Err("expected captions, found an empty one".into());
        }
        let captions = self.captions.into_iter().zip(tokens);
        Ok(Entry {
            name: self.name,
            split,
            frames: self.frames,
            mirror: self.mirror,
            variation_of: self.variation_of,
            content: self.content,
            style: self.style,
            source: self.source,
            trial: self.trial,
            note: self.note,
            captions: captions
                .map(|(text, tokens)| Caption { text, tokens })
                .collect(),
            clip: self.clip,
            start: self.start,
        })
    }
}

impl Entry {
    /// Parses a line of the packed form's `captions.jsonl`. It does not check the clip and the rows.
    ///
    /// # Errors
    ///
    /// If a field is missing or has another type, the split is unknown, a caption is empty, or there are not as many items of
    /// tokens as captions.
    pub fn from_json(line: &str) -> Result<Self, String> {
        let line: EntryLine = serde_json::from_str(line).map_err(|error| error.to_string())?;
        line.into_entry()
    }
}

impl From<&Entry> for EntryLine {
    fn from(entry: &Entry) -> Self {
        let captions = entry.captions.iter();
        let tokens = captions.clone().map(|caption| caption.tokens.clone());
        let has_tokens = captions.clone().any(|caption| caption.tokens.is_some());
        EntryLine {
            name: entry.name.clone(),
            split: entry.split.to_string(),
            source: entry.source.clone(),
            trial: entry.trial.clone(),
            content: entry.content.clone(),
            style: entry.style.clone(),
            clip: entry.clip,
            start: entry.start,
            frames: entry.frames,
            mirror: entry.mirror,
            variation_of: entry.variation_of.clone(),
            captions: { captions.clone() }
                .map(|caption| caption.text.clone())
                .collect(),
            tokens: has_tokens.then(|| tokens.collect()),
            note: entry.note.clone(),
        }
    }
}
