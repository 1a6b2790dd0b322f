//! Compares pose features with those of a NumPy implementation of HumanML3D's representation. The body walks a
//! curve, turns right around and swings all its limbs.

use burn::tensor::{Device, Tensor, TensorData};
use lamogen_motion::{
    JOINTS, Motion, POSE_FEATURES, canonical, encode, encode_canonical, joints, npy,
};

type Pose = [[f32; 3]; JOINTS];

fn golden(name: &str) -> npy::Array {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden");
    npy::read(format!("{folder}/{name}.npy")).unwrap()
}

fn poses(name: &str) -> Vec<Pose> {
    let array = golden(name);
    let (points, _) = array.values.as_chunks::<3>();
    points.as_chunks::<JOINTS>().0.to_vec()
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max)
}

#[test]
fn features_are_those_of_the_reference() {
    let features = encode(&poses("canonical"));
    let expected = golden("features");
    assert_eq!([features.len(), POSE_FEATURES], expected.shape[..]);
    let off = largest_difference(features.as_flattened(), &expected.values);
    assert!(off < 1e-5, "{off}");

    // The input may be anywhere in the world. The golden canonical positions were rounded to 32 bits in between.
    let features = encode_canonical(&poses("joints"));
    let off = largest_difference(features.as_flattened(), &expected.values);
    assert!(off < 5e-5, "{off}");
}

#[test]
fn a_motion_is_put_where_the_reference_puts_it() {
    let placed = canonical(&poses("joints"));
    let expected = golden("canonical");
    let off = largest_difference(placed.as_flattened().as_flattened(), &expected.values);
    assert!(off < 1e-5, "{off}");
}

#[test]
fn positions_come_back_from_features_past_straight_backwards() {
    let poses = poses("canonical");
    let features = encode(&poses);
    let motion = Motion::from_pose_features(features.clone()).unwrap();
    let expected = &poses[..poses.len() - 1];
    let found = motion.joints().as_flattened().as_flattened();
    let off = largest_difference(found, expected.as_flattened().as_flattened());
    assert!(off < 1e-4, "{off} m");

    // The function of tensors gives the same.
    let shape = [1, features.len(), POSE_FEATURES];
    let data = TensorData::new(features.as_flattened().to_vec(), shape);
    let tensor = joints(Tensor::from_data(data, &Device::flex()));
    let off = largest_difference(found, &tensor.into_data().try_to_vec::<f32>().unwrap());
    assert!(off < 1e-5, "{off} m");
}

#[test]
fn few_frames_are_no_trouble() {
    assert!(canonical(&[]).is_empty());
    assert!(encode(&[]).is_empty() && encode(&poses("joints")[..1]).is_empty());
    assert_eq!(encode(&poses("joints")[..2]).len(), 1);
    let together = encode(&[[[0.0; 3]; JOINTS]; 3]);
    assert!(
        together
            .as_flattened()
            .iter()
            .all(|value| value.is_finite())
    );
}
