//! Names that someone may have meant.

/// The names nearest to a word, best first, at most three, none if all are far.
pub(crate) fn near<'a>(word: &str, names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let word = plain(word);
    let mut near: Vec<(usize, &str)> = names
        .filter(|name| name.len() <= 100)
        .map(|name| (distance(&word, &plain(name)), name))
        .filter(|(far, _)| *far <= 2.max(word.len() / 2))
        .collect();
    near.sort();
    near.dedup();
    near.truncate(3);
    near.into_iter().map(|(_, name)| name).collect()
}

fn plain(word: &str) -> Vec<char> {
    let letters = word.chars().take(100).filter(|c| c.is_alphanumeric());
    letters.flat_map(char::to_lowercase).collect()
}

/// How many letters must be put in, left out or replaced (Levenshtein).
fn distance(a: &[char], b: &[char]) -> usize {
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
    fn slips_of_the_pen_find_their_name_and_strangers_none() {
        let names = ["Hips", "LeftUpLeg", "LeftLeg", "RightLeg", "Head"];
        assert_eq!(near("left_leg", names.into_iter())[0], "LeftLeg");
        assert_eq!(near("hip", names.into_iter()), ["Hips"]);
        assert!(near("Tail", ["Hips"].into_iter()).is_empty());
    }
}
