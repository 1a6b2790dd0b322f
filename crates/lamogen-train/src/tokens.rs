//! Captions encoded as token ids.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

use lamogen_data::{Checksum, Dataset, Entry, Split};
use lamogen_model::{Tokenizer, TokenizerError, Tokens, WordList};
use rayon::prelude::*;

use crate::paraphrases::Paraphrases;

/// The token ids of every caption of a data set.
#[derive(Clone, Debug)]
pub struct CaptionTokens {
    /// The ids `[entry][caption][phrasing][token]`; the first phrasing is the caption itself. Motions with the same caption
    /// share its ids.
    ids: Vec<Vec<Arc<Vec<Vec<i32>>>>>,
    /// The ids of an empty sentence.
    empty: Vec<i32>,
    /// The words of the captions of the training split, in all phrasings.
    words: WordList,
    /// The number of captions that are longer than the context.
    cut: usize,
    tokenizer: Tokenizer,
    /// The bytes of `tokenizer.json`; `None` for CLIP's tokenizer.
    file: Option<Vec<u8>>,
}

impl CaptionTokens {
    /// Encodes each caption and, in the training split, up to `phrasings` paraphrases of it. Captions that are longer than the
    /// network's context are cut, as prompts are. `file` is the tokenizer's file, which is written to the folder of the finished
    /// model; `None` for CLIP's tokenizer.
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
        let captions: Vec<Vec<(&str, bool)>> = dataset.entries().iter().map(captions_of).collect();
        let distinct: BTreeSet<(&str, bool)> = captions.iter().flatten().copied().collect();
        let encoded = { distinct.into_par_iter() }
            .map(|(text, learned)| {
                let others = match learned {
                    true => other_phrasings(text, phrasings),
                    false => Vec::new(),
                };
                let caption = EncodedCaption::new(text, others, &tokenizer)?;
                Ok(((text, learned), caption))
            })
            .collect::<Result<BTreeMap<_, _>, TokenizerError>>()?;
        let mut words = WordList::default();
        for ((text, learned), caption) in &encoded {
            if *learned {
                words.add(text);
                { caption.others.iter() }.for_each(|text| words.add(text));
            }
        }
        let cut = { captions.iter().flatten() }
            .filter(|caption| encoded[caption].is_cut)
            .count();
        let ids = { captions.iter() }
            .map(|captions| {
                let ids = captions.iter().map(|caption| encoded[caption].ids.clone());
                ids.collect()
            })
            .collect();
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

    /// Returns the ids of a caption in its original words.
    pub(crate) fn original(&self, entry: usize, caption: usize) -> &[i32] {
        &self.ids[entry][caption][0]
    }

    /// Returns the ids of all phrasings of a caption.
    pub(crate) fn phrasings(&self, entry: usize, caption: usize) -> &[Vec<i32>] {
        &self.ids[entry][caption]
    }

    /// Returns the ids of one phrasing of a caption. `phrasing` is any number; its remainder by the number of phrasings counts.
    pub(crate) fn phrasing(&self, entry: usize, caption: usize, phrasing: u64) -> &[i32] {
        let phrasings = &self.ids[entry][caption];
        &phrasings[(phrasing % phrasings.len() as u64) as usize]
    }

    /// Returns the ids of an empty sentence, which stands for a motion without text.
    pub(crate) fn empty(&self) -> &[i32] {
        &self.empty
    }

    /// Returns the words of the training split's captions, in all phrasings.
    pub fn words(&self) -> &WordList {
        &self.words
    }

    /// Returns the tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// Returns the tokenizer's file, if it has one.
    pub fn file(&self) -> Option<&[u8]> {
        self.file.as_deref()
    }

    /// Returns the number of captions that were cut.
    pub fn cut(&self) -> usize {
        self.cut
    }
}

/// A caption with its paraphrases.
struct EncodedCaption {
    others: Vec<String>,
    /// The ids of the caption and of its paraphrases.
    ids: Arc<Vec<Vec<i32>>>,
    /// Whether the caption itself is longer than the context.
    is_cut: bool,
}

impl EncodedCaption {
    fn new(text: &str, others: Vec<String>, tokenizer: &Tokenizer) -> Result<Self, TokenizerError> {
        let row = |tokens: Tokens| tokens.ids.iter().map(|&id| id as i32).collect();
        let own = tokenizer.encode(text)?;
        let is_cut = own.cut > 0;
        let mut ids: Vec<Vec<i32>> = vec![row(own)];
        for other in &others {
            ids.push(row(tokenizer.encode(other)?));
        }
        Ok(EncodedCaption {
            others,
            ids: Arc::new(ids),
            is_cut,
        })
    }
}

/// Returns the captions of an entry, each with whether it is learned from, and so paraphrased.
fn captions_of(entry: &Entry) -> Vec<(&str, bool)> {
    let learned = entry.split == Split::Train;
    let texts = entry.captions.iter().map(|caption| caption.text.as_str());
    texts.map(|text| (text, learned)).collect()
}

/// Returns different paraphrases of a caption, at most `count`.
pub fn other_phrasings(caption: &str, count: usize) -> Vec<String> {
    if count == 0 {
        return Vec::new();
    }
    let table = english();
    let mut phrasings: Vec<String> = Vec::with_capacity(count);
    let mut checksum = Checksum::new(0);
    checksum.add(caption.as_bytes());
    for draw in 0..2 * count as u64 {
        let phrasing = table.rephrase(caption, checksum.value().wrapping_add(draw));
        if phrasings.len() < count && phrasing != caption && !phrasings.contains(&phrasing) {
            phrasings.push(phrasing);
        }
    }
    phrasings
}

/// Returns the table of English paraphrases, which is parsed once.
fn english() -> &'static Paraphrases {
    static TABLE: OnceLock<Paraphrases> = OnceLock::new();
    TABLE.get_or_init(Paraphrases::english)
}
