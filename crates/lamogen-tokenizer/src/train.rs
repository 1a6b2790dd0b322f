//! Training of a tokenizer on the texts that a network is trained on.

use tokenizers::models::bpe::{BPE, BpeTrainer};
use tokenizers::normalizers::{Lowercase, NFC, Sequence as Normalizers};
use tokenizers::pre_tokenizers::byte_level::ByteLevel;
use tokenizers::pre_tokenizers::digits::Digits;
use tokenizers::pre_tokenizers::punctuation::Punctuation;
use tokenizers::pre_tokenizers::sequence::Sequence as PreTokenizers;
use tokenizers::pre_tokenizers::whitespace::WhitespaceSplit;
use tokenizers::processors::template::TemplateProcessing;
use tokenizers::{AddedToken, Tokenizer, TokenizerBuilder};

use crate::TokenizerError;

const PAD: &str = "<|pad|>";
const START: &str = "<|startoftext|>";
const END: &str = "<|endoftext|>";

/// The size of the smallest vocabulary: every byte and three special tokens.
const MIN_VOCABULARY: usize = 256 + 3;

/// Trains a tokenizer by byte-pair encoding (Sennrich et al. 2016) and returns the content of its `tokenizer.json`.
///
/// The tokenizer has at most `vocab_size` ids. The padding has id 0, and the end token has the largest id. Upper and lower
/// case are not distinguished, and every digit and every punctuation mark is a word. The same texts give the same file.
///
/// # Errors
///
/// If the vocabulary has no room for all bytes.
pub fn train_tokenizer<'a>(
    texts: impl Iterator<Item = &'a str> + Send,
    vocab_size: usize,
) -> Result<Vec<u8>, TokenizerError> {
    let training_error = |problem: String| TokenizerError::Learning { problem };
    if vocab_size < MIN_VOCABULARY {
        return Err(training_error(format!(
            "expected a vocabulary of at least {MIN_VOCABULARY} ids, for every byte, found {vocab_size}"
        )));
    }
    let byte_level = ByteLevel::new(false, true, false);
    let mut tokenizer = TokenizerBuilder::default()
        .with_model(BPE::default())
        .with_normalizer(Some(Normalizers::new(vec![NFC.into(), Lowercase.into()])))
        .with_pre_tokenizer(Some(PreTokenizers::new(vec![
            WhitespaceSplit.into(),
            Punctuation::default().into(),
            Digits::new(true).into(),
            byte_level.into(),
        ])))
        .with_post_processor(None::<TemplateProcessing>)
        .with_decoder(None::<ByteLevel>)
        .build()
        .map_err(|error| training_error(error.to_string()))?;
    let mut trainer = BpeTrainer::builder()
        // The start and end tokens are added after training.
        .vocab_size(vocab_size - 2)
        .min_frequency(2)
        .show_progress(false)
        .initial_alphabet(ByteLevel::alphabet().into_iter().collect())
        .special_tokens(vec![AddedToken::from(PAD, true)])
        .build();
    tokenizer
        .train(&mut trainer, texts)
        .map_err(|error| training_error(error.to_string()))?;
    let mut tokenizer = Tokenizer::from(tokenizer);
    tokenizer.add_special_tokens(&[AddedToken::from(START, true), AddedToken::from(END, true)]);
    let id = |token: &str| {
        let id = tokenizer.token_to_id(token);
        id.map(|id| (token.to_owned(), id))
    };
    let special: Vec<(String, u32)> = [START, END].into_iter().filter_map(id).collect();
    let template = TemplateProcessing::builder()
        .try_single(format!("{START} $A {END}"))
        .map_err(|error| training_error(error.to_string()))?
        .special_tokens(special)
        .build()
        .map_err(|error| training_error(error.to_string()))?;
    tokenizer.with_post_processor(Some(template));
    let json = tokenizer.to_string(false);
    json.map(String::into_bytes)
        .map_err(|error| training_error(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tokenizer;

    const TEXTS: [&str; 4] = [
        "A person walks forward.",
        "a person walks back",
        "someone WALKS, then bows twice",
        "someone bows 2 times",
    ];

    #[test]
    fn what_is_learned_is_a_tokenizer_that_knows_its_words() {
        let json = train_tokenizer(TEXTS.into_iter(), 300).unwrap();
        assert_eq!(
            json,
            train_tokenizer(TEXTS.into_iter(), 300).unwrap(),
            "the same texts give the same"
        );
        let tokenizer = Tokenizer::from_json(&json, "learned", 300, 16).unwrap();
        let walks = tokenizer.encode("walks").unwrap();
        assert_eq!(walks.own, 1, "a frequent word is one token");
        assert_eq!(walks.ids, tokenizer.encode("WALKS").unwrap().ids);
        let unseen = tokenizer.encode("Žofia čte 日本").unwrap();
        assert!(unseen.own > 5, "unseen letters are bytes");
        let end = tokenizer.vocab_size() as u32 - 1;
        assert!(walks.ids.contains(&end) && *walks.ids.last().unwrap() == 0);
    }

    #[test]
    fn a_vocabulary_without_room_for_all_bytes_is_refused() {
        let message = train_tokenizer(TEXTS.into_iter(), 100)
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("259") && message.contains("100"),
            "{message}"
        );
    }
}
