//! Captions as token ids.

use std::sync::OnceLock;

use lamogen_data::{Checksum, Dataset, Split};
use lamogen_model::{KnownWords, Tokenizer, TokenizerError};

use crate::paraphrases::Paraphrases;

/// Token ids of every caption of every entry of a data set.
#[derive(Clone, Debug)]
pub struct CaptionTokens {
    /// `[entry][caption][phrasing][token]`; the first phrasing is the caption as it is.
    ids: Vec<Vec<Vec<Vec<i32>>>>,
    /// Of a sentence without words.
    empty: Vec<i32>,
    /// Of the captions for training, in all phrasings.
    words: KnownWords,
    /// How many captions are longer than the context.
    cut: usize,
    tokenizer: Tokenizer,
    /// The `tokenizer.json`; none for CLIP's own.
    file: Option<Vec<u8>>,
}

impl CaptionTokens {
    /// The ids that a tokenizer gives, of each caption and of so many other phrasings of it. Captions that are longer than the network's context are cut, as prompts are. `file` is the
    /// tokenizer's own, for the folder of the finished model; none for CLIP's.
    ///
    /// # Errors
    ///
    /// If a caption cannot be encoded.
    pub fn new(
        dataset: &Dataset,
        tokenizer: Tokenizer,
        file: Option<Vec<u8>>,
        phrasings: usize,
    ) -> Result<Self, TokenizerError> {
        let mut cut = 0;
        let encode = |text: &str| -> Result<(Vec<i32>, usize), TokenizerError> {
            let tokens = tokenizer.encode(text)?;
            Ok((tokens.ids.iter().map(|&id| id as i32).collect(), tokens.cut))
        };
        let mut words = KnownWords::default();
        let mut ids = Vec::with_capacity(dataset.entries().len());
        for entry in dataset.entries() {
            let captions = entry.captions.iter().map(|caption| {
                let (first, lost) = encode(&caption.text)?;
                cut += usize::from(lost > 0);
                let others = match entry.split {
                    Split::Train => {
                        let others = other_phrasings(&caption.text, phrasings);
                        words.add(&caption.text);
                        others.iter().for_each(|text| words.add(text));
                        others
                    }
                    _ => Vec::new(),
                };
                let others = others.iter().map(|text| Ok(encode(text)?.0));
                std::iter::once(Ok(first)).chain(others).collect()
            });
            ids.push(captions.collect::<Result<Vec<Vec<Vec<i32>>>, TokenizerError>>()?);
        }
        let empty = tokenizer.unconditional().ids;
        let empty = empty.iter().map(|&id| id as i32).collect();
        Ok(CaptionTokens {
            ids,
            empty,
            words,
            cut,
            tokenizer,
            file,
        })
    }

    /// The ids of a caption as it is.
    pub(crate) fn of(&self, entry: usize, caption: usize) -> &[i32] {
        &self.ids[entry][caption][0]
    }

    /// The ids of all phrasings of a caption.
    pub(crate) fn phrasings(&self, entry: usize, caption: usize) -> &[Vec<i32>] {
        &self.ids[entry][caption]
    }

    /// The ids of a caption in one of its phrasings, whichever number is given.
    pub(crate) fn phrased(&self, entry: usize, caption: usize, phrasing: u64) -> &[i32] {
        let phrasings = &self.ids[entry][caption];
        &phrasings[(phrasing % phrasings.len() as u64) as usize]
    }

    /// The ids of a sentence without words: of a motion of which nothing is said.
    pub(crate) fn empty(&self) -> &[i32] {
        &self.empty
    }

    /// The words of the captions for training, in all phrasings.
    pub fn words(&self) -> &KnownWords {
        &self.words
    }

    /// The tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// The tokenizer's file, if it has one.
    pub fn file(&self) -> Option<&[u8]> {
        self.file.as_deref()
    }

    /// How many captions are cut.
    pub fn cut(&self) -> usize {
        self.cut
    }
}

/// A caption in other words, each phrasing once; at most so many.
pub fn other_phrasings(caption: &str, count: usize) -> Vec<String> {
    if count == 0 {
        return Vec::new();
    }
    let table = english();
    let mut phrasings: Vec<String> = Vec::with_capacity(count);
    let mut sum = Checksum::new(0);
    sum.add(caption.as_bytes());
    for draw in 0..2 * count as u64 {
        let phrasing = table.rephrase(caption, sum.value().wrapping_add(draw));
        if phrasings.len() < count && phrasing != caption && !phrasings.contains(&phrasing) {
            phrasings.push(phrasing);
        }
    }
    phrasings
}

fn english() -> &'static Paraphrases {
    static TABLE: OnceLock<Paraphrases> = OnceLock::new();
    TABLE.get_or_init(Paraphrases::english)
}
