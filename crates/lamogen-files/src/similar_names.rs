//! Suggestions for misspelled names.

/// Returns the names most similar to a word, the most similar one first: at most three, and none if all are too
/// different.
pub(crate) fn similar_names<'a>(word: &str, names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let word = normalised(word);
    let mut similar: Vec<(usize, &str)> = names
        .filter(|name| name.len() <= 100)
        .map(|name| (edit_distance(&word, &normalised(name)), name))
        .filter(|(distance, _)| *distance <= 2.max(word.len() / 2))
        .collect();
    similar.sort();
    similar.dedup();
    similar.truncate(3);
    similar.into_iter().map(|(_, name)| name).collect()
}

/// Returns the letters and digits of a word in lower case, from its first 100 characters.
fn normalised(word: &str) -> Vec<char> {
    let letters = word.chars().take(100).filter(|c| c.is_alphanumeric());
    letters.flat_map(char::to_lowercase).collect()
}

/// Computes the Levenshtein distance: the number of letters that must be inserted, removed or replaced.
fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = corner + usize::from(x != y);
            corner = row[j + 1];
            row[j + 1] = replaced.min(corner + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelled_names_find_similar_ones_and_other_words_none() {
        let names = ["Hips", "LeftUpLeg", "LeftLeg", "RightLeg", "Head"];
        assert_eq!(similar_names("left_leg", names.into_iter())[0], "LeftLeg");
        assert_eq!(similar_names("hip", names.into_iter()), ["Hips"]);
        assert!(similar_names("Tail", ["Hips"].into_iter()).is_empty());
    }
}
