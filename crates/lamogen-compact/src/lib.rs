//! A compact text-to-motion model as bytes in the program: 4.4 million parameters in 16 bits.
//!
//! `LaMoGen::embedded` of the crate `lamogen` loads it. MODEL_CARD.md beside this file says what it
//! was trained on, how good it is and what it cannot do.
//!
//! **The model's licence is CC BY 4.0**: it may be used in products that name the sources ([`ATTRIBUTION`]). It covers this crate alone.

/// Sizes of the network, JSON.
pub const CONFIG: &[u8] = include_bytes!("../model/config.json");

/// Weights in 16 bits, safetensors, with `license` and `attribution` in the metadata.
pub const WEIGHTS: &[u8] = include_bytes!("../model/model.safetensors");

/// Tokenizer in the JSON of Hugging Face `tokenizers`.
pub const TOKENIZER: &[u8] = include_bytes!("../model/tokenizer.json");

/// Mean of the 263 pose features over the training set, `.npy`.
pub const MEAN: &[u8] = include_bytes!("../model/mean.npy");

/// Standard deviation of the 263 pose features over the training set, `.npy`.
pub const STD: &[u8] = include_bytes!("../model/std.npy");

/// The words of the captions that it was trained on, one a line.
pub const WORDS: &str = include_str!("../model/words.txt");

/// Whom to name when the model is passed on, one a line; also in the metadata of the weights.
pub const ATTRIBUTION: &str = include_str!("../ATTRIBUTION");

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod tests {
    #[test]
    fn the_crate_stays_small_enough_to_embed() {
        assert!(super::WEIGHTS.len() <= 9_500_000);
    }
}
