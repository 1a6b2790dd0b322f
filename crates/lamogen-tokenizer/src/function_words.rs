//! Words that say nothing of a movement by themselves.

/// Articles, pronouns, auxiliary verbs, conjunctions and prepositions that no common sentence of another language has.
const ENGLISH: [&str; 21] = [
    "a", "and", "are", "been", "from", "he", "his", "it", "of", "she", "somebody", "someone",
    "the", "their", "them", "then", "they", "which", "while", "who", "with",
];

/// Further words of these kinds, which other languages may have, and words for any person and for numbers.
const OTHERS: [&str; 79] = [
    "adult",
    "an",
    "another",
    "as",
    "at",
    "be",
    "being",
    "body",
    "boy",
    "but",
    "by",
    "can",
    "character",
    "child",
    "could",
    "did",
    "does",
    "each",
    "figure",
    "five",
    "for",
    "four",
    "girl",
    "guy",
    "had",
    "has",
    "have",
    "having",
    "her",
    "herself",
    "him",
    "himself",
    "human",
    "humans",
    "if",
    "in",
    "individual",
    "into",
    "is",
    "it's",
    "its",
    "itself",
    "lady",
    "man",
    "may",
    "men",
    "might",
    "must",
    "my",
    "on",
    "one",
    "onto",
    "or",
    "other",
    "our",
    "people",
    "person",
    "person's",
    "persons",
    "shall",
    "should",
    "so",
    "some",
    "subject",
    "than",
    "that",
    "themselves",
    "there",
    "these",
    "this",
    "those",
    "three",
    "two",
    "was",
    "were",
    "what",
    "will",
    "woman",
    "women",
];

/// The words of one or two letters that say something.
const SHORT: [&str; 2] = ["go", "up"];

/// Returns whether a word in lower case is one that only English sentences have.
pub(crate) fn is_english(word: &str) -> bool {
    ENGLISH.contains(&word)
}

/// Returns whether a word in lower case says nothing of a movement by itself.
pub(crate) fn says_nothing(word: &str) -> bool {
    let is_number = word.chars().all(char::is_numeric);
    let is_short = word.chars().count() <= 2 && !SHORT.contains(&word);
    is_number || is_short || ENGLISH.contains(&word) || OTHERS.contains(&word)
}
