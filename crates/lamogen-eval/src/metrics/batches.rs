//! Batches for R-precision in which all captions differ.

use std::collections::HashMap;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;

/// Batches of pairs of text and motion. The texts and motions of one batch are compared with each other.
///
/// The captions of one batch all differ: of two motions with the same caption, each would be a right answer to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RetrievalBatches {
    /// The indices of the pairs of each batch. All batches have the same size.
    pub batches: Vec<Vec<usize>>,
    /// The indices of the pairs that are in no batch, because no complete batch can be made of them, in ascending order.
    pub dropped: Vec<usize>,
}

impl RetrievalBatches {
    /// The number of pairs in each batch of the public evaluation.
    pub const SIZE: usize = 32;

    /// Makes as many batches of `size` pairs as possible in which no two captions are the same text. Texts that differ
    /// only in case, punctuation or spaces are the same. The seed decides which pairs are in one batch, and which are
    /// dropped.
    ///
    /// # Panics
    ///
    /// If the size is 0.
    pub fn distinct(captions: &[impl AsRef<str>], size: usize, seed: u64) -> RetrievalBatches {
        assert!(size > 0, "expected batches of at least one pair");
        let mut rng = ChaCha12Rng::seed_from_u64(seed);
        let mut groups = group_by_text(captions);
        // With `count` batches, every text can be used at most `count` times.
        let fits = |&count: &usize| {
            let usable: usize = groups.iter().map(|group| group.len().min(count)).sum();
            usable >= count * size
        };
        let count = (0..=captions.len() / size).rev().find(fits).unwrap_or(0);
        for group in &mut groups {
            group.shuffle(&mut rng);
        }
        groups.shuffle(&mut rng);
        let mut used: Vec<(usize, usize)> = groups
            .iter()
            .enumerate()
            .flat_map(|(text, group)| group.iter().take(count).map(move |&pair| (text, pair)))
            .collect();
        used.shuffle(&mut rng);
        used.truncate(count * size);
        // The pairs go to the batches in turn. A text has at most `count` pairs, one after another, so no batch gets
        // two of them.
        used.sort_by_key(|&(text, _)| text);
        let mut batches = vec![Vec::with_capacity(size); count];
        let mut dropped = vec![true; captions.len()];
        for (index, (_, pair)) in used.into_iter().enumerate() {
            batches[index % count].push(pair);
            dropped[pair] = false;
        }
        let dropped = (0..captions.len()).filter(|&pair| dropped[pair]).collect();
        RetrievalBatches { batches, dropped }
    }

    /// Returns the words of a caption in lower case. Captions with the same words are the same text for
    /// [`distinct`](Self::distinct).
    pub fn words(caption: &str) -> Vec<String> {
        let lower = caption.to_lowercase();
        lower
            .split(|letter: char| !letter.is_alphanumeric())
            .filter(|word| !word.is_empty())
            .map(str::to_owned)
            .collect()
    }
}

/// Returns, for each text, the indices of its captions. The texts are in the order in which they first occur.
fn group_by_text(captions: &[impl AsRef<str>]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut group_of = HashMap::new();
    for (index, caption) in captions.iter().enumerate() {
        let words = RetrievalBatches::words(caption.as_ref());
        let group = *group_of.entry(words).or_insert(groups.len());
        if group == groups.len() {
            groups.push(Vec::new());
        }
        groups[group].push(index);
    }
    groups
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_batch_has_a_caption_twice_and_none_is_lost() {
        // One text 9 times, another 5 times, 22 others.
        let mut captions = vec!["A man walks.".to_owned(); 9];
        captions.extend(vec!["a person  jumps".to_owned(); 3]);
        captions.extend(vec!["A person jumps!".to_owned(); 2]);
        captions.extend((0..22).map(|n| format!("a man turns {n} times")));
        let found = RetrievalBatches::distinct(&captions, 6, 1);
        // 5 batches of 6: the first text can be used 5 times.
        assert_eq!(found.batches.len(), 5);
        assert_eq!(found.dropped.len(), 36 - 30);
        let text = |pair: &usize| match pair {
            0..9 => 0,
            9..14 => 1,
            &other => other,
        };
        for batch in &found.batches {
            let texts: HashSet<usize> = batch.iter().map(text).collect();
            assert_eq!((batch.len(), texts.len()), (6, 6));
        }
        let mut all: Vec<usize> = found.batches.concat();
        all.extend(&found.dropped);
        all.sort_unstable();
        assert_eq!(all, (0..36).collect::<Vec<_>>());
        assert_eq!(found, RetrievalBatches::distinct(&captions, 6, 1));
        assert_ne!(found, RetrievalBatches::distinct(&captions, 6, 2));
    }

    #[test]
    fn too_few_texts_make_no_batch() {
        let found = RetrievalBatches::distinct(&["one"; 50], 2, 0);
        assert_eq!((found.batches.len(), found.dropped.len()), (0, 50));
        assert!(
            RetrievalBatches::distinct(&[""; 0], 2, 0)
                .batches
                .is_empty()
        );
    }
}
