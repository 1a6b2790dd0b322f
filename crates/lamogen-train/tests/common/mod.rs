//! A packed data set of synthetic motions.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use lamogen_data::{Dataset, LoadOptions};
use lamogen_motion::POSE_FEATURES;
use safetensors::tensor::{Dtype, TensorView};
use serde_json::json;

/// A motion with its captions and labels.
pub struct Clip {
    pub split: &'static str,
    pub content: Option<&'static str>,
    pub style: Option<&'static str>,
    pub captions: Vec<String>,
    pub frames: usize,
    /// The pace in radians per frame and the reach by which the features swing.
    pub swing: (f32, f32),
    /// Whether its mirror image is also an entry.
    pub mirrored: bool,
}

/// Writes clips to a folder in the packed form, and opens the data set.
pub fn pack_clips(folder: &Path, clips: &[Clip]) -> Dataset {
    fs::create_dir_all(folder).unwrap();
    let (mut features, mut offsets) = (Vec::new(), vec![0i32]);
    let mut lines = String::new();
    for (number, clip) in clips.iter().enumerate() {
        let start = *offsets.last().unwrap();
        offsets.push(start + clip.frames as i32);
        let (pace, reach) = clip.swing;
        for place in 0..clip.frames * POSE_FEATURES {
            let (frame, feature) = (place / POSE_FEATURES, place % POSE_FEATURES);
            let phase = feature as f32 * 0.7 + number as f32;
            features.push(reach * (frame as f32 * pace + phase).sin());
        }
        for mirror in [false, true]
            .into_iter()
            .take(1 + usize::from(clip.mirrored))
        {
            let line = json!({
                "name": format!("{}{number}", if mirror { "M" } else { "" }),
                "split": clip.split,
                "content": clip.content,
                "style": clip.style,
                "clip": number,
                "start": start,
                "frames": clip.frames,
                "mirror": mirror,
                "captions": clip.captions,
            });
            lines.push_str(&format!("{line}\n"));
        }
    }
    let bytes: Vec<u8> = features
        .iter()
        .flat_map(|x: &f32| x.to_le_bytes())
        .collect();
    let ends: Vec<u8> = offsets.iter().flat_map(|x| x.to_le_bytes()).collect();
    let shape = vec![features.len() / POSE_FEATURES, POSE_FEATURES];
    let tensors = HashMap::from([
        (
            "features",
            TensorView::new(Dtype::F32, shape, &bytes).unwrap(),
        ),
        (
            "offsets",
            TensorView::new(Dtype::I32, vec![offsets.len()], &ends).unwrap(),
        ),
    ]);
    let path = folder.join("motions.safetensors");
    safetensors::serialize_to_file(tensors, None, &path).unwrap();
    fs::write(folder.join("captions.jsonl"), lines).unwrap();
    let options = LoadOptions {
        min_frames: 4,
        ..LoadOptions::default()
    };
    let dataset = Dataset::open(folder, &options, &mut |_| ()).unwrap();
    assert!(dataset.problems().is_empty(), "{:?}", dataset.problems());
    dataset
}
