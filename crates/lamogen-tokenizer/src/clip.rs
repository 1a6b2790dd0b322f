//! CLIP's byte-pair encoding, embedded.

use regex::Regex;
use tokenizers::Model;
use tokenizers::models::bpe::{BPE, Vocab};

use crate::clean::clean;

/// The merges that CLIP uses of OpenAI's `bpe_simple_vocab_16e6.txt`, below the file's first line.
const MERGES: &str = include_str!("../data/clip_merges.txt");

/// What stands at the end of a token that ends a word.
const END_OF_WORD: &str = "</w>";

pub(crate) const START: u32 = 49406;

/// The id that ends a text, the largest.
pub(crate) const END: u32 = 49407;
/// Tokens around those of a text: start and end.
pub(crate) const AROUND: usize = 2;
/// The longest prompt in bytes. Some repairs take time that grows with the square of a text made for it.
const LONGEST: usize = 100_000;

/// `clip/simple_tokenizer.py` of OpenAI's CLIP.
#[derive(Debug)]
pub(crate) struct ClipTokenizer {
    words: Regex,
    pairs: BPE,
    /// The character that stands for each byte.
    characters: [char; 256],
}

impl ClipTokenizer {
    pub(crate) fn new() -> Self {
        let merges: Vec<(String, String)> = MERGES
            .lines()
            .skip(1)
            .filter_map(|line| line.split_once(' '))
            .map(|(first, second)| (first.into(), second.into()))
            .collect();
        let bytes = byte_characters();
        let characters = || bytes.iter().map(|&(_, character)| character);
        let tokens = characters()
            .map(String::from)
            .chain(characters().map(|character| format!("{character}{END_OF_WORD}")))
            .chain(
                merges
                    .iter()
                    .map(|(first, second)| format!("{first}{second}")),
            );
        let vocabulary: Vocab = tokens.zip(0..).collect();
        let pairs = BPE::builder()
            .vocab_and_merges(vocabulary, merges)
            .end_of_word_suffix(END_OF_WORD.into())
            .build()
            .expect("every embedded merge joins two tokens that come before it");
        // U+0345 is no word: Python's regex, ignoring case, takes it for a letter in the last class
        // alone, the one that letters are not in.
        let words = Regex::new(
            r"(?i:<\|startoftext\|>|<\|endoftext\|>|'s|'t|'re|'ve|'m|'ll|'d)|\p{L}+|\p{N}|[^\s\p{L}\p{N}\x{345}]+",
        )
        .expect("the pattern is constant");
        let mut table = ['\0'; 256];
        for (byte, character) in bytes {
            table[usize::from(byte)] = character;
        }
        ClipTokenizer {
            words,
            pairs,
            characters: table,
        }
    }

    /// The ids of a prompt between those of start and end, or what is wrong with it.
    pub(crate) fn ids(&self, prompt: &str) -> Result<Vec<u32>, String> {
        if prompt.len() > LONGEST {
            return Err(format!(
                "expected at most {LONGEST} bytes, found {}",
                prompt.len()
            ));
        }
        let text = clean(prompt);
        let mut ids = vec![START];
        for word in self.words.find_iter(&text) {
            match word.as_str() {
                "<|startoftext|>" => ids.push(START),
                "<|endoftext|>" => ids.push(END),
                word => {
                    let bytes = word.bytes().map(|byte| self.characters[usize::from(byte)]);
                    let tokens = self.pairs.tokenize(&bytes.collect::<String>());
                    let tokens = tokens.map_err(|error| error.to_string())?;
                    ids.extend(tokens.iter().map(|token| token.id));
                }
            }
        }
        ids.push(END);
        Ok(ids)
    }
}

/// The bytes and the characters that stand for them, in the order of their ids: those that Latin-1
/// prints stand for themselves, the others follow as characters from U+0100 on.
fn byte_characters() -> Vec<(u8, char)> {
    let printed = |byte: &u8| matches!(byte, b'!'..=b'~' | 0xA1..=0xAC | 0xAE..=0xFF);
    let themselves = (0..=255)
        .filter(printed)
        .map(|byte| (byte, char::from(byte)));
    let others = (0..=255).filter(|byte| !printed(byte)).zip('\u{100}'..);
    themselves.chain(others).collect()
}
