//! Motions as NumPy's arrays, as HumanML3D stores them.

use std::path::Path;

use lamogen_motion::npy::{self, Array};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Motion, MotionError, POSE_FEATURES};

use crate::error::ReadError;
use crate::import::{Imported, ReadOptions};
use crate::units::{Unit, Up};

/// The motion of an array of joints or pose features. An array tells neither unit nor axes: they are
/// HumanML3D's, metres and Y up at 20 frames a second, unless the options say otherwise.
pub(crate) fn read(path: &Path, options: &ReadOptions) -> Result<Imported, ReadError> {
    let array = npy::read(path)?;
    let (unit, up) = (
        options.unit.unwrap_or(Unit::Metre),
        options.up.unwrap_or(Up::Y),
    );
    let motion = match kind(&array) {
        Some(Kind::Joints) => joints(&array, unit, up),
        Some(Kind::Features) => from_features(&array),
        None => {
            return Err(ReadError::Shape {
                path: path.to_owned(),
                found: array.shape,
            });
        }
    }
    .map_err(|reason| ReadError::Motion {
        path: path.to_owned(),
        reason,
    })?;
    Ok(Imported {
        source_frames: motion.frames(),
        motion,
        turning: None,
        scheme: None,
        unit,
        up,
        source_frames_per_second: f64::from(FRAMES_PER_SECOND),
        announced_frames: None,
        other_animations: Vec::new(),
        placed: Vec::new(),
    })
}

enum Kind {
    Joints,
    Features,
}

/// What an array holds, by its shape; an axis of length 1 may stand first.
fn kind(array: &Array) -> Option<Kind> {
    let of = |shape: &[usize]| match shape {
        [_, JOINTS, 3] => Some(Kind::Joints),
        [_, width] if *width == 3 * JOINTS => Some(Kind::Joints),
        [_, POSE_FEATURES] => Some(Kind::Features),
        _ => None,
    };
    of(&array.shape).or_else(|| match array.shape.as_slice() {
        [1, rest @ ..] => of(rest),
        _ => None,
    })
}

fn joints(array: &Array, unit: Unit, up: Up) -> Result<Motion, MotionError> {
    let pose = |row: &[f32]| {
        std::array::from_fn(|joint| {
            let place = glam::Vec3::from_slice(&row[3 * joint..]).as_dvec3();
            (up.to_y_up(place) * unit.metres()).as_vec3().to_array()
        })
    };
    Motion::from_joints(array.values.chunks_exact(3 * JOINTS).map(pose).collect())
}

fn from_features(array: &Array) -> Result<Motion, MotionError> {
    Motion::from_pose_features(array.values.as_chunks().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Tensor, TensorData};

    fn written(values: &[f32], shape: &[usize]) -> Result<Imported, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        npy::write(&path, values, shape).unwrap();
        read(&path, &ReadOptions::default()).map_err(|error| error.to_string())
    }

    #[test]
    fn joints_are_read_in_every_shape_they_are_stored_in() {
        let values: Vec<f32> = (0..5 * 66).map(|i| i as f32 * 0.01).collect();
        let whole = written(&values, &[5, 22, 3]).unwrap();
        assert_eq!(whole.motion.joints().as_flattened().as_flattened(), values);
        assert_eq!((whole.unit, whole.source_frames), (Unit::Metre, 5));
        for shape in [&[5, 66][..], &[1, 5, 22, 3], &[1, 5, 66]] {
            assert_eq!(written(&values, shape).unwrap(), whole);
        }
        assert_eq!(
            written(&values[..66], &[1, 22, 3]).unwrap().motion.frames(),
            1
        );
    }

    #[test]
    fn features_give_the_joints_that_tensors_give() {
        let values: Vec<f32> = (0..40 * 263)
            .map(|i| (i as f32 * 0.37).sin() * 0.3)
            .collect();
        let data = TensorData::new(values.clone(), [40, 263]);
        let expected = Motion::from_features(Tensor::from_data(data, &Device::flex())).unwrap();
        for shape in [&[40, 263][..], &[1, 40, 263]] {
            let found = written(&values, shape).unwrap().motion;
            assert!(found.distance(&expected) < 1e-5);
        }
    }

    #[test]
    fn other_shapes_and_empty_arrays_are_errors() {
        for shape in [&[66][..], &[3, 21, 3], &[2, 3, 22, 3], &[3, 251], &[22, 3]] {
            let values = vec![0.0; shape.iter().product()];
            let message = written(&values, shape).unwrap_err();
            assert!(
                message.contains("(frames, 22, 3)") && message.contains(&format!("{shape:?}")),
                "{message}"
            );
        }
        assert!(written(&[], &[0, 22, 3]).unwrap_err().contains("none"));
        let message = written(&[f32::NAN; 66], &[1, 22, 3]).unwrap_err();
        assert!(message.contains("pelvis"), "{message}");
    }
}
