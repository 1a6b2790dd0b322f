//! A body that stands still, which a motion can continue.

use lamogen_motion::{
    FRAMES_PER_SECOND, JOINTS, Joint, POSE_FEATURES, RestPose, Rotations, encode_canonical,
};

/// The angle by which the arms hang below the T-pose, in radians.
const HANGING: f32 = 1.2;

/// Returns the pose features of `frames` frames in which HumanML3D's body stands still with hanging arms.
pub(crate) fn standing(frames: usize) -> Vec<[f32; POSE_FEATURES]> {
    let mut turns = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
    for (shoulder, angle) in [
        (Joint::LeftShoulder, -HANGING),
        (Joint::RightShoulder, HANGING),
    ] {
        // A quaternion around the axis that the body faces along.
        turns[shoulder.index()] = [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()];
    }
    // There is a row for each step from a frame to the next.
    let (root, turns) = (vec![[0.0; 3]; frames + 1], vec![turns; frames + 1]);
    let rotations = Rotations::new(RestPose::humanml3d(), root, turns, FRAMES_PER_SECOND);
    encode_canonical(&rotations.joints())
}

#[cfg(test)]
mod tests {
    use lamogen_motion::Motion;

    use super::*;

    #[test]
    fn the_body_stands_upright_and_its_hands_hang() {
        let motion = Motion::from_pose_features(standing(20)).unwrap();
        assert_eq!(motion.frames(), 20);
        let [first, last] = [0, 19].map(|frame| motion.joints()[frame]);
        for (a, b) in first.as_flattened().iter().zip(last.as_flattened()) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
        let height = |joint: Joint| first[joint.index()][1];
        assert!(height(Joint::Head) > 1.3 && height(Joint::LeftFoot) < 0.1);
        for hand in [Joint::LeftWrist, Joint::RightWrist] {
            assert!(height(hand) < height(Joint::Spine2), "{hand:?}");
        }
    }
}
