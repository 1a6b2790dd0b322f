//! Captions in other words with their contents, from which the text encoder of a model is made anew.

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Write;
use std::path::PathBuf;

use lamogen_data::{Entry, Split};
use lamogen_model::train_tokenizer;
use lamogen_motion::write_atomically;
use lamogen_train::other_phrasings;
use serde_json::json;

/// What the task reads and writes.
#[derive(clap::Args)]
pub struct Options {
    /// The captions.jsonl of a packed data set, of which the training split is used.
    pub captions: PathBuf,
    /// Further sentences, one a line, of which the tokenizer learns too.
    pub sentences: Vec<PathBuf>,
    /// Paraphrases of each caption.
    #[arg(long, default_value_t = 8, value_name = "N")]
    pub count: usize,
    /// Tokens of the tokenizer.
    #[arg(long, default_value_t = 12288, value_name = "N")]
    pub vocabulary: usize,
    /// Folder for phrasings.jsonl and tokenizer.json.
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// Writes a line of JSON for each distinct caption: the caption, how many motions of each content have it, and its paraphrases.
/// Writes a tokenizer that has learned from all of them, too.
///
/// # Errors
///
/// If a file cannot be read or written, or a line is not a motion of a packed data set.
pub fn run(options: &Options) -> Result<String, Box<dyn Error>> {
    let read = |path: &PathBuf| {
        std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
    };
    let mut contents: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for (place, line) in read(&options.captions)?.lines().enumerate() {
        let path = options.captions.display();
        let problem = |problem: &str| format!("{path}, line {}: {problem}", place + 1);
        let motion = Entry::from_json(line).map_err(|error| problem(&error))?;
        if motion.split != Split::Train {
            continue;
        }
        let content = { motion.content }.ok_or_else(|| problem("expected a \"content\""))?;
        for caption in motion.captions {
            let counts = contents.entry(caption.text).or_default();
            *counts.entry(content.clone()).or_default() += 1;
        }
    }
    if contents.is_empty() {
        let path = options.captions.display();
        return Err(format!("{path}: expected captions of the training split, found none").into());
    }
    let mut texts: Vec<String> = Vec::new();
    for path in &options.sentences {
        texts.extend(read(path)?.lines().map(str::to_owned));
    }
    let mut lines = String::new();
    for (caption, counts) in &contents {
        let phrasings = other_phrasings(caption, options.count);
        let line = json!({ "caption": caption, "contents": counts, "phrasings": phrasings });
        lines += &format!("{line}\n");
        texts.extend(phrasings);
        texts.push(caption.clone());
    }
    let tokenizer = train_tokenizer(texts.iter().map(String::as_str), options.vocabulary)?;
    std::fs::create_dir_all(&options.out)?;
    for (name, bytes) in [
        ("phrasings.jsonl", lines.as_bytes()),
        ("tokenizer.json", &tokenizer),
    ] {
        write_atomically(&options.out.join(name), |file| file.write_all(bytes))?;
    }
    Ok(format!(
        "{} captions in {} phrasings\n",
        contents.len(),
        texts.len()
    ))
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn options(folder: &std::path::Path, captions: &str) -> Options {
        let path = folder.join("captions.jsonl");
        std::fs::write(&path, captions).unwrap();
        Options {
            captions: path,
            sentences: Vec::new(),
            count: 4,
            vocabulary: 400,
            out: folder.join("out"),
        }
    }

    #[test]
    fn captions_for_training_are_written_once_with_all_their_contents() {
        let folder = tempfile::tempdir().unwrap();
        let motion = |split: &str, content: &str, caption: &str| {
            let line = json!({
                "name": content, "clip": 0, "start": 0, "frames": 60,
                "split": split, "content": content, "captions": [caption],
            });
            line.to_string()
        };
        let lines = [
            motion("train", "walk", "a person walks forward"),
            motion("train", "run", "a person walks forward"),
            motion("test", "jump", "a person jumps"),
        ];
        let options = options(folder.path(), &lines.join("\n"));
        run(&options).unwrap();
        let text = std::fs::read_to_string(options.out.join("phrasings.jsonl")).unwrap();
        let [line] = &text.lines().collect::<Vec<_>>()[..] else {
            panic!("expected one caption: {text}");
        };
        let line: Value = serde_json::from_str(line).unwrap();
        assert_eq!(line["contents"], json!({ "walk": 1, "run": 1 }));
        assert_eq!(line["phrasings"].as_array().unwrap().len(), 4);
        let tokenizer = options.out.join("tokenizer.json");
        assert!(lamogen_model::Tokenizer::from_file(&tokenizer, 400, 32).is_ok());
    }

    #[test]
    fn a_line_that_is_no_motion_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let options_of_none = options(folder.path(), "");
        let error = run(&options_of_none).unwrap_err().to_string();
        assert!(
            error.contains("captions.jsonl: expected captions"),
            "{error}"
        );
        assert!(!options_of_none.out.exists());
        let without_content = r#"{"name": "a", "clip": 0, "start": 0, "frames": 60, "split": "train", "captions": ["a person walks"]}"#;
        for line in [
            "{",
            r#"{"split": "train", "captions": []}"#,
            without_content,
        ] {
            let error = run(&options(folder.path(), line)).unwrap_err().to_string();
            assert!(error.contains("captions.jsonl, line 1"), "{error}");
        }
    }
}
