//! Several sentences on a command line: the options after a `--then` are those of its sentence.

use std::ffi::{OsStr, OsString};

use clap::error::ErrorKind;
use clap::{Args, CommandFactory, FromArgMatches, Parser};
use lamogen::files::ReadError;
use lamogen::{Device, Request, RequestedGoals};

use super::generate::GoalArguments;
use super::numbers::explain_number;
use super::{Arguments, Command};

/// The option that begins the next sentence.
const THEN: &str = "--then";
/// The options that belong to the sentence before them. Each has a value.
const OWN_OPTIONS: [&str; 8] = [
    "--seconds",
    "--weight",
    "--time",
    "--flow",
    "--shape",
    "--scale",
    "--like",
    "--part",
];

/// A sentence after the first, with its length and its goals.
#[derive(Args, Clone)]
pub struct SentenceArguments {
    /// What the person does.
    pub prompt: String,
    #[command(flatten)]
    pub goals: GoalArguments,
    /// Length in seconds.
    #[arg(long, default_value_t = 3.0)]
    pub seconds: f32,
}

/// A parser of the options of one sentence.
#[derive(Parser)]
#[command(name = "lamogen generate --then", allow_negative_numbers = true)]
struct SentenceParser {
    #[command(flatten)]
    sentence: SentenceArguments,
}

impl SentenceArguments {
    /// Returns whether the sentence has goals.
    pub fn has_goals(&self) -> bool {
        self.goals.requested_goals() != RequestedGoals::default()
    }

    /// Makes the request of the sentence. A motion file to be like is read here.
    ///
    /// # Errors
    ///
    /// If that file cannot be read.
    pub fn request(&self, device: &Device) -> Result<Request, ReadError> {
        let request = Request::new(&self.prompt).seconds(self.seconds);
        Ok(match self.goals.requested_goals().resolve(device)? {
            Some(goals) => request.scale(goals),
            None => request,
        })
    }
}

/// Parses the arguments of the command line.
///
/// # Errors
///
/// If they are not those of a command; requests for help and version are such errors, too.
pub fn parse(arguments: Vec<OsString>) -> Result<Arguments, clap::Error> {
    parse_sentences(arguments).map_err(explain_number)
}

/// Parses the arguments, of which each sentence of a row has its own.
fn parse_sentences(arguments: Vec<OsString>) -> Result<Arguments, clap::Error> {
    let (first, rest) = split(arguments);
    let mut matches = Arguments::command().try_get_matches_from(first)?;
    let mut arguments = Arguments::from_arg_matches_mut(&mut matches)
        .map_err(|error| error.format(&mut Arguments::command()))?;
    if let Command::Generate(options) = &mut arguments.command {
        let sentences = rest.into_iter().map(|sentence| {
            let name = [OsString::from("lamogen generate --then")];
            SentenceParser::try_parse_from(name.into_iter().chain(sentence))
                .map(|parser| parser.sentence)
        });
        options.sentences = sentences.collect::<Result<_, _>>()?;
        if options.baseline_only && options.sentences.iter().any(SentenceArguments::has_goals) {
            let message = "the argument '--baseline-only' cannot be used with the words of a sentence after '--then'";
            let mut all = Arguments::command();
            all.build();
            let generate = all.find_subcommand_mut("generate");
            let generate = generate.expect("generate is a command");
            return Err(generate.error(ErrorKind::ArgumentConflict, message));
        }
    }
    Ok(arguments)
}

/// Splits the arguments of `generate` into those of the first sentence and of the whole motion, and those of each further
/// sentence, which begin with the sentence. Those of other commands stay together.
fn split(arguments: Vec<OsString>) -> (Vec<OsString>, Vec<Vec<OsString>>) {
    let is_generate = { arguments.iter().skip(1) }
        .find(|argument| !argument.to_string_lossy().starts_with('-'))
        .is_some_and(|command| command == "generate");
    let (mut first, mut sentences) = (Vec::new(), Vec::<Vec<OsString>>::new());
    if !is_generate {
        return (arguments, sentences);
    }
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        let (name, value) = name_and_value(&argument);
        if name == THEN {
            let value = value.map(OsStr::to_owned).or_else(|| arguments.next());
            // The whole parser knows the option, and says what is wrong if its value is missing.
            first.push(THEN.into());
            first.extend(value.clone());
            sentences.push(value.into_iter().collect());
            continue;
        }
        let is_own = OWN_OPTIONS.iter().any(|option| name == *option);
        match (is_own, sentences.last_mut()) {
            (true, Some(sentence)) => {
                let value = match value {
                    Some(_) => None,
                    None => arguments.next(),
                };
                sentence.push(argument);
                sentence.extend(value);
            }
            _ => first.push(argument),
        }
    }
    (first, sentences)
}

/// Splits an argument such as `--seconds=2` into its name and its value, if it has one.
fn name_and_value(argument: &OsStr) -> (&OsStr, Option<&OsStr>) {
    let text = argument.to_str();
    match text.and_then(|text| text.split_once('=')) {
        Some((name, value)) if name.starts_with("--") => (name.as_ref(), Some(value.as_ref())),
        _ => (argument, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse_generate(text: &[&str]) -> Result<Box<super::super::GenerateArguments>, clap::Error> {
        let all = ["lamogen", "generate"].iter().chain(text);
        let arguments = parse(all.map(OsString::from).collect())?;
        match arguments.command {
            Command::Generate(options) => Ok(options),
            _ => panic!("it is generate"),
        }
    }

    #[test]
    fn options_belong_to_the_sentence_before_them() {
        let options = parse_generate(&[
            "a person walks",
            "--seconds",
            "4",
            "--then",
            "a person jumps",
            "--out",
            "a.glb",
            "--weight=strong",
            "--seconds",
            "2",
            "--then=a person waves",
            "--part",
            "arms:light",
            "--seed",
            "7",
        ])
        .unwrap();
        assert_eq!((options.seconds, options.seed), (4.0, 7));
        assert_eq!(options.out[0].to_string(), "a.glb");
        let [jump, wave] = &options.sentences[..] else {
            panic!("there are two more sentences");
        };
        assert_eq!((&jump.prompt[..], jump.seconds), ("a person jumps", 2.0));
        assert!(jump.goals.weight.is_some() && options.goals.weight.is_none());
        assert_eq!((&wave.prompt[..], wave.seconds), ("a person waves", 3.0));
        assert_eq!(wave.goals.part.len(), 1);
    }

    #[test]
    fn what_is_wrong_with_a_sentence_is_said() {
        for (wrong, part) in [
            (&["a", "--then"][..], "a value is required for '--then"),
            (&["a", "--then", "b", "--seconds"], "a value is required"),
            (
                &["a", "--then", "b", "--weight", "sudden"],
                "speaks of Time",
            ),
            (
                &["a", "--then", "b", "--weight", "1", "--scale", "1,1,1,1"],
                "cannot be used with",
            ),
            (&["a", "--then", "b", "--wings", "2"], "unexpected argument"),
        ] {
            let message = match parse_generate(wrong) {
                Err(error) => error.to_string(),
                Ok(_) => panic!("{wrong:?} is wrong"),
            };
            assert!(message.contains(part), "{wrong:?}: {message}");
        }
    }
}
