//! The bytes of a compact text-to-motion model, embedded in the program: 7.7 million parameters in 8 bits.
//!
//! `LaMoGen::embedded` of the crate `lamogen` loads it. MODEL_CARD.md of this crate says what it was trained on, how good
//! it is and what it cannot do.
//!
//! **The model's licence is CC BY 4.0**: the model may be used in products that name its sources ([`ATTRIBUTION`]). This
//! licence covers this crate alone.

/// The model's `config.json`: sizes of the network and how it is sampled.
pub const CONFIG: &[u8] = include_bytes!("../model/config.json");

/// The weights in 8 bits with a scale for each row, as safetensors, with `license` and `attribution` in the metadata.
pub const WEIGHTS: &[u8] = include_bytes!("../model/model.safetensors");

/// The tokenizer, as JSON of Hugging Face `tokenizers`.
pub const TOKENIZER: &[u8] = include_bytes!("../model/tokenizer.json");

/// The mean of the 263 pose features over the training set, as `.npy`.
pub const MEAN: &[u8] = include_bytes!("../model/mean.npy");

/// The standard deviation of the 263 pose features over the training set, as `.npy`.
pub const STD: &[u8] = include_bytes!("../model/std.npy");

/// The words of the captions that the model was trained on, one a line.
pub const WORDS: &str = include_str!("../model/words.txt");

/// The sources to name when the model is passed on, one a line. The metadata of the weights hold the same lines.
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
