//! Other words for captions.
//!
//! A network that is trained on a few thousand captions knows the words of these alone. What people call the same things is put in
//! their place: other subjects, synonyms of verbs in the same form, other phrases; and a sentence about somebody becomes a request
//! ("a person walks" → "walk").

use std::collections::HashMap;

use lamogen_model::words;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde::Deserialize;

/// The table of `configs/paraphrases.json`.
#[derive(Clone, Debug)]
pub struct Paraphrases {
    subjects: Vec<Vec<String>>,
    /// The forms of known verbs, by the third person.
    forms: HashMap<String, [String; 3]>,
    /// What may stand in place of words, by the first of them; longer phrases first.
    rules: HashMap<String, Vec<Rule>>,
}

#[derive(Clone, Debug)]
struct Rule {
    words: Vec<String>,
    others: Vec<Vec<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    subjects: Vec<String>,
    /// Of each verb base form, third person and participle, then of its synonyms.
    verbs: Vec<Vec<String>>,
    /// Phrases, and what may stand in their place.
    phrases: Vec<[Vec<String>; 2]>,
}

impl Paraphrases {
    /// The table that comes with the library, for English captions of movement.
    pub fn english() -> Self {
        let table = include_bytes!("../configs/paraphrases.json");
        let table: Table = serde_json::from_slice(table).expect("checked by a test");
        let mut subjects: Vec<Vec<String>> =
            { table.subjects.iter() }.map(|text| words(text)).collect();
        subjects.sort_by_key(|subject| std::cmp::Reverse(subject.len()));
        let mut rules: HashMap<String, Vec<Rule>> = HashMap::new();
        let mut add = |words: Vec<String>, others: Vec<Vec<String>>| {
            rules
                .entry(words[0].clone())
                .or_default()
                .push(Rule { words, others });
        };
        let mut forms = HashMap::new();
        for verb in &table.verbs {
            let all: Vec<[String; 3]> = { verb.iter() }
                .map(|forms| words(forms).try_into().expect("three forms a verb"))
                .collect();
            for forms_of in &all {
                forms.insert(forms_of[1].clone(), forms_of.clone());
            }
            for form in 0..3 {
                let others = all[1..]
                    .iter()
                    .map(|forms| vec![forms[form].clone()])
                    .collect();
                add(vec![all[0][form].clone()], others);
            }
        }
        for [of, others] in &table.phrases {
            for phrase in of {
                let others = { others.iter() }
                    .filter(|other| *other != phrase)
                    .map(|other| words(other));
                add(words(phrase), others.collect());
            }
        }
        for rules in rules.values_mut() {
            rules.sort_by_key(|rule| std::cmp::Reverse(rule.words.len()));
        }
        Paraphrases {
            subjects,
            forms,
            rules,
        }
    }

    /// A caption in other words. The same seed gives the same ones.
    pub fn rephrase(&self, caption: &str, seed: u64) -> String {
        /// How often the subject is another one, or there is none.
        const SUBJECT: f64 = 0.6;
        /// How often a phrase that has others is one of them.
        const PHRASE: f64 = 0.4;
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut rest = &words(caption)[..];
        let mut said: Vec<String> = Vec::new();
        let subject = { self.subjects.iter() }.find(|subject| rest.starts_with(subject));
        let mut verb = None;
        if let Some(subject) = subject {
            rest = &rest[subject.len()..];
            let forms = rest.first().and_then(|word| self.forms.get(word));
            if !generator.random_bool(SUBJECT) {
                said.extend(subject.iter().cloned());
            } else if let (Some([base, _, participle]), 0..4) =
                (forms, generator.random_range(0..10u32))
            {
                // A request, or what a title would say.
                verb = Some(if generator.random_bool(0.6) {
                    base
                } else {
                    participle
                });
            } else {
                said.extend(pick(&self.subjects, &mut generator).iter().cloned());
            }
        }
        if let Some(verb) = verb {
            let word = std::slice::from_ref(verb);
            self.say(word, &mut said, PHRASE, &mut generator);
            rest = &rest[1..];
        }
        while !rest.is_empty() {
            rest = &rest[self.say(rest, &mut said, PHRASE, &mut generator)..];
        }
        join(&said)
    }

    /// Says the first words in the same or other words, and returns how many of them.
    fn say(
        &self,
        rest: &[String],
        said: &mut Vec<String>,
        share: f64,
        generator: &mut impl Rng,
    ) -> usize {
        let rules = { self.rules.get(&rest[0]) }.into_iter().flatten();
        let mut fitting = rules
            .filter(|rule| rest.starts_with(&rule.words))
            .peekable();
        let Some(longest) = fitting.peek().map(|rule| rule.words.len()) else {
            said.push(rest[0].clone());
            return 1;
        };
        if !generator.random_bool(share) {
            said.extend(rest[..longest].iter().cloned());
            return longest;
        }
        let others: Vec<&Vec<String>> = { fitting.take_while(|rule| rule.words.len() == longest) }
            .flat_map(|rule| &rule.others)
            .collect();
        said.extend(pick(&others, generator).iter().cloned());
        longest
    }
}

fn pick<'a, T>(all: &'a [T], generator: &mut impl Rng) -> &'a T {
    &all[generator.random_range(0..all.len() as u64) as usize]
}

/// Undoes [`words`], up to spaces.
fn join(words: &[String]) -> String {
    let mut text = String::new();
    for word in words {
        let apart = word.starts_with(char::is_alphanumeric) || word == "(";
        if apart && !text.is_empty() && !text.ends_with('(') {
            text.push(' ');
        }
        text.push_str(word);
    }
    text
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    fn all(caption: &str) -> HashSet<String> {
        let table = Paraphrases::english();
        (0..400).map(|seed| table.rephrase(caption, seed)).collect()
    }

    #[test]
    fn a_caption_is_said_in_many_ways_and_in_the_same_one_for_a_seed() {
        let table = Paraphrases::english();
        let caption = "a person walks forward quickly";
        assert_eq!(table.rephrase(caption, 3), table.rephrase(caption, 3));
        let all = all(caption);
        assert!(all.len() > 50, "{}", all.len());
        assert!(all.contains(caption));
        let has = |part: &str| all.iter().any(|text| text.contains(part));
        assert!(has("someone") && has("strolls") && has("ahead") && has("rapidly"));
        assert!(all.iter().any(|text| text.starts_with("walk ")));
        assert!(all.iter().any(|text| text.starts_with("walking ")));
    }

    #[test]
    fn sides_and_numbers_stay() {
        for text in all("a man squats three times, then steps sideways to the left") {
            assert!(text.contains("left") && !text.contains("right"), "{text}");
            assert!(
                ["three", "3", "thrice"]
                    .iter()
                    .any(|number| text.contains(number)),
                "{text}"
            );
        }
    }

    #[test]
    fn the_longest_phrase_counts() {
        for text in all("the figure makes a quarter turn to the right") {
            assert!(
                ["quarter", "90", "ninety", "right-angle"]
                    .iter()
                    .any(|part| text.contains(part)),
                "{text}"
            );
        }
    }

    #[test]
    fn what_has_no_other_words_stays_and_punctuation_too() {
        let text = "zorbing (twice), quietly; it's well-made.";
        let others = all(text);
        assert!(others.contains(text), "{others:?}");
        assert!(
            others.iter().all(|other| other.starts_with("zorbing (")
                && other.ends_with(", quietly; it's well-made."))
        );
    }

    #[test]
    fn nothing_is_said_in_no_words() {
        let table = Paraphrases::english();
        assert_eq!(table.rephrase("", 1), "");
        assert_eq!(table.rephrase("   ", 1), "");
        for seed in 0..50 {
            assert!(!table.rephrase("a person", seed).is_empty());
        }
    }
}
