//! Reading and writing motions in the format that the file's extension selects.

use std::io::Write;
use std::path::Path;

use lamogen_motion::{
    FRAMES_PER_SECOND, Joint, LoopEnd, Motion, RootMotion, describe_placeholder_at, placeholder,
};

use crate::bvh::{self, BvhOptions};
use crate::error::{ReadError, WriteError};
use crate::glb::{self, GlbError, GlbOptions, GltfMotion};
use crate::import::{ImportedMotion, ReadOptions, import};
use crate::npy;
use crate::units::{Unit, UpAxis};
use crate::vrma::{self, VrmaOptions};

/// Reads a motion of any known skeleton, at any frame rate.
///
/// | name ends in | read as |
/// |---|---|
/// | `.bvh` | BVH |
/// | `.glb`, `.gltf`, `.vrm` | glTF, with Y up unless the options name another axis |
/// | `.vrma` | [VRM animation](crate::vrma), whose joints are its human bones, whatever they are called; so is a glTF of another ending with the extension `VRMC_vrm_animation` |
/// | `.npy` | joints `(frames, 22, 3)` or `(frames, 66)`, or pose features `(frames, 263)`, as HumanML3D stores them |
///
/// Between the frames of the file, rotations are interpolated along the shortest arc.
///
/// # Errors
///
/// If the extension is another one; the file cannot be read or is damaged; its skeleton is unknown or does not have
/// the size of a human; or the motion is longer than an hour.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<ImportedMotion, ReadError> {
    let path = path.as_ref();
    check_frame_rate(path, options)?;
    if let Some(problem) = describe_placeholder_at(path) {
        return Err(ReadError::Placeholder {
            path: path.to_owned(),
            problem,
        });
    }
    let extension = extension(path);
    if !matches!(
        extension.as_deref(),
        Some("bvh" | "glb" | "gltf" | "vrm" | "vrma" | "npy")
    ) {
        return Err(ReadError::Ending {
            path: path.to_owned(),
            found: describe(extension.as_deref()),
        });
    }
    let bytes = std::fs::read(path).map_err(|reason| ReadError::Io {
        path: path.to_owned(),
        reason,
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    read_format(&bytes, path, Some(folder), options)
}

/// Reads a motion from the bytes of a file, in the same way as [`read`] reads it from a file. `name` selects the format by
/// its extension and is used in error messages; no file is opened. A glTF must therefore contain its buffers.
///
/// # Errors
///
/// In the same cases as [`read`], or if a glTF refers to another file.
pub fn read_bytes(
    bytes: &[u8],
    name: impl AsRef<Path>,
    options: &ReadOptions,
) -> Result<ImportedMotion, ReadError> {
    let name = name.as_ref();
    check_frame_rate(name, options)?;
    if let Some(problem) = placeholder(bytes) {
        return Err(ReadError::Placeholder {
            path: name.to_owned(),
            problem,
        });
    }
    read_format(bytes, name, None, options)
}

/// Refuses a frame rate that no recording has.
fn check_frame_rate(path: &Path, options: &ReadOptions) -> Result<(), ReadError> {
    match options.frames_per_second {
        Some(rate) if !(1e-3..=1e4).contains(&rate) => Err(ReadError::FrameRate {
            path: path.to_owned(),
            found: rate,
        }),
        _ => Ok(()),
    }
}

/// Reads a motion from the bytes of a file in the format of its extension. `folder` has the other files to which a glTF
/// may refer.
fn read_format(
    bytes: &[u8],
    path: &Path,
    folder: Option<&Path>,
    options: &ReadOptions,
) -> Result<ImportedMotion, ReadError> {
    match extension(path).as_deref() {
        // Bytes that are not UTF-8 occur in joint names of old files.
        Some("bvh") => bvh::read_text(&String::from_utf8_lossy(bytes), options, path),
        Some(extension @ ("glb" | "gltf" | "vrm" | "vrma")) => {
            let GltfMotion {
                clip,
                human_joints,
                other_animations,
                copyright,
            } = glb::read(bytes, path, folder, options.animation.as_deref())?;
            let human_joints = match human_joints {
                // A mapping in the options replaces what the file says.
                _ if options.mapping.is_some() => None,
                None if extension != "vrma" => None,
                None => Some(Err("expected it, found none".into())),
                found => found,
            };
            let human_joints = human_joints.transpose().map_err(|reason: String| {
                let reason = format!("{}: {reason}", vrma::EXTENSION);
                let path = path.to_owned();
                GlbError::Format { path, reason }
            })?;
            let known = human_joints.map(|joints| (vrma::SCHEME, joints));
            let options = ReadOptions {
                up: options.up.or(Some(UpAxis::Y)),
                frames_per_second: None,
                ..options.clone()
            };
            let imported = import(&clip, known, &options, path)?;
            Ok(ImportedMotion {
                motion: imported.motion.with_copyright(copyright),
                other_animations,
                ..imported
            })
        }
        Some("npy") => npy::read(bytes, path, options),
        found => Err(ReadError::Ending {
            path: path.to_owned(),
            found: describe(found),
        }),
    }
}

/// Options for writing a motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WriteOptions {
    /// Frames per second of all files but those of pose features. The default is `None`: 30 for VRM animations, as their
    /// specification proposes, and 20 for the others, the frame rate of the motion, at which files hold exactly its frames.
    pub frames_per_second: Option<f32>,
    /// The options of BVH files.
    pub bvh: BvhOptions,
    /// The options of GLB files.
    pub glb: GlbOptions,
    /// The options of VRM animations.
    pub vrma: VrmaOptions,
}

/// Writes a motion. The file is replaced atomically, so that a reader never sees half a file.
///
/// The travel of the motion is where [`Motion::root_motion`] says: in the pelvis, in a root above it (`.glb` and `.bvh`; in a
/// `.vrma` it stays in the hips), or nowhere. In a `.glb` and a `.vrma`, a loop ends with the keyframe that closes it; its frame rate is changed so little that a cycle is a
/// whole number of frames.
///
/// | name ends in | written as |
/// |---|---|
/// | `.bvh` | [BVH](crate::bvh::text) |
/// | `.glb` | [glTF](crate::glb) |
/// | `.vrma` | [VRM animation](crate::vrma) |
/// | `.features.npy` | pose features, `(frames, 263)`: those the motion was made from, or else [encoded](lamogen_motion::encode) ones |
/// | `.npy` | joints, `(frames, 22, 3)`, metres, Y up |
///
/// # Errors
///
/// If the extension is another one, an option is not valid for the format, pose features are requested for a single
/// frame, or the file cannot be written.
pub fn write(
    path: impl AsRef<Path>,
    motion: &Motion,
    options: &WriteOptions,
) -> Result<(), WriteError> {
    let path = path.as_ref();
    let bytes = write_bytes(path, motion, options)?;
    lamogen_motion::write_atomically(path, |file| file.write_all(&bytes)).map_err(|reason| {
        WriteError::Io {
            path: path.to_owned(),
            reason,
        }
    })
}

/// Returns the bytes of the file that [`write`](write()) would write. `name` selects the format by its extension and is used
/// in error messages; no file is opened.
///
/// # Errors
///
/// In the same cases as [`write`](write()), but for those of the file.
pub fn write_bytes(
    name: impl AsRef<Path>,
    motion: &Motion,
    options: &WriteOptions,
) -> Result<Vec<u8>, WriteError> {
    let path = name.as_ref();
    let extension = extension(path);
    let default_rate = match extension.as_deref() {
        Some("vrma") => vrma::FRAMES_PER_SECOND,
        _ => FRAMES_PER_SECOND,
    };
    let rate = options.frames_per_second.unwrap_or(default_rate);
    let expected = match extension.as_deref() {
        Some("npy") if rate != FRAMES_PER_SECOND && is_features_file(path) => {
            Some("20, as pose features have them,")
        }
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
    if let Some("bvh" | "glb" | "vrma") = extension.as_deref() {
        check_rig_limits(path, motion, rate)?;
    }
    match extension.as_deref() {
        Some("bvh") => {
            let metres = options.bvh.unit.metres();
            if !Unit::LENGTHS.contains(&metres) {
                return Err(WriteError::Unit {
                    path: path.to_owned(),
                    found: metres,
                });
            }
            let keyframes = motion.keyframes(rate, LoopEnd::Open);
            Ok(bvh::text(&keyframes, &options.bvh).into_bytes())
        }
        Some("glb") => {
            let keyframes = motion.keyframes(rate, LoopEnd::Closed);
            let copyright = options.glb.copyright.as_deref().or(motion.copyright());
            let mut options = GlbOptions {
                copyright: copyright.map(str::to_owned),
                ..options.glb.clone()
            };
            if let Some(note) = motion.root_motion().note() {
                options.notes.insert("root_motion".into(), note.into());
            }
            Ok(glb::bytes(&keyframes, &options)?)
        }
        Some("vrma") => {
            let travel = match motion.root_motion() {
                RootMotion::None => RootMotion::None,
                // A VRM animation moves no node above the hips.
                RootMotion::Hips | RootMotion::Root => RootMotion::Hips,
            };
            let placed = motion.clone().with_root_motion(travel);
            let rotations = placed.keyframes(rate, LoopEnd::Closed).rotations;
            let copyright = options.vrma.copyright.as_deref().or(motion.copyright());
            let mut options = VrmaOptions {
                copyright: copyright.map(str::to_owned),
                ..options.vrma.clone()
            };
            if let Some(note) = travel.note() {
                options.notes.insert("root_motion".into(), note.into());
            }
            Ok(vrma::bytes(&rotations, &options)?)
        }
        Some("npy") if is_features_file(path) => Ok(motion.features_npy(path)?),
        Some("npy") if rate != FRAMES_PER_SECOND => Ok(npy::joints_bytes(motion, rate)),
        Some("npy") => Ok(motion.joints_npy()),
        found => Err(WriteError::Ending {
            path: path.to_owned(),
            found: describe(found),
        }),
    }
}

/// Returns the part of the file's name after the last dot, in lower case.
fn extension(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}

/// The most frames of a motion that is written as a rig: more than four hours at 60 frames per second. All frames are
/// in memory at once.
pub(crate) const MAX_FRAMES: usize = 1_000_000;

/// The largest distance of a rig from the origin, in metres. Farther away, numbers of 32 bits lose single millimetres,
/// and still farther away all digits.
pub(crate) const MAX_DISTANCE: f32 = 1e6;

/// Checks that a motion is short enough and near enough to the origin to be written as a rig.
fn check_rig_limits(path: &Path, motion: &Motion, rate: f32) -> Result<(), WriteError> {
    let found = (f64::from(motion.seconds()) * f64::from(rate)).ceil() as usize;
    if found > MAX_FRAMES {
        return Err(WriteError::Frames {
            path: path.to_owned(),
            found,
        });
    }
    for (frame, pose) in motion.joints().iter().enumerate() {
        for joint in Joint::ALL {
            let [x, y, z] = pose[joint.index()].map(f32::abs);
            let found = x.max(y).max(z);
            if found > MAX_DISTANCE {
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

/// Returns whether a file's name ends in `.features.npy`.
fn is_features_file(path: &Path) -> bool {
    path.file_stem()
        .is_some_and(|stem| extension(Path::new(stem)).as_deref() == Some("features"))
}

/// Formats an extension for an error message.
fn describe(extension: Option<&str>) -> String {
    extension.map_or("no ending".into(), |extension| format!(".{extension}"))
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
    fn unknown_endings_are_errors_that_list_the_known_ones() {
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
    fn joints_are_read_back_from_extensions_in_any_case() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.NPY");
        write(&path, &motion(), &WriteOptions::default()).unwrap();
        assert_eq!(
            read(&path, &ReadOptions::default()).unwrap().motion,
            motion()
        );
    }

    #[test]
    fn bytes_in_memory_are_those_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let faster = WriteOptions {
            frames_per_second: Some(30.0),
            ..WriteOptions::default()
        };
        for (name, options) in [
            ("a.bvh", WriteOptions::default()),
            ("a.glb", WriteOptions::default()),
            ("a.vrma", faster.clone()),
            ("a.npy", WriteOptions::default()),
            ("b.npy", faster),
            ("a.features.npy", WriteOptions::default()),
        ] {
            let path = folder.path().join(name);
            write(&path, &motion(), &options).unwrap();
            let bytes = write_bytes(name, &motion(), &options).unwrap();
            assert!(std::fs::read(&path).unwrap() == bytes, "{name}");
        }
    }

    #[test]
    fn errors_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let default = WriteOptions::default;
        let mut no_rate = default();
        no_rate.frames_per_second = Some(f32::NAN);
        let mut fast = default();
        fast.frames_per_second = Some(60.0);
        let mut no_unit = default();
        no_unit.bvh.unit = crate::Unit::Metres(0.0);
        for (name, options, part) in [
            ("a.bvh", no_rate, "frames a second"),
            ("a.features.npy", fast, "20"),
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
