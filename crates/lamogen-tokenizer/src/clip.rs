//! CLIP's byte-pair encoding with its embedded merges.

use regex::Regex;
use tokenizers::Model;
use tokenizers::models::bpe::{BPE, Vocab};

use crate::clean::clean;

/// The merges of OpenAI's `bpe_simple_vocab_16e6.txt` that CLIP uses. The first line of the file is not a merge.
const MERGES: &str = include_str!("../data/clip_merges.txt");

/// The suffix of a token that ends a word.
const END_OF_WORD: &str = "</w>";

/// The id of the start token.
pub(crate) const START: u32 = 49406;

/// The id of the end token, which is the largest id.
pub(crate) const END: u32 = 49407;
/// The number of special tokens around those of a text: start and end.
pub(crate) const SPECIAL_TOKENS: usize = 2;
/// The length of the longest prompt in bytes. For texts that are made to be slow, the time of some repairs grows with the
/// square of the length.
const MAX_PROMPT_BYTES: usize = 100_000;

/// The tokenizer of OpenAI's CLIP (`clip/simple_tokenizer.py`).
#[derive(Debug)]
pub(crate) struct ClipTokenizer {
    word_pattern: Regex,
    pairs: BPE,
    /// The character that represents each byte.
    byte_characters: [char; 256],
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
        // U+0345 matches no alternative. Python's regex, which ignores case here, treats it as a letter only in the last
        // class, which excludes letters.
        let word_pattern = Regex::new(
            r"(?i:<\|startoftext\|>|<\|endoftext\|>|'s|'t|'re|'ve|'m|'ll|'d)|\p{L}+|\p{N}|[^\s\p{L}\p{N}\x{345}]+",
        )
        .expect("the pattern is constant");
        let mut table = ['\0'; 256];
        for (byte, character) in bytes {
            table[usize::from(byte)] = character;
        }
        ClipTokenizer {
            word_pattern,
            pairs,
            byte_characters: table,
        }
    }

    /// Returns the ids of a prompt between those of start and end, or a description of the problem.
    pub(crate) fn ids(&self, prompt: &str) -> Result<Vec<u32>, String> {
        if prompt.len() > MAX_PROMPT_BYTES {
            return Err(format!(
                "expected at most {MAX_PROMPT_BYTES} bytes, found {}",
                prompt.len()
            ));
        }
        let text = clean(prompt);
        let mut ids = vec![START];
        for word in self.word_pattern.find_iter(&text) {
            match word.as_str() {
                "<|startoftext|>" => ids.push(START),
                "<|endoftext|>" => ids.push(END),
                word => {
                    let bytes = word
                        .bytes()
                        .map(|byte| self.byte_characters[usize::from(byte)]);
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

/// Returns the bytes and the characters that represent them, in the order of their ids.
///
/// The bytes that are printable in Latin-1 represent themselves. The other bytes follow, with characters from U+0100 on.
fn byte_characters() -> Vec<(u8, char)> {
    let is_printable = |byte: &u8| matches!(byte, b'!'..=b'~' | 0xA1..=0xAC | 0xAE..=0xFF);
    let printable = (0..=255)
        .filter(is_printable)
        .map(|byte| (byte, char::from(byte)));
    let others = (0..=255)
        .filter(|byte| !is_printable(byte))
        .zip('\u{100}'..);
    printable.chain(others).collect()
}
