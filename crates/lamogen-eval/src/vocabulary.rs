//! Words as the public evaluator reads them: GloVe vectors and parts of speech.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::npy::{self, NpyError};
use pytorch_reader::{PickleValue, PytorchReader};

use crate::TextBatch;

/// Words and their vectors, from the folder `glove` of the public code (`EricGuo5513/text-to-motion`).
#[derive(Clone, Debug)]
pub struct Vocabulary {
    /// `[words, width]`, row by row.
    vectors: Vec<f32>,
    width: usize,
    /// The row of each word.
    rows: HashMap<String, usize>,
    unknown: usize,
}

/// A caption as rows of the vocabulary, with start and end, cut and padded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sentence {
    words: [(usize, PartOfSpeech); PADDED],
    length: usize,
}

/// What can go wrong with a vocabulary or a caption's tokens.
#[derive(Debug, thiserror::Error)]
pub enum VocabularyError {
    /// The vectors cannot be read.
    #[error(transparent)]
    Vectors(#[from] NpyError),
    /// A pickle cannot be read, or holds something else.
    #[error("{path}: expected {expected}, found {found}")]
    #[allow(missing_docs)]
    Content {
        path: PathBuf,
        expected: String,
        found: String,
    },
    /// A token without its part of speech.
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

/// Words of a caption that are read; what is longer is cut.
const LONGEST: usize = 20;

/// Words of a padded caption, with its start and its end.
const PADDED: usize = LONGEST + 2;

const START: &str = "sos";
const END: &str = "eos";
const UNKNOWN: &str = "unk";

impl Vocabulary {
    /// Reads `our_vab_data.npy` (`[words, width]`), `our_vab_words.pkl` (a list of words) and `our_vab_idx.pkl` (each
    /// word's row) from a folder.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, holds something else, a word has no row, or the word `unk` is missing.
    pub fn from_folder(folder: impl AsRef<Path>) -> Result<Self, VocabularyError> {
        let folder = folder.as_ref();
        let vectors_path = folder.join("our_vab_data.npy");
        let array = npy::read(&vectors_path)?;
        let &[count, width] = array.shape.as_slice() else {
            let found = format!("the shape {:?}", array.shape);
            return Err(content(&vectors_path, "one vector a word", found));
        };
        let index_path = folder.join("our_vab_idx.pkl");
        let index = match pickle(&index_path)? {
            PickleValue::Dict(index) => index,
            other => return Err(content(&index_path, "a dictionary", kind(&other))),
        };
        let words_path = folder.join("our_vab_words.pkl");
        let words = match pickle(&words_path)? {
            PickleValue::List(words) => words,
            other => return Err(content(&words_path, "a list of words", kind(&other))),
        };
        let mut rows = HashMap::with_capacity(words.len());
        for word in words {
            let PickleValue::String(word) = word else {
                return Err(content(&words_path, "a list of words", kind(&word)));
            };
            let row = match index.get(&word) {
                Some(PickleValue::Int(row)) => {
                    usize::try_from(*row).ok().filter(|&row| row < count)
                }
                _ => None,
            };
            let Some(row) = row else {
                let expected = format!("for the word `{word}` a row below {count}");
                let found = index.get(&word).map_or("no entry".into(), kind);
                return Err(content(&index_path, expected, found));
            };
            rows.insert(word, row);
        }
        let Some(&unknown) = rows.get(UNKNOWN) else {
            let expected = format!("the word `{UNKNOWN}`, which stands for all others");
            return Err(content(
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

    /// Width of a word's vector.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Whether a word has a vector of its own.
    pub fn contains(&self, word: &str) -> bool {
        self.rows.contains_key(word)
    }

    /// Reads the tokens of a caption as HumanML3D's texts have them after the first `#`: `a/DET man/NOUN walk/VERB`.
    ///
    /// Words of the lists that the public code watches ([`PartOfSpeech::LocVip`] and the like) have that part of
    /// speech whatever is written; words without a vector are read as `unk`, of part `OTHER`. A start and an end are
    /// added; captions above 20 words are cut.
    ///
    /// # Errors
    ///
    /// If a token is not a word, a slash and a part of speech.
    pub fn sentence(&self, tokens: &str) -> Result<Sentence, VocabularyError> {
        let mut words = [self.look_up(UNKNOWN, "OTHER"); PADDED];
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
            if number < LONGEST {
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

    /// Sentences as a network for words takes them.
    ///
    /// # Panics
    ///
    /// If a sentence was read with a larger vocabulary.
    pub fn batch(&self, sentences: &[Sentence], device: &Device) -> TextBatch {
        let parts = PartOfSpeech::ALL.len();
        let mut vectors = Vec::with_capacity(sentences.len() * PADDED * self.width);
        let mut parts_of_speech = vec![0f32; sentences.len() * PADDED * parts];
        let words = sentences.iter().flat_map(|sentence| sentence.words);
        for (one_hot, (row, part)) in parts_of_speech.chunks_exact_mut(parts).zip(words) {
            vectors.extend_from_slice(&self.vectors[row * self.width..][..self.width]);
            one_hot[part as usize] = 1.0;
        }
        let tensor = |values, width| {
            let shape = [sentences.len(), PADDED, width];
            Tensor::from_data(TensorData::new(values, shape), device)
        };
        TextBatch::Words {
            vectors: tensor(vectors, self.width),
            parts_of_speech: tensor(parts_of_speech, parts),
            lengths: sentences.iter().map(|sentence| sentence.length).collect(),
        }
    }
}

fn pickle(path: &Path) -> Result<PickleValue, VocabularyError> {
    PytorchReader::read_pickle_data(path, None)
        .map_err(|error| content(path, "a Python pickle", error.to_string()))
}

fn content(path: &Path, expected: impl Into<String>, found: impl Into<String>) -> VocabularyError {
    VocabularyError::Content {
        path: path.to_owned(),
        expected: expected.into(),
        found: found.into(),
    }
}

fn kind(value: &PickleValue) -> String {
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
        /// Parts of speech that the public evaluator tells apart, in its order. The last but one are words it watches:
        /// they count as such whatever a tagger says.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum PartOfSpeech {
            $($(#[$doc])* $name),*
        }

        impl PartOfSpeech {
            /// All of them.
            pub const ALL: [PartOfSpeech; 15] = [$(PartOfSpeech::$name),*];

            /// As captions write it.
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
    /// A watched word of place or direction.
    LocVip = "Loc_VIP",
    /// A watched part of the body.
    BodyVip = "Body_VIP",
    /// A watched object.
    ObjVip = "Obj_VIP",
    /// A watched action.
    ActVip = "Act_VIP",
    /// A watched word of manner.
    DescVip = "Desc_VIP",
    /// Anything else.
    Other = "OTHER",
}

impl PartOfSpeech {
    /// The part of a word that has a vector: as watched, else as tagged.
    fn of(word: &str, tag: &str) -> PartOfSpeech {
        let watched = WATCHED.iter().find(|(_, words)| words.contains(&word));
        let tagged = || {
            let mut all = PartOfSpeech::ALL.into_iter();
            all.find(|part| part.tag() == tag)
        };
        watched
            .map(|(part, _)| *part)
            .or_else(tagged)
            .unwrap_or(PartOfSpeech::Other)
    }
}

/// The words that the public code watches.
#[rustfmt::skip]
const WATCHED: [(PartOfSpeech, &[&str]); 5] = [
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
