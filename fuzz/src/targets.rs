//! What each fuzz target does with its bytes. `tests/fuzz_corpus.rs` replays the corpus through the same functions.

use std::io::Write;
use std::sync::LazyLock;

use lamogen::character::{Character, CharacterOptions};
use lamogen::files::{ReadOptions, read_bytes};
use lamogen::model::{Checkpoint, ClipTextConfig, ModelConfig, Tokenizer, WordList, words};
use lamogen::{Device, JsonRequest, Preset};

/// A fuzz target: its name, which is that of its folder of the corpus, and the function that reads the bytes.
pub type Target = (&'static str, fn(&[u8]));

/// All targets.
pub const TARGETS: [Target; 10] = [
    ("batch_line", batch_line),
    ("bvh", bvh),
    ("captions", captions),
    ("gltf", gltf),
    ("model_config", model_config),
    ("npy", npy),
    ("prompt", prompt),
    ("pytorch", pytorch),
    ("safetensors", safetensors),
    ("tokenizer_json", tokenizer_json),
];

/// The tokenizer of the embedded model.
const COMPACT_TOKENIZER: &[u8] =
    include_bytes!("../../crates/lamogen-compact/model/tokenizer.json");

/// Reads the bytes as a motion file of a format.
fn read_motion(bytes: &[u8], name: &str) {
    let _ = read_bytes(bytes, name, &ReadOptions::default());
}

/// Reads a BVH file.
pub fn bvh(bytes: &[u8]) {
    read_motion(bytes, "a.bvh");
}

/// Reads a `.glb` or `.gltf` file as a motion, and as a character with its mesh; the bytes show which of the two it is.
pub fn gltf(bytes: &[u8]) {
    read_motion(bytes, "a.glb");
    let character = Character::from_bytes(bytes.to_vec(), "a.glb", &CharacterOptions::default());
    let _ = character.map(|character| character.mesh());
}

/// Reads a NumPy array as a motion.
pub fn npy(bytes: &[u8]) {
    read_motion(bytes, "a.npy");
}

/// Reads a checkpoint and loads a network of the sizes of the checkpoints in the corpus.
fn read_checkpoint(bytes: &[u8], ending: &str) {
    let mut file = tempfile::Builder::new()
        .suffix(ending)
        .tempfile()
        .expect("a temporary file");
    file.write_all(bytes).expect("room for a temporary file");
    if let Ok(checkpoint) = Checkpoint::open(file.path()) {
        let _ = checkpoint.load(&tiny_config(), &Device::flex());
    }
    let _ = Checkpoint::open_parts(file.path(), &["encoder", "text"]);
}

/// Reads a checkpoint that `torch.save` wrote.
pub fn pytorch(bytes: &[u8]) {
    read_checkpoint(bytes, ".tar");
}

/// Reads a checkpoint of safetensors.
pub fn safetensors(bytes: &[u8]) {
    read_checkpoint(bytes, ".safetensors");
}

/// Reads a `config.json`.
pub fn model_config(bytes: &[u8]) {
    if let Ok(config) = ModelConfig::from_json(bytes, "config.json") {
        assert_eq!(config.problem(), None);
    }
}

/// Reads a `tokenizer.json`, and encodes a sentence with it.
pub fn tokenizer_json(bytes: &[u8]) {
    if let Ok(tokenizer) = Tokenizer::from_json(bytes, "tokenizer.json", 512, 32) {
        let _ = tokenizer.encode("a person walks forward, then jumps");
    }
}

/// Encodes a prompt with CLIP's tokenizer and with that of the embedded model.
pub fn prompt(bytes: &[u8]) {
    static TOKENIZERS: LazyLock<[Tokenizer; 2]> = LazyLock::new(|| {
        let embedded = Tokenizer::from_json(COMPACT_TOKENIZER, "tokenizer.json", 12288, 32);
        [Tokenizer::clip(77), embedded.expect("a valid tokenizer")]
    });
    let text = String::from_utf8_lossy(bytes);
    for tokenizer in TOKENIZERS.iter() {
        if let Ok(tokens) = tokenizer.encode(&text) {
            assert_eq!(tokens.ids.len(), tokenizer.context_length());
        }
    }
    let list = WordList::from_lines(&text);
    assert!(list.unknown_words(&text).len() <= words(&text).len());
}

/// Reads a line of a batch.
pub fn batch_line(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(line) = JsonRequest::parse(&text)
        && line.like.is_none()
    {
        let request = line.request(Preset::Precise, &Device::flex());
        request.expect("parse has checked the goals");
    }
}

/// Reads a file of captions in each of its forms.
pub fn captions(bytes: &[u8]) {
    lamogen_data::fuzzing::parse_captions(&String::from_utf8_lossy(bytes));
}

/// The sizes of the network of the checkpoints in the corpus.
pub fn tiny_config() -> ModelConfig {
    ModelConfig {
        input_feats: 3,
        num_frames: 8,
        latent_dim: 4,
        ff_size: 4,
        num_layers: 1,
        num_heads: 1,
        text_latent_dim: 4,
        text_ff_size: 4,
        text_num_heads: 1,
        num_text_layers: 1,
        clip: ClipTextConfig {
            vocab_size: 8,
            context_length: 4,
            width: 4,
            heads: 1,
            layers: 1,
        },
        ..ModelConfig::motion_diffuse()
    }
}
