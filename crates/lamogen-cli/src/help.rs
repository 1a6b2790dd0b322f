//! `lamogen help`: prints the help of a command, or a topic that error messages refer to.

use clap::CommandFactory;

use crate::arguments::Arguments;
use crate::console::Console;
use crate::failure::{Failure, FailureCode};

/// The topics, each with its text.
const TOPICS: [(&str, &str); 4] = [
    ("model-folder", include_str!("topics/model-folder.txt")),
    ("data", include_str!("topics/data.txt")),
    ("recipe", include_str!("topics/recipe.txt")),
    ("sentences", include_str!("topics/sentences.txt")),
];

/// Prints the help of a command, of a subcommand, or a topic.
pub fn run(words: &[String], console: &Console) -> Result<(), Failure> {
    if let [word] = words
        && let Some((_, text)) = TOPICS.iter().find(|(topic, _)| topic == word)
    {
        return console.print(text);
    }
    let mut command = Arguments::command();
    command.build();
    let mut subcommand = &mut command;
    for word in words {
        subcommand = subcommand.find_subcommand_mut(word).ok_or_else(|| {
            let topics: Vec<&str> = TOPICS.iter().map(|(topic, _)| *topic).collect();
            Failure::new(
                FailureCode::Usage,
                format!(
                    "expected a command, or one of the topics {}; found {word}",
                    topics.join(", ")
                ),
            )
        })?;
    }
    console.print(subcommand.render_long_help().to_string())
}
