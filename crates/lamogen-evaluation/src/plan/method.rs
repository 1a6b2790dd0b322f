//! The methods that are compared.

/// A method that makes motions follow Laban tags.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Method {
    /// The sentence alone.
    Text,
    /// Laban guidance as the model is used, by its preset.
    Laban,
    /// Laban guidance that moves the sentence embedding: the paper's method, with the preset fast.
    Embedding,
    /// Phrases in the prompt.
    Prompt,
    /// Raw frame update: the finished motion is moved.
    Raw,
    /// Classifier guidance: the predicted motion is moved.
    Classifier,
    /// The start noise is moved.
    Noise,
}

impl Method {
    /// All methods but the sentence alone, with which they are compared.
    pub const RIVALS: [Method; 6] = [
        Method::Laban,
        Method::Embedding,
        Method::Prompt,
        Method::Raw,
        Method::Classifier,
        Method::Noise,
    ];

    /// Returns the name of the method, as records have it.
    pub fn name(self) -> &'static str {
        match self {
            Method::Text => "text",
            Method::Laban => "laban",
            Method::Embedding => "embedding",
            Method::Prompt => "prompt",
            Method::Raw => "raw",
            Method::Classifier => "classifier",
            Method::Noise => "noise",
        }
    }

    /// Returns the name of the method in the paper's tables.
    pub fn title(self) -> &'static str {
        match self {
            Method::Text => "Text alone",
            Method::Laban => "Laban guidance",
            Method::Embedding => "Laban guidance, embedding",
            Method::Prompt => "Prompt editing",
            Method::Raw => "Raw frame update",
            Method::Classifier => "Classifier guidance",
            Method::Noise => "Start noise",
        }
    }
}
