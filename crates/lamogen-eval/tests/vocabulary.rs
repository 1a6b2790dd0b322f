//! Tests of reading captions for the public evaluator.
//!
//! tests/golden/glove holds eight words in the form of the public code's folder `glove`. A word's vector is the number
//! of its row, and this number divided by 4 (`make.py`).

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen_eval::{PartOfSpeech, TextBatch, Vocabulary};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/glove")
}

/// Returns the rows and the parts of speech of a caption, with padding, and the caption's length.
fn read(tokens: &str) -> (Vec<usize>, Vec<PartOfSpeech>, usize) {
    let vocabulary = Vocabulary::from_folder(folder()).unwrap();
    let sentence = vocabulary.sentence(tokens).unwrap();
    let batch = vocabulary.batch(&[sentence], &Device::flex());
    let TextBatch::Words {
        vectors,
        parts_of_speech,
        lengths,
    } = batch
    else {
        panic!("a vocabulary makes words");
    };
    assert_eq!(
        (vectors.dims(), parts_of_speech.dims()),
        ([1, 22, 2], [1, 22, 15])
    );
    let vectors: Vec<f32> = vectors.try_into_vec_as().unwrap();
    let parts: Vec<f32> = parts_of_speech.try_into_vec_as().unwrap();
    let rows = vectors.chunks(2).map(|vector| {
        assert_eq!(vector[1], vector[0] / 4.0);
        vector[0] as usize
    });
    let parts = parts.chunks(15).map(|one_hot| {
        assert_eq!(one_hot.iter().sum::<f32>(), 1.0);
        let place = one_hot.iter().position(|&x| x == 1.0).unwrap();
        PartOfSpeech::ALL[place]
    });
    (rows.collect(), parts.collect(), lengths[0])
}

#[test]
fn a_caption_has_start_and_end_and_special_words_have_their_own_part() {
    use PartOfSpeech::*;
    let (rows, parts, length) = read("a/DET man/NOUN walk/NOUN up/ADP happily/ADV man/XYZ");
    assert_eq!(length, 8);
    assert_eq!(rows[..8], [9, 0, 1, 2, 4, 5, 1, 8]);
    assert_eq!(
        parts[..8],
        [Other, Det, Noun, ActVip, LocVip, DescVip, Other, Other]
    );
    assert_eq!(rows[8..], [7; 14]);
    assert!(parts[8..].iter().all(|&part| part == Other));
}

#[test]
fn a_word_without_a_vector_is_unknown_even_if_it_is_special() {
    let (rows, parts, _) = read("man/NOUN jump/VERB");
    assert_eq!(rows[..4], [9, 1, 7, 8]);
    assert_eq!(parts[2], PartOfSpeech::Other);
}

#[test]
fn captions_are_cut_after_twenty_words() {
    for (words, length) in [(19, 21), (20, 22), (40, 22)] {
        let (rows, _, found) = read(&vec!["man/NOUN"; words].join(" "));
        assert_eq!((found, rows[length - 1]), (length, 8));
        assert_eq!(rows[1..length - 1], vec![1; length - 2]);
    }
}

#[test]
fn a_token_without_a_part_is_named() {
    let vocabulary = Vocabulary::from_folder(folder()).unwrap();
    assert!(vocabulary.contains("walk") && !vocabulary.contains("jump"));
    for wrong in ["man", "man/NOUN/VERB"] {
        let error = vocabulary.sentence(&format!("a/DET {wrong}")).unwrap_err();
        let message = error.to_string();
        assert!(
            message.starts_with("token 2 of") && message.contains(wrong),
            "{message}"
        );
    }
}

#[test]
fn files_that_hold_something_else_are_named() {
    let damaged = |name: &str, from: &str| {
        let copy = tempfile::tempdir().unwrap();
        for file in ["our_vab_data.npy", "our_vab_words.pkl", "our_vab_idx.pkl"] {
            let source = if file == name { from } else { file };
            match source {
                "" => std::fs::write(copy.path().join(file), b"\x80\x03no pickle").unwrap(),
                source => {
                    std::fs::copy(folder().join(source), copy.path().join(file)).unwrap();
                }
            }
        }
        Vocabulary::from_folder(copy.path())
            .unwrap_err()
            .to_string()
    };
    let swapped = damaged("our_vab_words.pkl", "our_vab_idx.pkl");
    assert!(
        swapped.contains("our_vab_words.pkl: expected a list of words, found a dictionary"),
        "{swapped}"
    );
    let swapped = damaged("our_vab_idx.pkl", "our_vab_words.pkl");
    assert!(
        swapped.contains("our_vab_idx.pkl: expected a dictionary"),
        "{swapped}"
    );
    let broken = damaged("our_vab_words.pkl", "");
    assert!(
        broken.contains("our_vab_words.pkl: expected a Python pickle"),
        "{broken}"
    );
    let missing = Vocabulary::from_folder("/nowhere").unwrap_err().to_string();
    assert!(missing.contains("our_vab_data.npy"), "{missing}");
}
