//! What is said of a composed motion.

use rand::seq::{IndexedRandom, SliceRandom};
use rand_chacha::ChaCha12Rng;

use crate::entry::Entry;
use crate::sides::swap_sides;

/// Subjects with which captions begin, followed by a verb in the third person.
const SUBJECTS: [&str; 18] = [
    "a person",
    "the person",
    "this person",
    "person",
    "someone",
    "somebody",
    "a man",
    "the man",
    "this man",
    "a woman",
    "the woman",
    "a human",
    "a guy",
    "the guy",
    "the figure",
    "a figure",
    "he",
    "she",
];
/// The most words that a composed caption takes from the caption of a part.
const WORDS: usize = 9;

/// Returns what the captions of an entry say without their subjects, such as `walks forward`, if they are short enough;
/// of its mirror image, if it is `mirrored`.
pub(super) fn phrases(entry: &Entry, mirrored: bool) -> Vec<String> {
    let texts = { entry.captions.iter() }.map(|caption| match mirrored {
        true => swap_sides(&caption.text),
        false => caption.text.clone(),
    });
    texts.filter_map(|text| phrase(&text)).collect()
}

fn phrase(text: &str) -> Option<String> {
    let text = text.trim_end_matches('.').to_lowercase();
    let said = SUBJECTS.iter().find_map(|subject| {
        let said = text.strip_prefix(subject)?.strip_prefix(' ')?;
        // "a person is seen from behind who …" is nothing that another sentence can go on with.
        let is_verb = said
            .split(' ')
            .next()
            .is_some_and(|verb| verb.ends_with('s'));
        (is_verb && said.split(' ').count() <= WORDS).then_some(said)
    })?;
    Some(said.to_owned())
}

/// Fills templates with phrases of the parts. Templates whose parts have no phrases are left out.
pub(super) fn fill(
    templates: &[String],
    said: &[Vec<String>],
    most: usize,
    rng: &mut ChaCha12Rng,
) -> Vec<String> {
    let mut order: Vec<&String> = templates.iter().collect();
    order.shuffle(rng);
    let mut captions: Vec<String> = Vec::new();
    for template in order {
        let mut caption = template.clone();
        let mut is_complete = true;
        for (part, phrases) in said.iter().enumerate() {
            let place = format!("{{{part}}}");
            if caption.contains(&place) {
                match phrases.choose(rng) {
                    Some(phrase) => caption = caption.replace(&place, phrase),
                    None => is_complete = false,
                }
            }
        }
        if is_complete && captions.len() < most && !captions.contains(&caption) {
            captions.push(caption);
        }
    }
    captions
}
