//! Captions of mirror images: left and right exchanged in texts.

/// The suffixes of `left` and `right` in words that name a side.
const SIDE_SUFFIXES: [&str; 11] = [
    "", "s", "ward", "wards", "most", "hand", "handed", "side", "foot", "footed", "sided",
];

/// Exchanges left and right, and clockwise and counterclockwise, in a sentence.
///
/// Words that only contain these, such as `upright`, are not changed. A verb as in "he left" is treated as a side.
pub(crate) fn swap_sides(text: &str) -> String {
    let mut swapped = String::with_capacity(text.len() + 8);
    let mut rest = text;
    while let Some(start) = rest.find(char::is_alphabetic) {
        let (between, words) = rest.split_at(start);
        let end = words
            .find(|c: char| !c.is_alphabetic())
            .unwrap_or(words.len());
        let (word, after) = words.split_at(end);
        swapped.push_str(between);
        match word.to_ascii_lowercase().as_str() {
            // "counter-clockwise" or "counter clockwise" becomes "clockwise".
            "counter" | "anti" if is_clockwise(after) => {
                let start = after.find(char::is_alphabetic).unwrap_or(0);
                let (_, clockwise) = after.split_at(start);
                let (clockwise, after) = clockwise.split_at("clockwise".len());
                swapped.push_str(&match_case(clockwise, word));
                rest = after;
            }
            // A right angle has no side.
            "right" if is_angle(after) => {
                swapped.push_str(word);
                rest = after;
            }
            _ => {
                swapped.push_str(&swap_sides_in_word(word));
                rest = after;
            }
        }
    }
    swapped + rest
}

/// Exchanges the same words in a list of words with their parts of speech, such as `turn/VERB left/ADV`.
pub(crate) fn swap_sides_in_tokens(tokens: &str) -> String {
    let mut swapped: Vec<String> = Vec::new();
    let mut tokens = tokens.split(' ').peekable();
    while let Some(token) = tokens.next() {
        let (word, speech) = token
            .split_once('/')
            .map_or((token, None), |(w, s)| (w, Some(s)));
        let next = tokens.peek().and_then(|next| next.split('/').next());
        let counter = ["counter", "anti"].contains(&word.to_ascii_lowercase().as_str());
        if counter && next.is_some_and(|next| next.eq_ignore_ascii_case("clockwise")) {
            swapped.extend(tokens.next().map(str::to_owned));
            continue;
        }
        let word = swap_sides(word);
        swapped.push(speech.map_or(word.clone(), |speech| format!("{word}/{speech}")));
    }
    swapped.join(" ")
}

/// Returns whether a text begins with `clockwise` after at least one space or hyphen.
fn is_clockwise(text: &str) -> bool {
    let words = text.trim_start_matches([' ', '-']);
    let end = words
        .find(|c: char| !c.is_alphabetic())
        .unwrap_or(words.len());
    text.len() > words.len() && words[..end].eq_ignore_ascii_case("clockwise")
}

/// Returns whether a text begins with a word such as `angle` or `angled` after a space or hyphen.
fn is_angle(text: &str) -> bool {
    let words = text.strip_prefix([' ', '-']).unwrap_or_default();
    words.to_ascii_lowercase().starts_with("angle")
}

/// Exchanges the side or the direction that a word names; another word is returned as it is.
fn swap_sides_in_word(word: &str) -> String {
    let lower = word.to_ascii_lowercase();
    let other = match lower.as_str() {
        "clockwise" => Some("counterclockwise".to_owned()),
        "counterclockwise" | "anticlockwise" => Some("clockwise".to_owned()),
        _ => [("left", "right"), ("right", "left")]
            .into_iter()
            .find_map(|(side, other)| {
                let ending = lower.strip_prefix(side)?;
                SIDE_SUFFIXES
                    .contains(&ending)
                    .then(|| format!("{other}{ending}"))
            }),
    };
    other.map_or(word.to_owned(), |other| match_case(&other, word))
}

/// Returns a word in the case of another one: lower case, first letter capital, or all capitals.
fn match_case(word: &str, like: &str) -> String {
    let capitals = like.chars().filter(|c| c.is_uppercase()).count();
    match like.chars().next() {
        Some(first) if first.is_uppercase() && capitals > 1 => word.to_ascii_uppercase(),
        Some(first) if first.is_uppercase() => {
            word[..1].to_ascii_uppercase() + &word[1..].to_ascii_lowercase()
        }
        _ => word.to_ascii_lowercase(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_exchanged_and_other_words_are_kept() {
        for (text, mirrored) in [
            ("Left foot, then the right.", "Right foot, then the left."),
            (
                "a left-handed man turns leftwards",
                "a right-handed man turns rightwards",
            ),
            (
                "he stands upright in bright light",
                "he stands upright in bright light",
            ),
            (
                "the right knee at a right angle, a right-angled arm",
                "the left knee at a right angle, a right-angled arm",
            ),
            ("walks clockwise", "walks counterclockwise"),
            ("walks counter-clockwise twice", "walks clockwise twice"),
            ("Anti clockwise; RIGHT", "Clockwise; LEFT"),
            ("a counter is clockwise", "a counter is counterclockwise"),
            ("walk-turn-left", "walk-turn-right"),
            ("élan to the right é", "élan to the left é"),
            ("raise_left_hand2", "raise_right_hand2"),
            ("", ""),
        ] {
            assert_eq!(swap_sides(text), mirrored);
        }
    }

    #[test]
    fn swapping_twice_changes_nothing() {
        for text in [
            "the left-most of both Right hands",
            "clockwise, then counterclockwise",
        ] {
            assert_ne!(swap_sides(text), text);
            assert_eq!(swap_sides(&swap_sides(text)), text);
        }
    }

    #[test]
    fn tokens_keep_their_parts_of_speech() {
        assert_eq!(
            swap_sides_in_tokens("turn/VERB left/ADV counter/NOUN clockwise/ADV x"),
            "turn/VERB right/ADV clockwise/ADV x"
        );
        assert_eq!(
            swap_sides_in_tokens("clockwise/ADV"),
            "counterclockwise/ADV"
        );
    }
}
