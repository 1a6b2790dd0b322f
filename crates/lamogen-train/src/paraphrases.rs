//! Paraphrases of captions.
//!
//! A network that is trained on a few thousand captions knows only the words of these captions. Paraphrases replace them by what
//! people also say: other subjects, synonyms of verbs in the same form, other phrases. They also turn a sentence about somebody
//! into a request ("a person walks" → "walk"), and add where and why something happens ("…, while the shop is empty"), from which
//! a network learns which words of a sentence do not matter.

use std::collections::{HashMap, HashSet};

use lamogen_model::words;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde::Deserialize;

/// The rules of `configs/paraphrases.json`, by which captions are paraphrased.
#[derive(Clone, Debug)]
pub struct Paraphrases {
    /// The plain subjects, and those that say who it is. Longer ones come first.
    subjects: [Vec<Vec<String>>; 2],
    /// What may stand before a caption, what may follow any caption, and what may follow one of plain locomotion.
    openings: Vec<Vec<String>>,
    closings: Vec<Vec<String>>,
    goals: Vec<Vec<String>>,
    /// The third persons of verbs that denote plain locomotion.
    locomotion: HashSet<String>,
    /// The three forms of the known verbs, by their third person.
    forms: HashMap<String, [String; 3]>,
    /// The rules by the first word of the phrase that they replace; longer phrases come first.
    rules: HashMap<String, Vec<SubstitutionRule>>,
}

/// A phrase and the phrases that may replace it, as words.
#[derive(Clone, Debug)]
struct SubstitutionRule {
    phrase: Vec<String>,
    alternatives: Vec<Vec<String>>,
}

/// The contents of `configs/paraphrases.json`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ParaphraseTable {
    /// The plain subjects.
    subjects: Vec<String>,
    /// Subjects that say who it is, of everyday life, which does not change how somebody moves.
    characters: Vec<String>,
    /// What may stand before almost any caption without changing the movement.
    openings: Vec<String>,
    /// What may follow almost any caption without changing the movement.
    closings: Vec<String>,
    /// What may follow a caption of plain locomotion.
    goals: Vec<String>,
    /// The third persons of verbs that denote plain locomotion.
    locomotion: HashSet<String>,
    /// The base form, third person and participle of each verb, separated by `|`, followed by those of its synonyms.
    verbs: Vec<Vec<String>>,
    /// Groups of phrases, each with the phrases that may replace them.
    phrases: Vec<[Vec<String>; 2]>,
}

impl Paraphrases {
    /// Returns the rules that come with the library, for English captions of movement.
    pub fn english() -> Self {
        let table = include_bytes!("../configs/paraphrases.json");
        let table: ParaphraseTable = serde_json::from_slice(table).expect("checked by a test");
        let phrases = |texts: &[String]| -> Vec<Vec<String>> {
            let mut phrases: Vec<_> = texts.iter().map(|text| words(text)).collect();
            phrases.sort_by_key(|phrase| std::cmp::Reverse(phrase.len()));
            phrases
        };
        let mut rules: HashMap<String, Vec<SubstitutionRule>> = HashMap::new();
        let mut add = |phrase: Vec<String>, alternatives: Vec<Vec<String>>| {
            rules
                .entry(phrase[0].clone())
                .or_default()
                .push(SubstitutionRule {
                    phrase,
                    alternatives,
                });
        };
        let mut forms = HashMap::new();
        for verb in &table.verbs {
            let all: Vec<[String; 3]> = { verb.iter() }
                .map(|forms| {
                    let forms: Vec<String> = forms.split('|').map(String::from).collect();
                    forms.try_into().expect("three forms a verb")
                })
                .collect();
            for verb_forms in &all {
                forms.insert(verb_forms[1].clone(), verb_forms.clone());
            }
            for form in 0..3 {
                let synonyms = all[1..].iter().map(|forms| words(&forms[form])).collect();
                add(vec![all[0][form].clone()], synonyms);
            }
        }
        for [phrases, alternatives] in &table.phrases {
            for phrase in phrases {
                let alternatives = { alternatives.iter() }
                    .filter(|alternative| *alternative != phrase)
                    .map(|alternative| words(alternative));
                add(words(phrase), alternatives.collect());
            }
        }
        for rules in rules.values_mut() {
            rules.sort_by_key(|rule| std::cmp::Reverse(rule.phrase.len()));
        }
        Paraphrases {
            subjects: [phrases(&table.subjects), phrases(&table.characters)],
            openings: phrases(&table.openings),
            closings: phrases(&table.closings),
            goals: phrases(&table.goals),
            locomotion: table.locomotion,
            forms,
            rules,
        }
    }

    /// Paraphrases a caption. The same seed gives the same paraphrase.
    pub fn rephrase(&self, caption: &str, seed: u64) -> String {
        /// The probability that the subject is replaced or left out.
        const SUBJECT_PROBABILITY: f64 = 0.6;
        /// The probability that a phrase with alternatives is replaced by one of them.
        const PHRASE_PROBABILITY: f64 = 0.4;
        /// The probability that a caption of few words gets an opening, a closing or a goal.
        const SETTING_PROBABILITY: f64 = 0.35;
        /// The number of words of a caption with which it may still get one of these.
        const SETTING_WORDS: usize = 12;
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut rest = &words(caption)[..];
        let mut output: Vec<String> = Vec::new();
        let subject = self.subject(rest);
        let is_locomotion =
            subject.is_some_and(|subject| self.is_locomotion(&rest[subject.len()..]));
        let has_setting = rest.len() <= SETTING_WORDS && generator.random_bool(SETTING_PROBABILITY);
        let closings = match has_setting.then(|| generator.random_range(0..3u32)) {
            None => None,
            Some(0) => {
                output.extend(choose(&self.openings, &mut generator).iter().cloned());
                output.push(",".to_owned());
                None
            }
            Some(1) if is_locomotion => Some(&self.goals),
            Some(_) => Some(&self.closings),
        };
        let mut verb = None;
        if let Some(subject) = subject {
            rest = &rest[subject.len()..];
            let forms = rest.first().and_then(|word| self.forms.get(word));
            if !generator.random_bool(SUBJECT_PROBABILITY) {
                output.extend(subject.iter().cloned());
            } else if let (Some([base, _, participle]), 0..4) =
                (forms, generator.random_range(0..10u32))
            {
                // A request ("walk"), or the form of a title ("walking").
                verb = Some(if generator.random_bool(0.6) {
                    base
                } else {
                    participle
                });
            } else {
                let subjects = &self.subjects[generator.random_range(0..2usize)];
                output.extend(choose(subjects, &mut generator).iter().cloned());
            }
        }
        if let Some(verb) = verb {
            let word = std::slice::from_ref(verb);
            self.write_phrase(word, &mut output, PHRASE_PROBABILITY, &mut generator);
            rest = &rest[1..];
        }
        while !rest.is_empty() {
            let length = self.write_phrase(rest, &mut output, PHRASE_PROBABILITY, &mut generator);
            rest = &rest[length..];
        }
        if let Some(closings) = closings {
            output.pop_if(|word| word == ".");
            output.extend(choose(closings, &mut generator).iter().cloned());
        }
        join(&output)
    }

    /// Returns the longest known subject with which a text begins.
    fn subject(&self, text: &[String]) -> Option<&Vec<String>> {
        { self.subjects.iter() }
            .filter_map(|subjects| subjects.iter().find(|subject| text.starts_with(subject)))
            .max_by_key(|subject| subject.len())
    }

    /// Returns whether a caption says of its subject only that it moves on, so that it may also say where to. `predicate` is what
    /// follows the subject.
    fn is_locomotion(&self, predicate: &[String]) -> bool {
        const STRAIGHT: [&str; 8] = [
            "forward", "forwards", "ahead", "straight", "onward", "on", "quickly", "slowly",
        ];
        match predicate {
            [verb, rest @ ..] => {
                self.locomotion.contains(verb)
                    && rest.iter().all(|word| STRAIGHT.contains(&word.as_str()))
            }
            [] => false,
        }
    }

    /// Writes the phrase at the beginning of `rest`, with the given probability as one of its alternatives, and returns how many
    /// words of `rest` it has.
    fn write_phrase(
        &self,
        rest: &[String],
        output: &mut Vec<String>,
        probability: f64,
        generator: &mut impl Rng,
    ) -> usize {
        let rules = { self.rules.get(&rest[0]) }.into_iter().flatten();
        let mut matches = rules
            .filter(|rule| rest.starts_with(&rule.phrase))
            .peekable();
        let Some(longest) = matches.peek().map(|rule| rule.phrase.len()) else {
            output.push(rest[0].clone());
            return 1;
        };
        if !generator.random_bool(probability) {
            output.extend(rest[..longest].iter().cloned());
            return longest;
        }
        let longest_matches = matches.take_while(|rule| rule.phrase.len() == longest);
        let alternatives: Vec<&Vec<String>> = longest_matches
            .flat_map(|rule| &rule.alternatives)
            .collect();
        output.extend(choose(&alternatives, generator).iter().cloned());
        longest
    }
}

/// Chooses an item at random.
fn choose<'a, T>(all: &'a [T], generator: &mut impl Rng) -> &'a T {
    &all[generator.random_range(0..all.len() as u64) as usize]
}

/// Joins words to a text: the inverse of [`words`], except for spaces.
fn join(words: &[String]) -> String {
    let mut text = String::new();
    for word in words {
        let needs_space = word.starts_with(char::is_alphanumeric) || word == "(";
        if needs_space && !text.is_empty() && !text.ends_with('(') {
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

    fn paraphrases(caption: &str) -> HashSet<String> {
        let table = Paraphrases::english();
        (0..400).map(|seed| table.rephrase(caption, seed)).collect()
    }

    #[test]
    fn a_caption_is_said_in_many_ways_and_in_the_same_one_for_a_seed() {
        let table = Paraphrases::english();
        let caption = "a person walks forward quickly";
        assert_eq!(table.rephrase(caption, 3), table.rephrase(caption, 3));
        let all = paraphrases(caption);
        assert!(all.len() > 50, "{}", all.len());
        assert!(all.contains(caption));
        let has = |part: &str| all.iter().any(|text| text.contains(part));
        assert!(has("someone") && has("strolls") && has("ahead") && has("rapidly"));
        assert!(all.iter().any(|text| text.starts_with("walk ")));
        assert!(all.iter().any(|text| text.starts_with("walking ")));
    }

    #[test]
    fn sides_and_numbers_stay() {
        for text in paraphrases("a man squats three times, then steps sideways to the left") {
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
    fn no_rule_exchanges_sides() {
        let has = |phrase: &[String], side: &str| phrase.iter().any(|word| word.starts_with(side));
        let table = Paraphrases::english();
        let mut sided = 0;
        for rule in table.rules.values().flatten() {
            for [side, other] in [["left", "right"], ["right", "left"]] {
                if !has(&rule.phrase, side) || has(&rule.phrase, other) {
                    continue;
                }
                sided += 1;
                let exchanged = { rule.alternatives.iter() }.find(|words| has(words, other));
                assert_eq!(exchanged, None, "{:?}", rule.phrase);
            }
        }
        assert!(sided > 100, "{sided}");
    }

    #[test]
    fn the_longest_phrase_counts() {
        for text in paraphrases("the figure makes a quarter turn to the right") {
            assert!(
                ["quarter", "90", "ninety", "right-angle"]
                    .iter()
                    .any(|part| text.contains(part)),
                "{text}"
            );
        }
    }

    #[test]
    fn settings_stand_around_a_caption_and_change_nothing_that_is_checked() {
        let table = Paraphrases::english();
        let [_, characters] = &table.subjects;
        let settings = [characters, &table.openings, &table.closings, &table.goals];
        assert!(settings.iter().all(|phrases| phrases.len() >= 500));
        let meaningful = [
            "left",
            "right",
            "leftward",
            "rightward",
            "twice",
            "thrice",
            "backward",
            "backwards",
            "crawls",
            "jumps",
            "kicks",
            "kneeling",
            "lying",
        ];
        for phrase in settings.into_iter().flatten() {
            let found = { phrase.iter() }.find(|word| meaningful.contains(&word.as_str()));
            assert_eq!(found, None, "{phrase:?}");
        }
        let all = paraphrases("a person kicks with the left leg");
        assert!(all.iter().any(|text| text.contains(", ")), "an opening");
        assert!(all.iter().all(|text| text.contains("left")));
        assert!(all.iter().all(|text| text.len() < 200));
    }

    #[test]
    fn goals_follow_plain_locomotion_alone() {
        let table = Paraphrases::english();
        let ends = |caption: &str| {
            let goals = &table.goals;
            let texts: Vec<Vec<String>> = paraphrases(caption)
                .iter()
                .map(|text| words(text))
                .collect();
            let has_goal = |text: &&Vec<String>| goals.iter().any(|goal| text.ends_with(goal));
            texts.iter().filter(has_goal).count()
        };
        assert!(ends("a person walks forward") > 5);
        let character = table.subjects[1][0].join(" ");
        assert!(ends(&format!("{character} runs")) > 5);
        // Some closings end as a goal does ("on the way to the bakery").
        assert!(ends("a person walks backward") <= ends("a person walks forward") / 3);
    }

    #[test]
    fn what_has_no_other_words_stays_and_punctuation_too() {
        // A text of so many words gets no setting.
        let text = "zorbing (twice), quietly; it's well-made, by zeus.";
        let others = paraphrases(text);
        assert!(others.contains(text), "{others:?}");
        assert!(others.iter().all(|other| other.starts_with("zorbing (")
            && other.ends_with(", quietly; it's well-made, by zeus.")));
        let text = "zorbing (twice), quietly; it's well-made.";
        let table = Paraphrases::english();
        let openings: Vec<String> = { table.openings.iter() }
            .map(|opening| format!("{}, ", join(opening)))
            .collect();
        let closings: Vec<String> = table.closings.iter().map(|closing| join(closing)).collect();
        let others = paraphrases(text);
        assert!(others.contains(text), "{others:?}");
        for other in &others {
            let (before, rest) = other.split_once("zorbing (").expect("the beginning");
            let (_, after) = rest
                .split_once("), quietly; it's well-made")
                .expect("the end");
            let is_opened = openings.iter().any(|opening| opening == before) && after == ".";
            let is_closed =
                before.is_empty() && closings.iter().any(|closing| after.trim_start() == closing);
            assert!(
                is_opened || is_closed || before.is_empty() && after == ".",
                "{other}"
            );
        }
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
