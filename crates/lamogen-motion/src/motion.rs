//! A single motion on the host.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Tensor;

use crate::decode::decode;
use crate::encode::encode_canonical;
use crate::features::POSE_FEATURES;
use crate::npy::{self, NpyError};
use crate::rotations::{RestPose, Rotations};
use crate::skeleton::{JOINTS, Joint};
use crate::travel::RootMotion;

/// The frame rate of HumanML3D and of every [`Motion`].
pub const FRAMES_PER_SECOND: f32 = 20.0;

/// A motion: the position of every joint at every frame.
///
/// A motion keeps the pose features or the rotations that it was made from; one that was made from joint positions
/// has neither. Two motions are equal if these and the joints are, whatever their [copyright](Motion::copyright) and
/// whether they are [loops](Motion::loop_travel).
#[derive(Clone, Debug)]
pub struct Motion {
    joints: Vec<[[f32; 3]; JOINTS]>,
    features: Option<Vec<[f32; POSE_FEATURES]>>,
    rotations: Option<Rotations>,
    copyright: Option<Arc<str>>,
    /// The travel of each cycle along the ground, if the motion is a loop.
    loop_travel: Option<[f32; 2]>,
    root_motion: RootMotion,
}

impl PartialEq for Motion {
    fn eq(&self, other: &Self) -> bool {
        self.joints == other.joints
            && self.features == other.features
            && self.rotations == other.rotations
    }
}

/// Why a motion cannot be made from its input.
#[derive(Debug, thiserror::Error)]
pub enum MotionError {
    /// There are no frames.
    #[error("expected a motion of at least one frame, found none")]
    Empty,
    /// The pose features have another width than 263.
    #[error("expected {POSE_FEATURES} pose features a frame, found {found}")]
    #[allow(missing_docs)]
    Width { found: usize },
    /// A joint position is not finite.
    #[error("frame {frame}: the position of {joint} is not finite", joint = .joint.name())]
    #[allow(missing_docs)]
    NotFinite { frame: usize, joint: Joint },
    /// The rotations have another frame rate than [`FRAMES_PER_SECOND`].
    #[error(
        "expected rotations at {FRAMES_PER_SECOND} frames a second, found {found}; resample them first"
    )]
    #[allow(missing_docs)]
    FrameRate { found: f32 },
}

/// Why a motion shows no body whose pose another body can take.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum BodyError {
    /// The legs have no length, or one that is no body's.
    #[error(
        "expected a body with legs of {} to {} m, found legs of {leg} m",
        BodyError::SHORTEST_LEG,
        BodyError::LONGEST_LEG
    )]
    Size { leg: f32 },
    /// The body is so far from the origin that its positions are too coarse to tell its pose.
    #[error(
        "expected a body within {} leg lengths of the origin, where positions are fine enough for a pose, found it {metres} m away with legs of {leg} m",
        BodyError::MOST_LEGS_AWAY
    )]
    Distance { metres: f32, leg: f32 },
}

impl BodyError {
    /// The shortest leg of a body in metres.
    pub const SHORTEST_LEG: f32 = 0.01;
    /// The longest leg of a body in metres.
    pub const LONGEST_LEG: f32 = 1000.0;
    /// The largest distance of a body from the origin, in lengths of its legs. There a float is a thousandth of a leg.
    pub const MOST_LEGS_AWAY: f32 = 10_000.0;
}

impl Motion {
    /// Checks that the motion shows a body whose pose another body can take: with legs, and near enough to the origin.
    ///
    /// # Errors
    ///
    /// If its legs have no length or one that is no body's, or it is so far away that its positions are coarser than a pose.
    pub fn check_body(&self) -> Result<(), BodyError> {
        let leg = match &self.rotations {
            Some(rotations) => rotations.rest().leg(),
            None => RestPose::of(self).leg(),
        };
        // NaN is in no range.
        if !(BodyError::SHORTEST_LEG..=BodyError::LONGEST_LEG).contains(&leg) {
            return Err(BodyError::Size { leg });
        }
        let coordinates = self.joints.as_flattened().as_flattened().iter();
        let metres = coordinates.fold(0.0f32, |most, x| most.max(x.abs()));
        match metres > BodyError::MOST_LEGS_AWAY * leg {
            true => Err(BodyError::Distance { metres, leg }),
            false => Ok(()),
        }
    }

    /// Makes a motion from joint positions in metres, Y up, at [`FRAMES_PER_SECOND`].
    ///
    /// # Errors
    ///
    /// If there is no frame or a position is not finite.
    pub fn from_joints(joints: Vec<[[f32; 3]; JOINTS]>) -> Result<Motion, MotionError> {
        if joints.is_empty() {
            return Err(MotionError::Empty);
        }
        for (frame, pose) in joints.iter().enumerate() {
            for joint in Joint::ALL {
                if !pose[joint.index()].iter().all(|x| x.is_finite()) {
                    return Err(MotionError::NotFinite { frame, joint });
                }
            }
        }
        Ok(Motion {
            joints,
            features: None,
            rotations: None,
            copyright: None,
            loop_travel: None,
            root_motion: RootMotion::default(),
        })
    }

    /// Makes the motion of a rigid body from its rotations, and keeps these. The joint positions are those of
    /// [`Rotations::joints`], and files that hold rotations hold exactly the ones given here. It is a loop if the rotations
    /// are ones.
    ///
    /// # Errors
    ///
    /// If the rotations are not at [`FRAMES_PER_SECOND`], or a position is not finite.
    pub fn from_rotations(rotations: Rotations) -> Result<Motion, MotionError> {
        let found = rotations.frames_per_second();
        if found != FRAMES_PER_SECOND {
            return Err(MotionError::FrameRate { found });
        }
        Ok(Motion {
            joints: Motion::from_joints(rotations.joints())?.joints,
            features: None,
            loop_travel: rotations.loop_travel(),
            rotations: Some(rotations),
            copyright: None,
            root_motion: RootMotion::default(),
        })
    }

    /// Makes a motion from pose features (not normalised), which are kept beside its joints.
    ///
    /// # Shapes
    ///
    /// - `features`: `[frames, 263]`
    ///
    /// # Errors
    ///
    /// If there is no frame, the width is not 263, or a position is not finite.
    pub fn from_features(features: Tensor<2>) -> Result<Motion, MotionError> {
        let [_, width] = features.dims();
        if width != POSE_FEATURES {
            return Err(MotionError::Width { found: width });
        }
        let rows = to_host(features)
            .chunks_exact(POSE_FEATURES)
            .map(|row| row.try_into().expect("rows of 263"))
            .collect();
        Motion::from_pose_features(rows)
    }

    /// As [`from_features`](Self::from_features), for features that are on the host, one row for each frame.
    ///
    /// # Errors
    ///
    /// If there is no frame, or a position is not finite.
    pub fn from_pose_features(features: Vec<[f32; POSE_FEATURES]>) -> Result<Motion, MotionError> {
        Ok(Motion {
            joints: Motion::from_joints(decode(&features))?.joints,
            features: Some(features),
            rotations: None,
            copyright: None,
            loop_travel: None,
            root_motion: RootMotion::default(),
        })
    }

    /// Sets the terms under which the motion may be used, which files and pictures of it contain where their formats have a place for them.
    pub fn with_copyright(self, copyright: Option<impl Into<Arc<str>>>) -> Self {
        Motion {
            copyright: copyright.map(Into::into),
            ..self
        }
    }

    /// Returns the terms under which the motion may be used, if they are known: those of a generated motion name the licence of the model.
    pub fn copyright(&self) -> Option<&str> {
        self.copyright.as_deref()
    }

    /// Makes the motion a loop: its first frame follows its last one, moved along the ground by the given travel, `[x, z]` in
    /// metres. `None` makes it a motion with two ends.
    pub fn with_loop_travel(self, travel: Option<[f32; 2]>) -> Self {
        Motion {
            loop_travel: travel,
            rotations: { self.rotations }.map(|rotations| rotations.with_loop_travel(travel)),
            ..self
        }
    }

    /// Returns how far a loop moves along the ground in a cycle, `[x, z]` in metres, from its first frame to the frame that
    /// follows its last one. It is `None` if the motion is no loop.
    pub fn loop_travel(&self) -> Option<[f32; 2]> {
        self.loop_travel
    }

    /// Sets where files of the motion keep its travel. [`joints`](Self::joints) and [`rotations`](Self::rotations) travel
    /// always.
    pub fn with_root_motion(self, root_motion: RootMotion) -> Self {
        Motion {
            root_motion,
            ..self
        }
    }

    /// Returns where files of the motion keep its travel.
    pub fn root_motion(&self) -> RootMotion {
        self.root_motion
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> usize {
        self.joints.len()
    }

    /// Returns the length in seconds.
    pub fn seconds(&self) -> f32 {
        self.frames() as f32 / FRAMES_PER_SECOND
    }

    /// Returns the joint positions in metres, one pose for each frame, indexed by [`Joint::index`].
    pub fn joints(&self) -> &[[[f32; 3]; JOINTS]] {
        &self.joints
    }

    /// Returns the pose features that the motion was made from, if it was made from features.
    pub fn features(&self) -> Option<&[[f32; POSE_FEATURES]]> {
        self.features.as_deref()
    }

    /// Returns whether this is the motion of a rigid body, that is, whether it was made from rotations.
    pub fn is_rigid(&self) -> bool {
        self.rotations.is_some()
    }

    /// Returns the local rotations of the joints.
    ///
    /// If the motion was made from rotations, these are returned, and they give its joint positions exactly. Otherwise
    /// the rotations are [solved](Rotations::of), and they give its joint positions as closely as a rigid body can.
    /// Solving takes at most a millisecond for each second of motion.
    pub fn rotations(&self) -> Cow<'_, Rotations> {
        match &self.rotations {
            Some(rotations) => Cow::Borrowed(rotations),
            None => Cow::Owned(Rotations::of(self)),
        }
    }

    /// Returns the position of a joint at a frame, in metres.
    ///
    /// # Panics
    ///
    /// If the frame is past the end.
    pub fn position(&self, frame: usize, joint: Joint) -> [f32; 3] {
        self.joints[frame][joint.index()]
    }

    /// Returns the mean distance in metres between the joints of two motions, over the frames that both have.
    pub fn distance(&self, other: &Motion) -> f32 {
        let pairs = self
            .joints
            .iter()
            .flatten()
            .zip(other.joints.iter().flatten());
        let (sum, count) = pairs.fold((0.0, 0), |(sum, count), (a, b)| {
            let squared: f32 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
            (sum + f64::from(squared.sqrt()), count + 1)
        });
        (sum / f64::from(count.max(1))) as f32
    }

    /// Writes the joint positions as a NumPy array: `.npy`, 32-bit floats, `(frames, 22, 3)`. They are those of
    /// [`placed_joints`](Self::placed_joints).
    ///
    /// # Errors
    ///
    /// If the file cannot be written; no half-written file is left behind.
    pub fn save_joints(&self, path: impl AsRef<Path>) -> Result<(), NpyError> {
        npy::write_bytes(path.as_ref(), &self.joints_npy())
    }

    /// Returns the bytes of the file that [`save_joints`](Self::save_joints) writes.
    pub fn joints_npy(&self) -> Vec<u8> {
        let joints = self.placed_joints();
        let values = joints.as_flattened().as_flattened();
        npy::bytes(values, &[self.frames(), JOINTS, 3])
    }

    /// Writes pose features as HumanML3D does: `.npy`, 32-bit floats, `(frames, 263)`.
    ///
    /// If the motion was made from features, these are written. Otherwise they are computed from its
    /// [canonical](crate::canonical) positions, and there is one row less than there are frames, because a row
    /// describes a step from a frame to the next.
    ///
    /// # Errors
    ///
    /// If the motion has a single frame and no features, or the file cannot be written; no half-written file is left
    /// behind.
    pub fn save_features(&self, path: impl AsRef<Path>) -> Result<(), NpyError> {
        let path = path.as_ref();
        npy::write_bytes(path, &self.features_npy(path)?)
    }

    /// Returns the bytes of the file that [`save_features`](Self::save_features) writes. `name` stands in the error.
    ///
    /// # Errors
    ///
    /// If the motion has a single frame and no features.
    pub fn features_npy(&self, name: impl AsRef<Path>) -> Result<Vec<u8>, NpyError> {
        let encoded;
        let rows = match &self.features {
            Some(rows) => rows,
            None => {
                encoded = encode_canonical(&self.joints);
                &encoded
            }
        };
        if rows.is_empty() {
            let reason = "pose features describe steps: expected at least 2 frames, found 1";
            return Err(NpyError::Io {
                path: name.as_ref().to_owned(),
                reason: std::io::Error::new(std::io::ErrorKind::InvalidInput, reason),
            });
        }
        Ok(npy::bytes(
            rows.as_flattened(),
            &[rows.len(), POSE_FEATURES],
        ))
    }
}

/// Copies the numbers of a tensor to the host.
fn to_host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as().expect("floats convert to f32")
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn features_keep_their_motion_company() {
        let features = Tensor::<2>::ones([7, POSE_FEATURES], &Device::flex());
        let motion = Motion::from_features(features).unwrap();
        assert_eq!(motion.frames(), 7);
        assert_eq!(motion.seconds(), 0.35);
        assert_eq!(motion.position(0, Joint::Pelvis), [0.0, 1.0, 0.0]);
        assert_eq!(motion.features().unwrap().len(), 7);
        assert_eq!(motion.distance(&motion), 0.0);
    }

    #[test]
    fn what_is_no_motion_says_why() {
        assert!(matches!(
            Motion::from_joints(vec![]),
            Err(MotionError::Empty)
        ));
        let narrow = Tensor::<2>::ones([7, 251], &Device::flex());
        let message = Motion::from_features(narrow).unwrap_err().to_string();
        assert!(
            message.contains("263") && message.contains("251"),
            "{message}"
        );

        let mut joints = vec![[[0.0; 3]; JOINTS]; 3];
        joints[2][Joint::Head.index()][1] = f32::NAN;
        let message = Motion::from_joints(joints).unwrap_err().to_string();
        assert!(
            message.contains("frame 2") && message.contains("head"),
            "{message}"
        );
    }

    #[test]
    fn features_are_saved_as_they_came_or_made_of_the_joints() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("features.npy");
        let came = Motion::from_pose_features(vec![[0.25; POSE_FEATURES]; 3]).unwrap();
        came.save_features(&path).unwrap();
        assert_eq!(npy::read(&path).unwrap().values, [0.25; 3 * POSE_FEATURES]);

        let joints = vec![[[0.5; 3]; JOINTS]; 3];
        let made = Motion::from_joints(joints.clone()).unwrap();
        made.save_features(&path).unwrap();
        assert_eq!(npy::read(&path).unwrap().shape, [2, POSE_FEATURES]);

        let single = Motion::from_joints(joints[..1].to_vec()).unwrap();
        let message = single.save_features(&path).unwrap_err().to_string();
        assert!(message.contains("at least 2 frames"), "{message}");
    }

    #[test]
    fn joints_are_saved_in_humanml3d_shape() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("joints.npy");
        let mut joints = vec![[[0.0; 3]; JOINTS]; 2];
        joints[1][Joint::RightWrist.index()] = [1.0, 2.0, 3.0];
        Motion::from_joints(joints)
            .unwrap()
            .save_joints(&path)
            .unwrap();
        let array = npy::read(&path).unwrap();
        assert_eq!(array.shape, [2, 22, 3]);
        assert_eq!(array.values[array.values.len() - 3..], [1.0, 2.0, 3.0]);
    }
}
