//! Tests of the compact model's tokenizer.json against the ids of the Hugging Face library in Python.

use lamogen_tokenizer::{Tokenizer, TokenizerError};

const JSON: &[u8] = include_bytes!("../../lamogen-compact/model/tokenizer.json");
const VOCABULARY: usize = 12288;
const CONTEXT: usize = 32;

fn tokenizer() -> Tokenizer {
    Tokenizer::from_json(JSON, "tokenizer.json", VOCABULARY, CONTEXT).unwrap()
}

#[test]
fn ids_are_those_of_the_python_library() {
    for (prompt, expected) in [
        ("a person jumps", &[12286, 65, 377, 886, 12287][..]),
        (
            "A Person JUMPS, twice!",
            &[12286, 65, 377, 886, 12, 503, 1, 12287],
        ),
        ("   spaced   out  ", &[12286, 368, 4119, 326, 12287]),
        (
            "Ünïcode 😀 run",
            &[
                12286, 128, 121, 78, 128, 108, 8490, 173, 254, 247, 223, 342, 12287,
            ],
        ),
    ] {
        let tokens = tokenizer().encode(prompt).unwrap();
        assert_eq!(tokens.ids.len(), CONTEXT);
        assert_eq!(tokens.ids[..expected.len()], *expected, "{prompt}");
        assert!(
            tokens.ids[expected.len()..].iter().all(|&id| id == 0),
            "{prompt}"
        );
        assert_eq!(tokens.cut, 0);
    }
}

#[test]
fn a_long_prompt_is_cut_before_its_end_token_and_says_so() {
    let tokens = tokenizer().encode(&"walks ".repeat(40)).unwrap();
    let mut expected = vec![450; CONTEXT];
    expected[0] = 12286;
    expected[CONTEXT - 1] = 12287;
    assert_eq!(tokens.ids, expected);
    assert_eq!(tokens.cut, 40 - 30);
    // This prompt is as long as fits.
    assert_eq!(tokenizer().encode(&"walks ".repeat(30)).unwrap().cut, 0);
}

#[test]
fn ids_beyond_the_embedding_are_refused() {
    let error = Tokenizer::from_json(JSON, "folder/tokenizer.json", 12000, CONTEXT).unwrap_err();
    assert!(matches!(error, TokenizerError::Vocabulary { .. }));
    let message = error.to_string();
    for part in ["folder/tokenizer.json", "12287", "11999"] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn what_is_no_tokenizer_is_named() {
    let error = Tokenizer::from_json(b"{\"a\": 1}", "folder/tokenizer.json", VOCABULARY, CONTEXT);
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("folder/tokenizer.json")
    );
    let error = Tokenizer::from_file("no/tokenizer.json", VOCABULARY, CONTEXT).unwrap_err();
    assert!(error.to_string().contains("no/tokenizer.json"));
}

#[test]
fn a_tokenizer_without_an_end_token_is_refused() {
    let mut json: serde_json::Value = serde_json::from_slice(JSON).unwrap();
    json["post_processor"] = serde_json::Value::Null;
    let json = json.to_string();
    let error = Tokenizer::from_json(json.as_bytes(), "tokenizer.json", VOCABULARY, CONTEXT);
    let message = error.unwrap_err().to_string();
    assert!(message.contains("12287"), "{message}");
}

#[test]
fn special_tokens_in_a_prompt_are_text() {
    let tokens = tokenizer().encode("a person <|endoftext|> jumps").unwrap();
    assert_eq!(tokens.ids.iter().filter(|&&id| id == 12287).count(), 1);
    // "jumps" is still there, before the only end token.
    assert!(tokens.ids.contains(&886));
}

#[test]
fn a_prompt_without_tokens_is_refused() {
    let message = tokenizer().encode("  ").unwrap_err().to_string();
    assert!(message.contains("no token"), "{message}");
}

#[test]
fn templates_with_tokens_that_they_do_not_describe_are_refused() {
    let json = String::from_utf8(JSON.to_vec()).unwrap();
    let file: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(file["post_processor"]["type"], "TemplateProcessing");
    for (piece, expected) in [
        (
            serde_json::json!({ "SpecialToken": { "id": "[X]", "type_id": 0 } }),
            "[X]",
        ),
        (serde_json::json!({ "SpecialToken": ["[X]", 0] }), "[X]"),
        (
            serde_json::json!({ "Sequence": { "id": "B", "type_id": 0 } }),
            "sequence A",
        ),
    ] {
        let mut file = file.clone();
        file["post_processor"]["single"] = serde_json::json!([piece]);
        let in_sequence =
            serde_json::json!({ "type": "Sequence", "processors": [file["post_processor"]] });
        for processor in [file["post_processor"].clone(), in_sequence] {
            file["post_processor"] = processor;
            let json = serde_json::to_vec(&file).unwrap();
            let message = Tokenizer::from_json(&json, "tokenizer.json", VOCABULARY, CONTEXT)
                .err()
                .unwrap()
                .to_string();
            assert!(
                message.contains("post_processor") && message.contains(expected),
                "{message}"
            );
        }
    }
}

#[test]
fn merges_that_do_not_continue_a_word_are_refused() {
    let mut file: serde_json::Value = serde_json::from_slice(JSON).unwrap();
    file["model"]["continuing_subword_prefix"] = "##".into();
    for merges in [serde_json::json!([["a", "b"]]), serde_json::json!(["a b"])] {
        file["model"]["merges"] = merges;
        let json = serde_json::to_vec(&file).unwrap();
        let message = Tokenizer::from_json(&json, "tokenizer.json", VOCABULARY, CONTEXT)
            .err()
            .unwrap()
            .to_string();
        assert!(
            message.contains("merges[0]") && message.contains("\"b\""),
            "{message}"
        );
    }
}
