//! A file's format by the end of its name.

use std::io::Write;
use std::path::Path;

use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion, placeholder_at};

use crate::bvh::{self, BvhOptions};
use crate::error::{ReadError, WriteError};
use crate::glb::{self, GlbOptions};
use crate::import::{ImportedMotion, ReadOptions, import};
use crate::npy;
use crate::units::{Unit, Up};

/// Reads a motion of any known skeleton, at any frame rate.
///
/// | name ends in | read as |
/// |---|---|
/// | `.bvh` | BVH |
/// | `.glb`, `.gltf` | glTF, whose Y is up unless the options say otherwise |
/// | `.npy` | joints `(frames, 22, 3)` or `(frames, 66)`, or pose features `(frames, 263)`, as HumanML3D stores them |
///
/// Between the file's frames rotations take the shortest way.
///
/// # Errors
///
/// If the name has another end; the file cannot be read or is damaged; its skeleton is unknown or has no
/// human size; or there is more than an hour of motion.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<ImportedMotion, ReadError> {
    let path = path.as_ref();
    if let Some(rate) = options.frames_per_second
        && !(1e-3..=1e4).contains(&rate)
    {
        return Err(ReadError::FrameRate {
            path: path.to_owned(),
            found: rate,
        });
    }
    if let Some(problem) = placeholder_at(path) {
        return Err(ReadError::Placeholder {
            path: path.to_owned(),
            problem,
        });
    }
    match ending(path).as_deref() {
        Some("bvh") => bvh::read(path, options),
        Some("glb" | "gltf") => {
            let (clip, other_animations) = glb::read(path, options.animation.as_deref())?;
            let options = ReadOptions {
                up: options.up.or(Some(Up::Y)),
                frames_per_second: None,
                ..options.clone()
            };
            let imported = import(&clip, &options, path)?;
            Ok(ImportedMotion {
                other_animations,
                ..imported
            })
        }
        Some("npy") => npy::read(path, options),
        found => Err(ReadError::Ending {
            path: path.to_owned(),
            found: shown(found),
        }),
    }
}

/// How a motion is written.
#[derive(Clone, Debug, PartialEq)]
pub struct WriteOptions {
    /// Frames a second, of files that hold rotations: 20, as the motion has them.
    pub frames_per_second: f32,
    /// How a BVH is written.
    pub bvh: BvhOptions,
    /// What a GLB holds.
    pub glb: GlbOptions,
}

impl Default for WriteOptions {
    fn default() -> Self {
        WriteOptions {
            frames_per_second: FRAMES_PER_SECOND,
            bvh: BvhOptions::default(),
            glb: GlbOptions::default(),
        }
    }
}

/// Writes a motion; a reader never sees half a file.
///
/// | name ends in | written as |
/// |---|---|
/// | `.bvh` | [BVH](crate::bvh::text) |
/// | `.glb` | [glTF](crate::glb) |
/// | `.features.npy` | pose features, `(frames, 263)`: those the motion came from, else [encoded](lamogen_motion::encode) ones |
/// | `.npy` | joints, `(frames, 22, 3)`, metres, Y up, 20 frames a second |
///
/// # Errors
///
/// If the name has another end, an option makes no sense for it, pose features are asked of a single frame, or the file cannot be written.
pub fn write(
    path: impl AsRef<Path>,
    motion: &Motion,
    options: &WriteOptions,
) -> Result<(), WriteError> {
    let path = path.as_ref();
    let ending = ending(path);
    let rate = options.frames_per_second;
    let expected = match ending.as_deref() {
        Some("npy") if rate != FRAMES_PER_SECOND => Some("20, as arrays have them,"),
        _ if !(1e-3..=1e4).contains(&rate) => Some("0.001 to 10000"),
        _ => None,
    };
    if let Some(expected) = expected {
        return Err(WriteError::FrameRate {
            path: path.to_owned(),
            expected,
            found: rate,
        });
    }
    if let Some("bvh" | "glb") = ending.as_deref() {
        check(path, motion, rate)?;
    }
    match ending.as_deref() {
        Some("bvh") => {
            let metres = options.bvh.unit.metres();
            if !Unit::LENGTHS.contains(&metres) {
                return Err(WriteError::Unit {
                    path: path.to_owned(),
                    found: metres,
                });
            }
            let text = bvh::text(&motion.rotations().resampled(rate), &options.bvh);
            lamogen_motion::write_atomically(path, |file| file.write_all(text.as_bytes())).map_err(
                |reason| WriteError::Io {
                    path: path.to_owned(),
                    reason,
                },
            )
        }
        Some("glb") => {
            let rotations = motion.rotations().resampled(rate);
            Ok(glb::write(path, &rotations, &options.glb)?)
        }
        Some("npy") if features(path) => Ok(motion.save_features(path)?),
        Some("npy") => Ok(motion.save_joints(path)?),
        found => Err(WriteError::Ending {
            path: path.to_owned(),
            found: shown(found),
        }),
    }
}

/// What stands after the last dot, in lower case.
fn ending(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}

/// Frames of the longest motion that is written as a rig: more than four hours at 60 a second. All of them are in memory at once.
pub(crate) const MOST_FRAMES: usize = 1_000_000;

/// How far from the origin a rig may be, in metres: farther away, single millimetres are lost in 32 bits, and farther still all digits.
pub(crate) const MOST_DISTANT: f32 = 1e6;

/// Whether a motion can be written as a rig.
fn check(path: &Path, motion: &Motion, rate: f32) -> Result<(), WriteError> {
    let found = (f64::from(motion.seconds()) * f64::from(rate)).ceil() as usize;
    if found > MOST_FRAMES {
        return Err(WriteError::Frames {
            path: path.to_owned(),
            found,
        });
    }
    for (frame, pose) in motion.joints().iter().enumerate() {
        for joint in Joint::ALL {
            let [x, y, z] = pose[joint.index()].map(f32::abs);
            let found = x.max(y).max(z);
            if found > MOST_DISTANT {
                return Err(WriteError::Far {
                    path: path.to_owned(),
                    frame,
                    joint,
                    found,
                });
            }
        }
    }
    Ok(())
}

/// Whether a name ends in `.features.npy`.
fn features(path: &Path) -> bool {
    path.file_stem()
        .is_some_and(|stem| ending(Path::new(stem)).as_deref() == Some("features"))
}

fn shown(ending: Option<&str>) -> String {
    ending.map_or("no ending".into(), |ending| format!(".{ending}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::JOINTS;

    fn motion() -> Motion {
        let pose = |frame: usize| std::array::from_fn(|j| [j as f32, frame as f32, 0.5]);
        Motion::from_joints((0..30).map(pose).collect::<Vec<[[f32; 3]; JOINTS]>>()).unwrap()
    }

    #[test]
    fn unknown_endings_are_told_the_known_ones() {
        for (name, found) in [("a.fbx", ".fbx"), ("a", "no ending"), ("a.npz", ".npz")] {
            let message = read(name, &ReadOptions::default()).unwrap_err().to_string();
            assert!(
                message.contains(".bvh") && message.contains(found),
                "{message}"
            );
            let options = WriteOptions::default();
            let message = write(name, &motion(), &options).unwrap_err().to_string();
            assert!(
                message.contains(".bvh") && message.contains(found),
                "{message}"
            );
        }
    }

    #[test]
    fn joints_written_are_joints_read_whatever_the_case_of_the_ending() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.NPY");
        write(&path, &motion(), &WriteOptions::default()).unwrap();
        assert_eq!(
            read(&path, &ReadOptions::default()).unwrap().motion,
            motion()
        );
    }

    #[test]
    fn what_cannot_be_written_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let default = WriteOptions::default;
        let mut no_rate = default();
        no_rate.frames_per_second = f32::NAN;
        let mut fast = default();
        fast.frames_per_second = 60.0;
        let mut no_unit = default();
        no_unit.bvh.unit = crate::Unit::Metres(0.0);
        for (name, options, part) in [
            ("a.bvh", no_rate, "frames a second"),
            ("a.npy", fast, "20"),
            ("a.bvh", no_unit, "unit"),
        ] {
            let path = folder.path().join(name);
            let message = write(path, &motion(), &options).unwrap_err().to_string();
            assert!(
                message.contains(name) && message.contains(part),
                "{message}"
            );
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let missing = folder.path().join("no/such/a.bvh");
        assert!(write(missing, &motion(), &default()).is_err());
    }
}
