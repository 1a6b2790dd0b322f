//! Poses at moments.

use std::sync::Arc;

use lamogen_motion::{JOINTS, Placement};

use super::error::{PlaceError, check_metres, check_seconds};

/// A pose that the body takes at a moment, wherever it is and wherever it faces.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyPose {
    seconds: f32,
    /// The joint positions in metres, with the pelvis above the origin and the body facing +Z.
    joints: Arc<[[f32; 3]; JOINTS]>,
}

impl KeyPose {
    /// Creates a pose from joint positions in metres, y up from the floor, of a body with the bones of the generated motions
    /// (HumanML3D's). Where it stands and faces does not matter.
    ///
    /// # Errors
    ///
    /// If a number is not finite or out of range.
    pub fn new(seconds: f32, joints: [[f32; 3]; JOINTS]) -> Result<KeyPose, PlaceError> {
        check_seconds(seconds)?;
        check_metres(joints.as_flattened())?;
        Ok(KeyPose {
            seconds,
            joints: Arc::new(in_own_frame(&joints)),
        })
    }

    /// Returns the same pose at another moment.
    pub(super) fn moved(&self, seconds: f32) -> KeyPose {
        KeyPose {
            seconds,
            joints: self.joints.clone(),
        }
    }

    /// Returns the moment in seconds.
    pub fn seconds(&self) -> f32 {
        self.seconds
    }

    /// Returns the joint positions in metres, with the pelvis above the origin and the body facing +Z.
    pub fn joints(&self) -> &[[f32; 3]; JOINTS] {
        &self.joints
    }

    /// Returns how far each joint of another pose is from this one in metres, when both bodies stand and face alike.
    pub fn distances(&self, pose: &[[f32; 3]; JOINTS]) -> [f32; JOINTS] {
        let own = in_own_frame(pose);
        std::array::from_fn(|joint| {
            let pairs = own[joint].iter().zip(&self.joints[joint]);
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt()
        })
    }
}

/// Moves a pose above the origin and turns it so that it faces +Z.
fn in_own_frame(pose: &[[f32; 3]; JOINTS]) -> [[f32; 3]; JOINTS] {
    let to_origin = Placement::of(pose).to(&Placement::ORIGIN);
    pose.map(|point| to_origin.of_point(point))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::Joint;

    fn pose() -> [[f32; 3]; JOINTS] {
        let mut pose: [[f32; 3]; JOINTS] =
            std::array::from_fn(|joint| [0.0, 0.07 * joint as f32, 0.01 * joint as f32]);
        for (joint, x) in [
            (Joint::LeftHip, 0.1),
            (Joint::RightHip, -0.1),
            (Joint::LeftShoulder, 0.2),
            (Joint::RightShoulder, -0.2),
        ] {
            pose[joint.index()][0] = x;
        }
        pose
    }

    #[test]
    fn it_does_not_matter_where_a_pose_stands_and_faces() {
        let key = KeyPose::new(1.0, pose()).unwrap();
        let (sin, cos) = 2.0_f32.sin_cos();
        let elsewhere =
            pose().map(|[x, y, z]| [3.0 + cos * x + sin * z, y, cos * z - sin * x - 1.0]);
        let largest = key.distances(&elsewhere).into_iter().fold(0.0, f32::max);
        assert!(largest < 1e-5, "{largest}");
        let mut raised = elsewhere;
        raised[Joint::LeftWrist.index()][1] += 0.3;
        let distances = key.distances(&raised);
        assert!((distances[Joint::LeftWrist.index()] - 0.3).abs() < 1e-5);
        assert!((distances.iter().sum::<f32>() - 0.3).abs() < 1e-4);
    }

    #[test]
    fn numbers_that_make_no_pose_are_refused() {
        let mut broken = pose();
        broken[3][1] = f32::NAN;
        for (seconds, joints) in [(f32::NAN, pose()), (-1.0, pose()), (1.0, broken)] {
            assert!(KeyPose::new(seconds, joints).is_err());
        }
    }
}
