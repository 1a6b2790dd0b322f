//! The public evaluator's words: GloVe vectors and parts of speech.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::npy::{self, NpyError};
use pytorch_reader::{PickleValue, PytorchReader};

use crate::TextBatch;

/// Words and their vectors, from the folder `glove` of the public code (`EricGuo5513/text-to-motion`).
#[derive(Clone, Debug)]
pub struct Vocabulary {
    /// The vectors of the words, `[words, width]`, row by row.
    vectors: Vec<f32>,
    width: usize,
    /// The row of each word.
    rows: HashMap<String, usize>,
    /// The row of the word that stands for all unknown words.
    unknown: usize,
}

/// A caption as rows of the vocabulary, with start and end, cut and padded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sentence {
    /// The row and the part of speech of each word.
    words: [(usize, PartOfSpeech); PADDED_WORDS],
    /// The number of words including start and end.
    length: usize,
}

/// An error of a vocabulary or of a caption's tokens.
#[derive(Debug, thiserror::Error)]
pub enum VocabularyError {
    /// The vectors cannot be read.
    #[error(transparent)]
    Vectors(#[from] NpyError),
    /// A pickle file cannot be read, or its content is not as expected.
    #[error("{path}: expected {expected}, found {found}")]
    #[allow(missing_docs)]
    Content {
        path: PathBuf,
        expected: String,
        found: String,
    },
    /// A token is not a word, a slash and a part of speech.
    #[error(
        "token {number} of `{tokens}`: expected a word, a slash and its part of speech, as in `walks/VERB`, found `{found}`"
    )]
    #[allow(missing_docs)]
    Token {
        tokens: String,
        number: usize,
        found: String,
    },
}

/// The number of words of a caption that are read; longer captions are cut.
const MAX_WORDS: usize = 20;

/// The number of words of a padded caption, including its start and its end.
const PADDED_WORDS: usize = MAX_WORDS + 2;

const START: &str = "sos";
const END: &str = "eos";
const UNKNOWN: &str = "unk";

impl Vocabulary {
    /// Reads `our_vab_data.npy` (`[words, width]`), `our_vab_words.pkl` (a list of words) and `our_vab_idx.pkl` (each
    /// word's row) from a folder.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, a file's content is not as expected, a word has no row, or the word `unk` is missing.
    pub fn from_folder(folder: impl AsRef<Path>) -> Result<Self, VocabularyError> {
        let folder = folder.as_ref();
        let vectors_path = folder.join("our_vab_data.npy");
        let array = npy::read(&vectors_path)?;
        let &[count, width] = array.shape.as_slice() else {
            let found = format!("the shape {:?}", array.shape);
            return Err(content_error(&vectors_path, "one vector a word", found));
        };
        let index_path = folder.join("our_vab_idx.pkl");
        let index = match read_pickle(&index_path)? {
            PickleValue::Dict(index) => index,
            other => return Err(content_error(&index_path, "a dictionary", describe(&other))),
        };
        let words_path = folder.join("our_vab_words.pkl");
        let words = match read_pickle(&words_path)? {
            PickleValue::List(words) => words,
            other => {
                return Err(content_error(
                    &words_path,
                    "a list of words",
                    describe(&other),
                ));
            }
        };
        let mut rows = HashMap::with_capacity(words.len());
        for word in words {
            let PickleValue::String(word) = word else {
                return Err(content_error(
                    &words_path,
                    "a list of words",
                    describe(&word),
                ));
            };
            let row = match index.get(&word) {
                Some(PickleValue::Int(row)) => {
                    usize::try_from(*row).ok().filter(|&row| row < count)
                }
                _ => None,
            };
            let Some(row) = row else {
                let expected = format!("for the word `{word}` a row below {count}");
                let found = index.get(&word).map_or("no entry".into(), describe);
                return Err(content_error(&index_path, expected, found));
            };
            rows.insert(word, row);
        }
        let Some(&unknown) = rows.get(UNKNOWN) else {
            let expected = format!("the word `{UNKNOWN}`, which stands for all others");
            return Err(content_error(
                &words_path,
                expected,
                format!("{} words without it", rows.len()),
            ));
        };
        Ok(Vocabulary {
            vectors: array.values,
            width,
            rows,
            unknown,
        })
    }

    /// Returns the width of a word's vector.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns whether a word has a vector of its own.
    pub fn contains(&self, word: &str) -> bool {
        self.rows.contains_key(word)
    }

    /// Reads the tokens of a caption. HumanML3D's texts have them after the first `#`, such as
    /// `a/DET man/NOUN walk/VERB`.
    ///
    /// A word in one of the public code's lists of special words gets the part of speech of that list
    /// ([`PartOfSpeech::LocVip`] and the like), whatever its tag is. A word without a vector is read as `unk` with the
    /// part of speech `OTHER`. A start and an end are added; captions of more than 20 words are cut.
    ///
    /// # Errors
    ///
    /// If a token is not a word, a slash and a part of speech.
    pub fn sentence(&self, tokens: &str) -> Result<Sentence, VocabularyError> {
        let mut words = [self.look_up(UNKNOWN, "OTHER"); PADDED_WORDS];
        words[0] = self.look_up(START, "OTHER");
        let mut length = 1;
        for (number, token) in tokens.split_whitespace().enumerate() {
            let parts = token.split_once('/');
            let Some((word, part)) = parts.filter(|(_, part)| !part.contains('/')) else {
                return Err(VocabularyError::Token {
                    tokens: tokens.to_owned(),
                    number: number + 1,
                    found: token.to_owned(),
                });
            };
            if number < MAX_WORDS {
                words[length] = self.look_up(word, part);
                length += 1;
            }
        }
        words[length] = self.look_up(END, "OTHER");
        Ok(Sentence {
            words,
            length: length + 1,
        })
    }

    fn look_up(&self, word: &str, part: &str) -> (usize, PartOfSpeech) {
        match self.rows.get(word) {
            Some(&row) => (row, PartOfSpeech::of(word, part)),
            None => (self.unknown, PartOfSpeech::Other),
        }
    }

    /// Returns sentences as a batch for a network that reads words.
    ///
    /// # Panics
    ///
    /// If a sentence was read with a larger vocabulary.
    pub fn batch(&self, sentences: &[Sentence], device: &Device) -> TextBatch {
        let parts = PartOfSpeech::ALL.len();
        let mut vectors = Vec::with_capacity(sentences.len() * PADDED_WORDS * self.width);
        let mut parts_of_speech = vec![0f32; sentences.len() * PADDED_WORDS * parts];
        let words = sentences.iter().flat_map(|sentence| sentence.words);
        for (one_hot, (row, part)) in parts_of_speech.chunks_exact_mut(parts).zip(words) {
            vectors.extend_from_slice(&self.vectors[row * self.width..][..self.width]);
            one_hot[part as usize] = 1.0;
        }
        let tensor = |values, width| {
            let shape = [sentences.len(), PADDED_WORDS, width];
            Tensor::from_data(TensorData::new(values, shape), device)
        };
        TextBatch::Words {
            vectors: tensor(vectors, self.width),
            parts_of_speech: tensor(parts_of_speech, parts),
            lengths: sentences.iter().map(|sentence| sentence.length).collect(),
        }
    }
}

impl Sentence {
    /// Returns the number of words, with start and end.
    pub(crate) fn len(&self) -> usize {
        self.length
    }
}

/// Reads a file of Python's pickle format.
fn read_pickle(path: &Path) -> Result<PickleValue, VocabularyError> {
    PytorchReader::read_pickle_data(path, None)
        .map_err(|error| content_error(path, "a Python pickle", error.to_string()))
}

fn content_error(
    path: &Path,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> VocabularyError {
    VocabularyError::Content {
        path: path.to_owned(),
        expected: expected.into(),
        found: found.into(),
    }
}

fn describe(value: &PickleValue) -> String {
    match value {
        PickleValue::Int(number) => format!("the number {number}"),
        PickleValue::String(text) => format!("the text `{text}`"),
        PickleValue::List(_) => "a list".into(),
        PickleValue::Dict(_) => "a dictionary".into(),
        other => format!("{other:?}"),
    }
}

macro_rules! parts_of_speech {
    ($($(#[$doc:meta])* $name:ident = $tag:literal),* $(,)?) => {
        /// The parts of speech of the public evaluator, in its order. The five before the last are lists of special
        /// words: a word in such a list has this part of speech, whatever its tag is.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum PartOfSpeech {
            $($(#[$doc])* $name),*
        }

        impl PartOfSpeech {
            /// All parts of speech, in the order of the public evaluator.
            pub const ALL: [PartOfSpeech; 15] = [$(PartOfSpeech::$name),*];

            /// Returns the tag that captions have for it, such as `VERB`.
            pub fn tag(self) -> &'static str {
                match self {
                    $(PartOfSpeech::$name => $tag),*
                }
            }
        }
    };
}

parts_of_speech! {
    /// A verb.
    Verb = "VERB",
    /// A noun.
    Noun = "NOUN",
    /// An article or the like.
    Det = "DET",
    /// A preposition.
    Adp = "ADP",
    /// A number.
    Num = "NUM",
    /// An auxiliary verb.
    Aux = "AUX",
    /// A pronoun.
    Pron = "PRON",
    /// An adjective.
    Adj = "ADJ",
    /// An adverb.
    Adv = "ADV",
    /// A special word of place or direction.
    LocVip = "Loc_VIP",
    /// A special part of the body.
    BodyVip = "Body_VIP",
    /// A special object.
    ObjVip = "Obj_VIP",
    /// A special action.
    ActVip = "Act_VIP",
    /// A special word of manner.
    DescVip = "Desc_VIP",
    /// Anything else.
    Other = "OTHER",
}

impl PartOfSpeech {
    /// Returns the part of speech of a word that has a vector: that of the list of special words that it is in, or else
    /// that of its tag.
    fn of(word: &str, tag: &str) -> PartOfSpeech {
        let special = SPECIAL_WORDS
            .iter()
            .find(|(_, words)| words.contains(&word));
        let tagged = || {
            let mut all = PartOfSpeech::ALL.into_iter();
            all.find(|part| part.tag() == tag)
        };
        special
            .map(|(part, _)| *part)
            .or_else(tagged)
            .unwrap_or(PartOfSpeech::Other)
    }
}

/// The public code's lists of special words (`VIP` in its names), which have parts of speech of their own.
#[rustfmt::skip]
const SPECIAL_WORDS: [(PartOfSpeech, &[&str]); 5] = [
    (PartOfSpeech::LocVip, &[
        "left", "right", "clockwise", "counterclockwise", "anticlockwise", "forward", "back", "backward", "up", "down",
        "straight", "curve",
    ]),
    (PartOfSpeech::BodyVip, &[
        "arm", "chin", "foot", "feet", "face", "hand", "mouth", "leg", "waist", "eye", "knee", "shoulder", "thigh",
    ]),
    (PartOfSpeech::ObjVip, &[
        "stair", "dumbbell", "chair", "window", "floor", "car", "ball", "handrail", "baseball", "basketball",
    ]),
    (PartOfSpeech::ActVip, &[
        "walk", "run", "swing", "pick", "bring", "kick", "put", "squat", "throw", "hop", "dance", "jump", "turn",
        "stumble", "stop", "sit", "lift", "lower", "raise", "wash", "stand", "kneel", "stroll", "rub", "bend",
        "balance", "flap", "jog", "shuffle", "lean", "rotate", "spin", "spread", "climb",
    ]),
    (PartOfSpeech::DescVip, &[
        "slowly", "carefully", "fast", "careful", "slow", "quickly", "happy", "angry", "sad", "happily", "angrily",
        "sadly",
    ]),
];
