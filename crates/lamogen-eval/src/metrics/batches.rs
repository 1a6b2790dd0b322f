//! RetrievalBatches in which every caption is another.

use std::collections::HashMap;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;

/// Which pairs of text and motion are compared with each other.
///
/// A motion whose caption is the same as another's is as right an answer; so captions of one batch differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RetrievalBatches {
    /// Indices of pairs, batch by batch, all of one size.
    pub batches: Vec<Vec<usize>>,
    /// Indices of pairs that are in no batch, in ascending order: what a whole batch cannot be made of.
    pub dropped: Vec<usize>,
}

impl RetrievalBatches {
    /// Pairs in each batch of the public evaluation.
    pub const SIZE: usize = 32;

    /// As many batches of `size` as there can be in which no two captions are the same text. Case, punctuation and
    /// spaces make no other text. The seed decides who meets whom, and who is dropped.
    ///
    /// # Panics
    ///
    /// If the size is 0.
    pub fn distinct(captions: &[impl AsRef<str>], size: usize, seed: u64) -> RetrievalBatches {
        assert!(size > 0, "expected batches of at least one pair");
        let mut stream = ChaCha12Rng::seed_from_u64(seed);
        let mut groups = same_texts(captions);
        // With `count` batches, no text can be used more often than that.
        let fits = |&count: &usize| {
            let usable: usize = groups.iter().map(|group| group.len().min(count)).sum();
            usable >= count * size
        };
        let count = (0..=captions.len() / size).rev().find(fits).unwrap_or(0);
        for group in &mut groups {
            group.shuffle(&mut stream);
        }
        groups.shuffle(&mut stream);
        let mut used: Vec<(usize, usize)> = groups
            .iter()
            .enumerate()
            .flat_map(|(text, group)| group.iter().take(count).map(move |&pair| (text, pair)))
            .collect();
        used.shuffle(&mut stream);
        used.truncate(count * size);
        // Dealt out like cards, at most `count` of the same text in a row: no batch gets two of them.
        used.sort_by_key(|&(text, _)| text);
        let mut batches = vec![Vec::with_capacity(size); count];
        let mut dropped = vec![true; captions.len()];
        for (place, (_, pair)) in used.into_iter().enumerate() {
            batches[place % count].push(pair);
            dropped[pair] = false;
        }
        let dropped = (0..captions.len()).filter(|&pair| dropped[pair]).collect();
        RetrievalBatches { batches, dropped }
    }

    /// The key under which captions are the same text for [`distinct`](Self::distinct): their words in small letters.
    pub fn words(caption: &str) -> Vec<String> {
        let lower = caption.to_lowercase();
        lower
            .split(|letter: char| !letter.is_alphanumeric())
            .filter(|word| !word.is_empty())
            .map(str::to_owned)
            .collect()
    }
}

/// Indices of captions with the same words, in the order in which texts first come.
fn same_texts(captions: &[impl AsRef<str>]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut known = HashMap::new();
    for (index, caption) in captions.iter().enumerate() {
        let words = RetrievalBatches::words(caption.as_ref());
        let group = *known.entry(words).or_insert(groups.len());
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
        let made = RetrievalBatches::distinct(&captions, 6, 1);
        // 5 batches of 6: the first text can be used 5 times.
        assert_eq!(made.batches.len(), 5);
        assert_eq!(made.dropped.len(), 36 - 30);
        let text = |pair: &usize| match pair {
            0..9 => 0,
            9..14 => 1,
            &other => other,
        };
        for batch in &made.batches {
            let texts: HashSet<usize> = batch.iter().map(text).collect();
            assert_eq!((batch.len(), texts.len()), (6, 6));
        }
        let mut all: Vec<usize> = made.batches.concat();
        all.extend(&made.dropped);
        all.sort_unstable();
        assert_eq!(all, (0..36).collect::<Vec<_>>());
        assert_eq!(made, RetrievalBatches::distinct(&captions, 6, 1));
        assert_ne!(made, RetrievalBatches::distinct(&captions, 6, 2));
    }

    #[test]
    fn too_few_texts_make_no_batch() {
        let made = RetrievalBatches::distinct(&["one"; 50], 2, 0);
        assert_eq!((made.batches.len(), made.dropped.len()), (0, 50));
        assert!(
            RetrievalBatches::distinct(&[""; 0], 2, 0)
                .batches
                .is_empty()
        );
    }
}
