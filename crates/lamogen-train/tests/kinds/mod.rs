//! A small data set of motions of three kinds, which their captions name.

use std::fs;
use std::path::Path;

use lamogen_data::{Dataset, LoadOptions};
use lamogen_motion::{FeatureGroup, POSE_FEATURES, npy};

/// The kinds of motions: a name, and the pace of the swing in radians per frame.
const KINDS: [(&str, f32); 3] = [("slow", 0.1), ("quick", 0.4), ("very quick", 0.9)];

/// Writes motions of three kinds in HumanML3D's form, for training and for validation, and opens the data set.
pub fn dataset(folder: &Path) -> Dataset {
    let _ = fs::create_dir_all(folder.join("new_joint_vecs"));
    let _ = fs::create_dir_all(folder.join("texts"));
    let (mut train, mut val) = (String::new(), String::new());
    for place in 0..15 {
        let (kind, pace) = KINDS[place % 3];
        let frames = 40 + 3 * place;
        let name = format!("{place:06}");
        let rows: Vec<f32> = (0..frames * POSE_FEATURES)
            .map(|i| {
                let (frame, feature) = (i / POSE_FEATURES, i % POSE_FEATURES);
                let phase = feature as f32 * 0.7 + place as f32;
                match FeatureGroup::FootContact.range().contains(&feature) {
                    true => f32::from(u8::from((frame / 5 + feature) % 2 == 0)),
                    false => 0.1 * (frame as f32 * pace + phase).sin(),
                }
            })
            .collect();
        let path = folder.join(format!("new_joint_vecs/{name}.npy"));
        npy::write(path, &rows, &[frames, POSE_FEATURES]).unwrap();
        let text = format!("a {kind} one#a/DET one/NOUN#0.0#0.0\nit is {kind}##0.0#0.0\n");
        fs::write(folder.join(format!("texts/{name}.txt")), text).unwrap();
        let split = if place < 12 { &mut train } else { &mut val };
        split.push_str(&name);
        split.push('\n');
    }
    fs::write(folder.join("train.txt"), train).unwrap();
    fs::write(folder.join("val.txt"), val).unwrap();
    Dataset::open(folder, &LoadOptions::default(), &mut |_| ()).unwrap()
}
