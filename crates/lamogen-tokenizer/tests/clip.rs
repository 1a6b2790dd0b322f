//! Tests of CLIP's embedded tokenizer against the ids of OpenAI's own tokenizer in Python (`clip/simple_tokenizer.py` with
//! ftfy 6.3.1 and Unicode 16 in the package regex).

use std::fmt::Write;

use lamogen_tokenizer::{Tokenizer, TokenizerError, Tokens};
use serde_json::{Map, Value, json};

const CONTEXT: usize = 77;
const VOCABULARY: usize = 49408;
const END: u32 = 49407;

/// Captions and other texts that people type.
const CAPTIONS: &str = include_str!("clip_tokens.jsonl");

/// Texts that were decoded in wrong encodings, HTML's character references, control characters and the like. The first 61
/// texts were written by hand, the others generated at random.
const BROKEN: &str = include_str!("clip_broken_texts.jsonl");

/// Returns the texts of a file and their ids, including start and end.
fn golden(lines: &str) -> Vec<(String, Vec<u32>)> {
    lines
        .lines()
        .map(|line| {
            let line: Value = serde_json::from_str(line).unwrap();
            let ids = line["ids"].as_array().unwrap().iter();
            let ids = ids.map(|id| id.as_u64().unwrap() as u32).collect();
            (line["text"].as_str().unwrap().to_owned(), ids)
        })
        .collect()
}

fn padded(ids: &[u32], context_length: usize) -> Vec<u32> {
    let mut ids = ids.to_vec();
    ids.resize(context_length, 0);
    ids
}

#[track_caller]
fn assert_golden(lines: &str, count: usize, context_length: usize) {
    let tokenizer = Tokenizer::clip(context_length);
    let texts = golden(lines);
    assert_eq!(texts.len(), count);
    let mut wrong = String::new();
    for (text, expected) in texts {
        let found = tokenizer.encode(&text).unwrap().ids;
        if found != padded(&expected, context_length) {
            writeln!(
                wrong,
                "{text:?}\n  expected {expected:?}\n  found    {found:?}"
            )
            .unwrap();
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn captions_have_the_ids_of_the_original() {
    assert_golden(CAPTIONS, 177, CONTEXT);
}

#[test]
fn broken_texts_have_the_ids_of_the_original() {
    assert_golden(BROKEN, 261, 256);
}

#[test]
fn broken_text_is_repaired() {
    let tokenizer = Tokenizer::clip(CONTEXT);
    for (broken, meant) in [
        ("âœ” No problems", "✔ no problems"),
        ("schÃƒÂ¶n", "schön"),
        ("doesn’t &#x2018;jump&rsquo;", "doesn't 'jump'"),
        ("ﬁngers ＪＵＭＰ", "fingers jump"),
        ("\x1b[31mred\x1b[0m \u{2028} light", "red light"),
        ("P&EACUTE;REZ &amp;amp; co", "pérez & co"),
        ("cafe\u{301}", "café"),
    ] {
        let ids = |text| tokenizer.encode(text).unwrap();
        assert_eq!(ids(broken), ids(meant), "{broken}");
        assert_ne!(ids(broken), ids("something else"));
    }
}

#[test]
fn a_long_prompt_is_cut_before_its_end_token_and_says_so() {
    let long = "jumps ".repeat(100);
    let mut expected = vec![18911; CONTEXT];
    expected[0] = 49406;
    expected[CONTEXT - 1] = END;
    let tokens = Tokenizer::clip(CONTEXT).encode(&long).unwrap();
    assert_eq!((tokens.ids, tokens.cut), (expected, 25));
    // This prompt is as long as fits.
    let fits = Tokenizer::clip(CONTEXT)
        .encode(&"jumps ".repeat(75))
        .unwrap();
    assert_eq!((fits.ids[CONTEXT - 1], fits.cut), (END, 0));
    // The context has room only for the end token, or for no token at all.
    for (context_length, ids) in [(1, vec![END]), (0, vec![])] {
        let cut = 102 - context_length;
        let tokens = Tokenizer::clip(context_length).encode(&long).unwrap();
        let length = context_length;
        let expected = Tokens {
            ids,
            length,
            cut,
            own: 100,
        };
        assert_eq!(tokens, expected);
    }
}

#[test]
fn any_character_and_any_length_can_be_encoded() {
    let tokenizer = Tokenizer::clip(CONTEXT);
    for first in (0..0x11_0000).step_by(0x100) {
        let block: String = (first..first + 0x100).filter_map(char::from_u32).collect();
        assert_eq!(tokenizer.encode(&block).unwrap().ids.len(), CONTEXT);
    }
    for unit in [
        "a",
        "&",
        "&#",
        "\x1b[;",
        "Ã",
        "Ã\u{a0}",
        "Ã¢â‚¬â„¢ ",
        "ï¿½",
        "é\u{301}",
        "<|endoftext|>",
    ] {
        assert_eq!(
            tokenizer.encode(&unit.repeat(5_000)).unwrap().ids.len(),
            CONTEXT
        );
    }
}

#[test]
fn the_sizes_are_those_of_clip() {
    let tokenizer = Tokenizer::clip(CONTEXT);
    assert_eq!(tokenizer.context_length(), CONTEXT);
    assert_eq!(tokenizer.vocab_size(), VOCABULARY);
}

/// Builds the `tokenizer.json` that is published with CLIP from the embedded merges. Unlike the embedded tokenizer, it
/// does not treat a final sigma specially, because it converts each letter to lower case separately.
fn published() -> String {
    let merges: Vec<&str> = include_str!("../data/clip_merges.txt")
        .lines()
        .skip(1)
        .collect();
    let printed = |byte: &u32| matches!(byte, 0x21..=0x7e | 0xa1..=0xac | 0xae..=0xff);
    let bytes: Vec<String> = (0..256)
        .filter(printed)
        .chain(0x100..0x100 + 68)
        .filter_map(char::from_u32)
        .map(String::from)
        .collect();
    let ends = bytes.iter().map(|byte| format!("{byte}</w>"));
    let joined = merges.iter().map(|merge| merge.replace(' ', ""));
    let special = ["<|startoftext|>", "<|endoftext|>"];
    let tokens = bytes.iter().cloned().chain(ends).chain(joined);
    let vocabulary: Map<String, Value> = tokens
        .chain(special.map(String::from))
        .zip((0..).map(Value::from))
        .collect();
    assert_eq!(vocabulary.len(), VOCABULARY);
    let added = |(content, id)| {
        json!({"id": id, "content": content, "single_word": false, "lstrip": false,
               "rstrip": false, "normalized": content == special[0], "special": true})
    };
    json!({
        "version": "1.0",
        "truncation": null,
        "padding": null,
        "added_tokens": special.into_iter().zip(49406..).map(added).collect::<Vec<_>>(),
        "normalizer": {"type": "Sequence", "normalizers": [
            {"type": "NFC"},
            {"type": "Replace", "pattern": {"Regex": r"\s+"}, "content": " "},
            {"type": "Lowercase"},
        ]},
        "pre_tokenizer": {"type": "Sequence", "pretokenizers": [
            {"type": "Split", "behavior": "Removed", "invert": true, "pattern": {"Regex":
                r"'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+"}},
            {"type": "ByteLevel", "add_prefix_space": false, "trim_offsets": true},
        ]},
        "post_processor": {
            "type": "RobertaProcessing", "trim_offsets": false, "add_prefix_space": false,
            "sep": ["<|endoftext|>", 49407], "cls": ["<|startoftext|>", 49406],
        },
        "decoder": {"type": "ByteLevel", "add_prefix_space": true, "trim_offsets": true},
        "model": {
            "type": "BPE", "dropout": null, "unk_token": "<|endoftext|>",
            "continuing_subword_prefix": "", "end_of_word_suffix": "</w>", "fuse_unk": false,
            "vocab": vocabulary, "merges": merges,
        },
    })
    .to_string()
}

#[test]
fn the_published_file_agrees_on_ordinary_texts() {
    let json = published();
    let file =
        Tokenizer::from_json(json.as_bytes(), "tokenizer.json", VOCABULARY, CONTEXT).unwrap();
    let clip = Tokenizer::clip(CONTEXT);
    assert_eq!(file.vocab_size(), clip.vocab_size());
    let captions = golden(CAPTIONS).into_iter().map(|(text, _)| text);
    let ordinary = captions.filter(|text| text.is_ascii() && !text.contains(['&', '<']));
    let others = [
        "Ein schöner Sprung!",
        "人跳起来",
        "jump 🤸 twice",
        "ПРЫЖОК 3½ раза",
    ];
    let texts: Vec<String> = ordinary.chain(others.map(String::from)).collect();
    let mut compared = 0;
    for text in texts.iter().filter(|text| !text.trim().is_empty()) {
        assert_eq!(
            file.encode(text).unwrap(),
            clip.encode(text).unwrap(),
            "{text:?}"
        );
        compared += 1;
    }
    assert!(compared > 150, "{compared}");
}

#[test]
fn special_tokens_and_empty_prompts_are_read_as_documented() {
    let json = published();
    let file =
        Tokenizer::from_json(json.as_bytes(), "tokenizer.json", VOCABULARY, CONTEXT).unwrap();
    let clip = Tokenizer::clip(CONTEXT);
    let ends = |tokens: Tokens| tokens.ids.iter().filter(|&&id| id == END).count();
    let prompt = "a person <|endoftext|> jumps";
    assert_eq!(ends(clip.encode(prompt).unwrap()), 2);
    assert_eq!(ends(file.encode(prompt).unwrap()), 1);
    assert_eq!(
        clip.encode(" \n").unwrap().ids,
        padded(&[49406, END], CONTEXT)
    );
    assert!(matches!(
        file.encode(" \n"),
        Err(TokenizerError::Prompt { .. })
    ));
}

#[test]
fn a_prompt_beyond_all_use_is_refused() {
    let error = Tokenizer::clip(77)
        .encode(&"walks ".repeat(20_000))
        .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("at most 100000 bytes, found 120000")
    );
}

#[test]
fn tokens_of_the_prompt_itself_are_counted() {
    let tokenizer = Tokenizer::clip(77);
    let own = |prompt: &str| tokenizer.encode(prompt).unwrap().own;
    assert_eq!([own("a person jumps"), own(""), own("&nbsp;")], [3, 0, 0]);
    assert_eq!(own(&"walks ".repeat(100)), 100);
}
