//! Motions as NumPy arrays, as HumanML3D stores them.

use std::path::Path;

use lamogen_motion::npy;
use lamogen_motion::{
    FRAMES_PER_SECOND, JOINTS, LoopEnd, Motion, MotionError, POSE_FEATURES, loop_frame_rate,
};

use crate::error::ReadError;
use crate::import::{ImportedMotion, ReadOptions, frame_count};
use crate::plausibility::notices;
use crate::units::{Unit, UpAxis};

/// Reads a motion from an array of joints or pose features.
///
/// An array states neither unit, axes nor frame rate. By default they are those of HumanML3D: metres, Y up, 20 frames per
/// second.
pub(crate) fn read(
    bytes: &[u8],
    path: &Path,
    options: &ReadOptions,
) -> Result<ImportedMotion, ReadError> {
    let array = npy::read_bytes(bytes, path)?;
    if array.is_integer && options.unit.is_none() {
        return Err(ReadError::Integers {
            path: path.to_owned(),
        });
    }
    let (unit, up) = (
        options.unit.unwrap_or(Unit::Metre),
        options.up.unwrap_or(UpAxis::Y),
    );
    let layout = ArrayLayout::from_shape(&array.shape).ok_or_else(|| ReadError::Shape {
        path: path.to_owned(),
        found: array.shape.clone(),
    })?;
    let index = match &options.animation {
        None => 0,
        Some(text) => { text.parse().ok() }
            .filter(|index| *index < layout.motions)
            .ok_or_else(|| ReadError::Index {
                path: path.to_owned(),
                motions: layout.motions,
                found: text.clone(),
            })?,
    };
    let rate = options.frames_per_second.unwrap_or(FRAMES_PER_SECOND);
    let rows = layout.rows(&array.values, index);
    let motion = match layout.content {
        FrameContent::Joints(joints) => motion_from_joints(&rows, joints, unit, up),
        FrameContent::Features => motion_from_features(&rows),
    };
    let motion = motion.and_then(|motion| match rate == FRAMES_PER_SECOND {
        true => Ok(motion),
        false => resampled(&motion, rate),
    });
    let motion = motion.map_err(|reason| ReadError::Motion {
        path: path.to_owned(),
        reason,
    })?;
    let other_animations = match layout.motions {
        1 => Vec::new(),
        motions => vec![format!(
            "of the motions 0 to {} all but {index}",
            motions - 1
        )],
    };
    Ok(ImportedMotion {
        source_frames: layout.frames,
        notices: notices(&motion),
        motion,
        turning: None,
        scheme: None,
        unit,
        up,
        source_frames_per_second: f64::from(rate),
        announced_frames: None,
        other_animations,
        placed: Vec::new(),
    })
}

/// The layout of the motions in an array, derived from its shape.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ArrayLayout {
    motions: usize,
    frames: usize,
    content: FrameContent,
    /// Whether frames are the last axis of a motion, as MDM writes them, and not the first one.
    time_is_last: bool,
}

/// The numbers that an array holds for each frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FrameContent {
    /// The positions of this number of joints. The first 22 are those of HumanML3D.
    Joints(usize),
    /// The pose features of HumanML3D.
    Features,
}

impl FrameContent {
    /// Returns the count of numbers per frame.
    fn width(self) -> usize {
        match self {
            FrameContent::Joints(joints) => 3 * joints,
            FrameContent::Features => POSE_FEATURES,
        }
    }
}

/// The joint counts of bodies that start with the joints of HumanML3D: HumanML3D itself, SMPL with hands, and SMPL-H with
/// fingers.
const JOINT_COUNTS: [usize; 3] = [JOINTS, 24, 52];

impl ArrayLayout {
    /// Returns the layout of an array of one or several motions.
    fn from_shape(shape: &[usize]) -> Option<ArrayLayout> {
        ArrayLayout::from_motion_shape(shape).or_else(|| match shape {
            [motions, rest @ ..] if *motions > 0 && rest.len() > 1 => Some(ArrayLayout {
                motions: *motions,
                ..ArrayLayout::from_motion_shape(rest)?
            }),
            _ => None,
        })
    }

    /// Returns the layout of an array of one motion.
    fn from_motion_shape(shape: &[usize]) -> Option<ArrayLayout> {
        let is_body = |count: &usize| JOINT_COUNTS.contains(count);
        let layout = |frames, content, time_is_last| ArrayLayout {
            motions: 1,
            frames,
            content,
            time_is_last,
        };
        match shape {
            [frames, count, 3] if is_body(count) => {
                Some(layout(*frames, FrameContent::Joints(*count), false))
            }
            [count, 3, frames] if is_body(count) => {
                Some(layout(*frames, FrameContent::Joints(*count), true))
            }
            [frames, POSE_FEATURES] => Some(layout(*frames, FrameContent::Features, false)),
            [frames, width] if width.is_multiple_of(3) && is_body(&(width / 3)) => {
                Some(layout(*frames, FrameContent::Joints(width / 3), false))
            }
            _ => None,
        }
    }

    /// Returns the numbers of one motion, frame by frame.
    fn rows(&self, values: &[f32], index: usize) -> Vec<f32> {
        let (width, frames) = (self.content.width(), self.frames);
        let motion = &values[index * frames * width..][..frames * width];
        match self.time_is_last {
            false => motion.to_vec(),
            true => (0..frames)
                .flat_map(|frame| (0..width).map(move |place| motion[place * frames + frame]))
                .collect(),
        }
    }
}

/// Creates a motion from the joint positions of its frames.
fn motion_from_joints(
    rows: &[f32],
    joints: usize,
    unit: Unit,
    up: UpAxis,
) -> Result<Motion, MotionError> {
    let pose = |row: &[f32]| {
        std::array::from_fn(|joint| {
            let place = glam::Vec3::from_slice(&row[3 * joint..]).as_dvec3();
            (up.to_y_up(place) * unit.metres()).as_vec3().to_array()
        })
    };
    Motion::from_joints(rows.chunks_exact(3 * joints).map(pose).collect())
}

/// Resamples a motion from another frame rate to [`FRAMES_PER_SECOND`]. Joint positions are interpolated linearly.
fn resampled(motion: &Motion, rate: f32) -> Result<Motion, MotionError> {
    let poses = motion.joints();
    let seconds = (poses.len() - 1) as f64 / f64::from(rate);
    let frames = frame_count(seconds);
    let place = |frame: usize| frame as f64 / f64::from(FRAMES_PER_SECOND) * f64::from(rate);
    Motion::from_joints(
        (0..frames)
            .map(|frame| pose_at(poses, place(frame)))
            .collect(),
    )
}

/// Interpolates poses linearly at a place among the frames.
fn pose_at(poses: &[[[f32; 3]; JOINTS]], place: f64) -> [[f32; 3]; JOINTS] {
    let first = (place as usize).min(poses.len() - 1);
    let next = (first + 1).min(poses.len() - 1);
    let part = (place - first as f64) as f32;
    std::array::from_fn(|joint| {
        let [from, to] = [first, next].map(|frame| glam::Vec3::from(poses[frame][joint]));
        from.lerp(to, part).to_array()
    })
}

/// Returns the bytes of an array of joint positions at a frame rate. Those of a rigid body follow from its rotations, which are interpolated along the
/// shortest arc; others are interpolated linearly.
pub(crate) fn joints_bytes(motion: &Motion, rate: f32) -> Vec<u8> {
    let joints = match motion.is_rigid() {
        true => { motion.keyframes(rate, LoopEnd::Open) }.rotations.joints(),
        false => {
            // A second cycle of a loop has the frame that follows the last one of the first cycle.
            let cycles = motion.repeated(2);
            let poses = cycles.as_ref().unwrap_or(motion).placed_joints();
            let (rate, last) = match cycles {
                Some(_) => (loop_frame_rate(motion.frames(), rate), motion.frames()),
                None => (rate, motion.frames() - 1),
            };
            let step = f64::from(FRAMES_PER_SECOND) / f64::from(rate);
            let frames = (last as f64 / step).round() as usize + usize::from(cycles.is_none());
            (0..frames)
                .map(|frame| pose_at(&poses, frame as f64 * step))
                .collect()
        }
    };
    let values = joints.as_flattened().as_flattened();
    npy::bytes(values, &[joints.len(), JOINTS, 3])
}

/// Creates a motion from the pose features of its frames.
fn motion_from_features(rows: &[f32]) -> Result<Motion, MotionError> {
    Motion::from_pose_features(rows.as_chunks().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Tensor, TensorData};

    fn write_and_read(values: &[f32], shape: &[usize]) -> Result<ImportedMotion, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        npy::write(&path, values, shape).unwrap();
        crate::read(&path, &ReadOptions::default()).map_err(|error| error.to_string())
    }

    #[test]
    fn joints_are_read_in_every_known_shape() {
        let values: Vec<f32> = (0..5 * 66).map(|i| i as f32 * 0.01).collect();
        let whole = write_and_read(&values, &[5, 22, 3]).unwrap();
        assert_eq!(whole.motion.joints().as_flattened().as_flattened(), values);
        assert_eq!((whole.unit, whole.source_frames), (Unit::Metre, 5));
        for shape in [&[5, 66][..], &[1, 5, 22, 3], &[1, 5, 66]] {
            assert_eq!(write_and_read(&values, shape).unwrap(), whole);
        }
        assert_eq!(
            write_and_read(&values[..66], &[1, 22, 3])
                .unwrap()
                .motion
                .frames(),
            1
        );
    }

    #[test]
    fn other_programs_arrays_are_read() {
        // The coordinate of axis a of joint j at frame t of motion m, for two motions of five frames.
        let number = |m: usize, t: usize, j: usize, a: usize| {
            (1000 * m + 100 * t) as f32 * 0.01 + (3 * j + a) as f32 * 0.001
        };
        let motion = |m: usize, joints: usize| -> Vec<f32> {
            let places = (0..5).flat_map(|t| (0..joints).map(move |j| (t, j)));
            places
                .flat_map(|(t, j)| (0..3).map(move |a| number(m, t, j, a)))
                .collect()
        };
        let last = |m: usize, joints: usize| -> Vec<f32> {
            let places = (0..joints).flat_map(|j| (0..3).map(move |a| (j, a)));
            places
                .flat_map(|(j, a)| (0..5).map(move |t| number(m, t, j, a)))
                .collect()
        };
        let expected = write_and_read(&motion(0, 22), &[5, 22, 3]).unwrap().motion;
        for (values, shape) in [
            (motion(0, 24), &[5, 24, 3][..]),
            (motion(0, 52), &[5, 52, 3]),
            (motion(0, 52), &[5, 156]),
            (last(0, 22), &[22, 3, 5]),
            (last(0, 24), &[1, 24, 3, 5]),
        ] {
            let found = write_and_read(&values, shape).unwrap();
            assert_eq!(found.motion, expected, "{shape:?}");
            assert!(found.other_animations.is_empty());
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        for (values, shape) in [
            ([motion(0, 22), motion(1, 22)].concat(), [2, 5, 22, 3]),
            ([last(0, 22), last(1, 22)].concat(), [2, 22, 3, 5]),
        ] {
            npy::write(&path, &values, &shape).unwrap();
            let of = |animation: Option<&str>| {
                let options = ReadOptions {
                    animation: animation.map(str::to_owned),
                    ..ReadOptions::default()
                };
                crate::read(&path, &options)
            };
            let first = of(None).unwrap();
            assert_eq!(first.motion, expected);
            assert_eq!(first.other_animations, ["of the motions 0 to 1 all but 0"]);
            let second = write_and_read(&motion(1, 22), &[5, 22, 3]).unwrap().motion;
            assert_eq!(of(Some("1")).unwrap().motion, second);
            for wrong in ["2", "-1", "walk"] {
                let message = of(Some(wrong)).unwrap_err().to_string();
                assert!(
                    message.contains("from 0 to 1") && message.contains(wrong),
                    "{message}"
                );
            }
        }
    }

    #[test]
    fn whole_numbers_need_their_unit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let header = "{'descr': '<i4', 'fortran_order': False, 'shape': (1, 22, 3), }\n";
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend((header.len() as u16).to_le_bytes());
        file.extend(header.as_bytes());
        file.extend((0..66i32).flat_map(|number| (1000 * number).to_le_bytes()));
        std::fs::write(&path, file).unwrap();
        let message = crate::read(&path, &ReadOptions::default())
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("whole numbers") && message.contains("unit"),
            "{message}"
        );
        let options = ReadOptions {
            unit: Some(Unit::Millimetre),
            ..ReadOptions::default()
        };
        let motion = crate::read(&path, &options).unwrap().motion;
        assert_eq!(motion.joints()[0][21], [63.0, 64.0, 65.0]);
    }

    #[test]
    fn features_give_the_same_joints_as_tensors() {
        let values: Vec<f32> = (0..40 * 263)
            .map(|i| (i as f32 * 0.37).sin() * 0.3)
            .collect();
        let data = TensorData::new(values.clone(), [40, 263]);
        let expected = Motion::from_features(Tensor::from_data(data, &Device::flex())).unwrap();
        for shape in [&[40, 263][..], &[1, 40, 263]] {
            let found = write_and_read(&values, shape).unwrap().motion;
            assert!(found.distance(&expected) < 1e-5);
        }
    }

    #[test]
    fn other_shapes_and_empty_arrays_are_errors() {
        for shape in [
            &[66][..],
            &[3, 21, 3],
            &[2, 2, 3, 22, 3],
            &[3, 251],
            &[22, 3],
        ] {
            let values = vec![0.0; shape.iter().product()];
            let message = write_and_read(&values, shape).unwrap_err();
            assert!(
                message.contains("(frames, 22, 3)") && message.contains(&format!("{shape:?}")),
                "{message}"
            );
        }
        assert!(
            write_and_read(&[], &[0, 22, 3])
                .unwrap_err()
                .contains("none")
        );
        let message = write_and_read(&[f32::NAN; 66], &[1, 22, 3]).unwrap_err();
        assert!(message.contains("pelvis"), "{message}");
    }
}
