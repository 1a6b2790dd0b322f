//! A small data set to train on, and small recipes.

use std::fs;
use std::path::Path;

use lamogen::motion::{POSE_FEATURES, npy};

/// HumanML3D's folder with a few motions that swing.
pub fn data(folder: &Path) {
    fs::create_dir_all(folder.join("data/new_joint_vecs")).unwrap();
    fs::create_dir_all(folder.join("data/texts")).unwrap();
    let (mut train, mut val) = (String::new(), String::new());
    for place in 0..10usize {
        let (frames, name) = (44 + place, format!("{place:06}"));
        let rows: Vec<f32> = (0..frames * POSE_FEATURES)
            .map(|i| {
                let (frame, feature) = (i / POSE_FEATURES, i % POSE_FEATURES);
                0.1 * (0.3 * frame as f32 + feature as f32 + place as f32).sin()
            })
            .collect();
        let vectors = folder.join(format!("data/new_joint_vecs/{name}.npy"));
        npy::write(vectors, &rows, &[frames, POSE_FEATURES]).unwrap();
        let text = "a person swings to and fro#a/DET person/NOUN#0.0#0.0\n";
        fs::write(folder.join(format!("data/texts/{name}.txt")), text).unwrap();
        let split = if place < 8 { &mut train } else { &mut val };
        split.push_str(&format!("{name}\n"));
    }
    fs::write(folder.join("data/train.txt"), train).unwrap();
    fs::write(folder.join("data/val.txt"), val).unwrap();
    let config = serde_json::json!({
        "model": {
            "input_feats": 263, "num_frames": 60, "latent_dim": 16, "ff_size": 24, "num_layers": 1, "num_heads": 2,
            "text_latent_dim": 16, "text_ff_size": 16, "text_num_heads": 2, "num_text_layers": 1,
            "clip": { "vocab_size": 300, "context_length": 10, "width": 16, "heads": 2, "layers": 1 },
            "prediction": "sample",
        },
        "denoising": { "frames_per_batch": 200 },
    });
    fs::write(folder.join("tiny.json"), config.to_string()).unwrap();
}

/// A recipe for an evaluator in `judge.json`; the captions of the data become ones that differ, so that pairs can be told apart.
pub fn evaluator(folder: &Path) {
    let config = serde_json::json!({
        "evaluator": {
            "dim_pose": 263, "max_motion_length": 60, "dim_movement_enc_hidden": 8, "dim_movement_latent": 8,
            "dim_motion_hidden": 8, "dim_text_hidden": 8, "dim_coemb_hidden": 8,
            "text": { "tokens": { "vocab_size": 300, "context_length": 10, "dim_word": 8 } },
        },
        "matching": { "pairs_per_batch": 2 },
    });
    fs::write(folder.join("judge.json"), config.to_string()).unwrap();
    for place in 0..10 {
        let text = format!("swing number {place} goes#swing/NOUN#0.0#0.0\n");
        fs::write(folder.join(format!("data/texts/{place:06}.txt")), text).unwrap();
    }
}
