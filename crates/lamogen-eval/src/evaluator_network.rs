//! The text-motion matching network and its files.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use lamogen_model::{Checkpoint, NamedParameters, ParameterList, Precision};
use lamogen_motion::{frame_mask, write_atomically};

use crate::network::{Dropout, MotionEncoder, MovementEncoder, TextEncoder};
use crate::{EvaluatorConfig, EvaluatorNetworkError, TextBatch};

/// The text-motion matching network of Guo et al. 2022 (CVPR; public code `EricGuo5513/text-to-motion`). It maps texts
/// and motions to points of one space, in which a text and its motion lie near each other.
///
/// It is a burn module. To train it, load it on an autodiff device or call [`Module::train`] first.
#[derive(Module, Debug)]
pub struct EvaluatorNetwork {
    movement: MovementEncoder,
    motion: MotionEncoder,
    text: TextEncoder,
    #[module(skip)]
    config: EvaluatorConfig,
}

/// The keys of the three encoders in `finest.tar`.
pub(crate) const PARTS: [&str; 3] = ["movement_encoder", "motion_encoder", "text_encoder"];

const CONFIG: &str = "config.json";
const WEIGHTS: &str = "model.safetensors";

impl EvaluatorNetwork {
    /// Returns a network with random weights from the device's generator, in the distributions of the public code.
    ///
    /// # Panics
    ///
    /// If the sizes are not valid (see [`EvaluatorConfig::problem`]).
    pub fn new(config: &EvaluatorConfig, device: &Device) -> Self {
        if let Some(problem) = config.problem() {
            panic!("{problem}");
        }
        EvaluatorNetwork {
            movement: MovementEncoder::new(config, device),
            motion: MotionEncoder::new(config, device),
            text: TextEncoder::new(config, device),
            config: config.clone(),
        }
    }

    /// Reads the weights of a network of the given sizes. The file is the public `finest.tar`, or safetensors with the
    /// same keys behind the prefixes `movement_encoder.`, `motion_encoder.` and `text_encoder.`.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, lacks one of the three encoders, or its tensors do not fit the sizes.
    ///
    /// # Panics
    ///
    /// If the sizes are not valid (see [`EvaluatorConfig::problem`]).
    pub fn load(
        weights: impl AsRef<Path>,
        config: &EvaluatorConfig,
        device: &Device,
    ) -> Result<Self, EvaluatorNetworkError> {
        let checkpoint = Checkpoint::open_parts(weights, &PARTS)?;
        let mut evaluator = Self::new(config, device);
        checkpoint.fill(&mut evaluator, device)?;
        Ok(evaluator)
    }

    /// Reads `config.json` and `model.safetensors` from a folder that [`save`](Self::save) wrote.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, or the files do not fit each other.
    pub fn from_folder(
        folder: impl AsRef<Path>,
        device: &Device,
    ) -> Result<Self, EvaluatorNetworkError> {
        let folder = folder.as_ref();
        let config = EvaluatorConfig::from_file(folder.join(CONFIG))?;
        Self::load(folder.join(WEIGHTS), &config, device)
    }

    /// Writes `config.json` and `model.safetensors` into an existing folder. `metadata` is free text that is stored with
    /// the weights, such as `license`. Each file appears complete or not at all.
    ///
    /// # Errors
    ///
    /// If a file cannot be written, or `precision` is 16 bits and a weight is beyond their range.
    pub fn save(
        &self,
        folder: impl AsRef<Path>,
        precision: Precision,
        metadata: HashMap<String, String>,
    ) -> Result<(), EvaluatorNetworkError> {
        let folder = folder.as_ref();
        Checkpoint::write(self, folder.join(WEIGHTS), precision, metadata)?;
        let path = folder.join(CONFIG);
        let json = serde_json::to_vec_pretty(&self.config).expect("sizes are JSON");
        write_atomically(&path, |file| {
            file.write_all(&json)?;
            file.write_all(b"\n")
        })
        .map_err(|reason| EvaluatorNetworkError::Io { path, reason })
    }

    /// Returns the sizes of the network.
    pub fn config(&self) -> &EvaluatorConfig {
        &self.config
    }

    /// Embeds texts: returns `[batch, dim_coemb_hidden]`.
    ///
    /// # Panics
    ///
    /// If the texts are not in the form that the network reads ([`EvaluatorConfig::text`]), have another width or
    /// ids beyond the vocabulary, or a length is 0 or above the padded one.
    pub fn embed_text(&self, texts: &TextBatch) -> Tensor<2> {
        self.text.forward(texts)
    }

    /// Embeds motions: returns `[batch, dim_coemb_hidden]`. The other motions of a batch do not change a motion's
    /// embedding.
    ///
    /// Of each motion, the largest multiple of 4 frames is read; later frames are ignored. `dropout` is for training and
    /// acts in the encoder of movements.
    ///
    /// # Shapes
    ///
    /// - `features`: `[batch, frames, dim_pose - 4]`: pose features without foot contacts, normalised by the evaluator's
    ///   own mean and standard deviation, which may differ from the denoiser's
    /// - `lengths`: the number of frames of each motion
    ///
    /// # Panics
    ///
    /// If the features have another width, there are more frames than `max_motion_length`, there are not as many
    /// lengths as motions, or a length is below 4 or above the number of frames.
    pub fn embed_motion(
        &self,
        features: Tensor<3>,
        lengths: &[usize],
        dropout: Option<Dropout<'_>>,
    ) -> Tensor<2> {
        let unit = EvaluatorConfig::FRAMES_PER_MOVEMENT;
        let [batch, frames, width] = features.dims();
        let longest = self.config.max_motion_length.min(frames);
        assert_eq!(
            width,
            self.config.movement_features(),
            "pose features without foot contacts"
        );
        assert!(
            frames <= self.config.max_motion_length,
            "expected at most {} frames, found {frames}",
            self.config.max_motion_length
        );
        assert!(
            lengths.len() == batch && lengths.iter().all(|l| (unit..=longest).contains(l)),
            "expected {batch} lengths from {unit} to {longest}, found {lengths:?}"
        );
        let movements: Vec<usize> = lengths.iter().map(|length| length / unit).collect();
        let read_frames: Vec<usize> = movements.iter().map(|count| count * unit).collect();
        let features = self.zero_padded(features, &read_frames);
        let encoded = self.movement.forward(features, dropout);
        self.motion.forward(encoded, &movements)
    }

    /// Returns motions of the given lengths, padded with zeros.
    ///
    /// The public code pads every motion to `max_motion_length`. A motion's last movement reads at most four frames of
    /// the padding, so four frames are enough; a motion of the greatest length gets none.
    fn zero_padded(&self, features: Tensor<3>, lengths: &[usize]) -> Tensor<3> {
        let [batch, frames, width] = features.dims();
        let longest = lengths.iter().copied().max().unwrap_or_default();
        let needed =
            (longest + EvaluatorConfig::FRAMES_PER_MOVEMENT).min(self.config.max_motion_length);
        let features = match needed.checked_sub(frames) {
            Some(missing @ 1..) => {
                let zeros = Tensor::zeros([batch, missing, width], &features.device());
                Tensor::cat(vec![features, zeros], 1)
            }
            _ => features.narrow(1, 0, needed),
        };
        match frame_mask(lengths, needed, &features.device()) {
            // A product with the mask would not do: padding may hold NaN, and 0 times NaN is NaN.
            Some(mask) => features.mask_fill(mask.equal_elem(0.0).repeat_dim(2, width), 0.0),
            None => features,
        }
    }
}

impl NamedParameters for EvaluatorNetwork {
    fn keys(&mut self, keys: &mut ParameterList) {
        keys.nested(PARTS[0], &mut self.movement);
        keys.nested(PARTS[1], &mut self.motion);
        keys.nested(PARTS[2], &mut self.text);
    }
}
