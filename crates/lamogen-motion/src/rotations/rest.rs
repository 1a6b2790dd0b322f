//! The T-pose.

use glam::{DMat3, DQuat, DVec3};

use super::fit::fit;
use crate::motion::Motion;
use crate::precise::{points, vector};
use crate::quality::BoneDrift;
use crate::skeleton::{JOINTS, Joint};

/// The skeleton without any rotation: a T-pose that faces +Z, Y up, left arm along +X, with the bone
/// lengths of a motion.
///
/// Limbs and spine are straight. Where the joints around the pelvis and the upper spine sit, the motion
/// itself says: they hang together, and only their true places let one rotation reach all of them.
#[derive(Clone, Debug, PartialEq)]
pub struct RestPose {
    pub(super) offsets: [[f32; 3]; JOINTS],
}

/// A joint whose children move together: the child on the left, that on the right, and that of the spine.
pub(super) struct Hub {
    pub(super) joint: Joint,
    pub(super) left: Joint,
    pub(super) right: Joint,
    pub(super) upper: Joint,
}

/// Pelvis and upper spine.
pub(super) const HUBS: [Hub; 2] = [
    Hub {
        joint: Joint::Pelvis,
        left: Joint::LeftHip,
        right: Joint::RightHip,
        upper: Joint::Spine1,
    },
    Hub {
        joint: Joint::Spine3,
        left: Joint::LeftCollar,
        right: Joint::RightCollar,
        upper: Joint::Neck,
    },
];

impl Hub {
    pub(super) fn children(&self) -> [Joint; 3] {
        [self.left, self.right, self.upper]
    }
}

/// Bones shorter than this have no direction, in metres.
pub(super) const SHORTEST: f64 = 1e-6;
/// Rounds in which the shape of a hub and its turns are fitted to each other.
const ROUNDS: usize = 3;
/// Length of a leg from hip to ankle, in metres, of the body that [`RestPose::tips`] is measured on.
const LEG: f64 = 0.82;

/// [`RestPose::humanml3d`] in tenths of a millimetre.
const HUMANML3D: [[i16; 3]; JOINTS] = [
    [0, 0, 0],
    [543, -863, -152],
    [-663, -863, -152],
    [33, 1307, -152],
    [0, -3936, 0],
    [0, -3902, 0],
    [0, 1432, 0],
    [0, -4324, 0],
    [0, -4256, 0],
    [0, 574, 0],
    [0, -641, 1282],
    [0, -668, 1336],
    [-67, 2168, -329],
    [661, 1160, -329],
    [-777, 1160, -329],
    [0, 1030, 0],
    [1316, 0, 0],
    [-1230, 0, 0],
    [2568, 0, 0],
    [-2631, 0, 0],
    [2660, 0, 0],
    [-2699, 0, 0],
];

impl RestPose {
    /// The T-pose of a motion's body: every bone as long as it is on the median over the frames.
    pub fn of(motion: &Motion) -> RestPose {
        let poses: Vec<[DVec3; JOINTS]> = motion.joints().iter().map(points).collect();
        let lengths = BoneDrift::of(motion).lengths.map(f64::from);
        let mut offsets = Joint::ALL.map(|joint| direction(joint) * lengths[joint.index()]);
        for hub in &HUBS {
            if let Some(shape) = shape(&poses, hub, &lengths) {
                for (joint, offset) in hub.children().into_iter().zip(shape) {
                    offsets[joint.index()] = offset;
                }
            }
        }
        RestPose {
            offsets: offsets.map(|offset| offset.as_vec3().to_array()),
        }
    }

    /// The body that all motions of HumanML3D have, to a tenth of a millimetre: measured as [`RestPose::of`] does on
    /// the sample that comes with the data set's code. It is not quite symmetric.
    pub fn humanml3d() -> RestPose {
        RestPose {
            offsets: HUMANML3D.map(|offset| offset.map(|x| f32::from(x) / 1e4)),
        }
    }

    /// Length of the legs from hip to ankle, in metres, on the average of both.
    pub fn leg(&self) -> f32 {
        let legs = [
            Joint::LeftKnee,
            Joint::LeftAnkle,
            Joint::RightKnee,
            Joint::RightAnkle,
        ];
        let lengths = legs.map(|joint| vector(self.offset(joint)).length());
        (lengths.iter().sum::<f64>() / 2.0) as f32
    }

    /// The axis about which elbow or knee bends in the T-pose: elbows bend forward when the palms look down, knees backward. `None` for
    /// joints that turn any way.
    pub fn hinge(joint: Joint) -> Option<[f32; 3]> {
        match joint {
            Joint::LeftElbow => Some([0.0, -1.0, 0.0]),
            Joint::RightElbow => Some([0.0, 1.0, 0.0]),
            Joint::LeftKnee | Joint::RightKnee => Some([1.0, 0.0, 0.0]),
            _ => None,
        }
    }

    /// Where a joint is seen from its parent, in metres; the pelvis is at the origin.
    pub fn offset(&self, joint: Joint) -> [f32; 3] {
        self.offsets[joint.index()]
    }

    /// Where the limbs end, in metres from the joints that have no child: crown of the head, fingertips,
    /// tips of the toes. No motion knows them; they are those of a grown body, scaled to this one's legs.
    pub fn tips(&self) -> [(Joint, [f32; 3]); 5] {
        let length = |joint: Joint| vector(self.offset(joint)).length();
        let leg = [Joint::LeftKnee, Joint::LeftAnkle].map(length);
        let scale = (leg.iter().sum::<f64>() / LEG) as f32;
        [
            (Joint::Head, [0.0, 0.18, 0.0]),
            (Joint::LeftWrist, [0.17, 0.0, 0.0]),
            (Joint::RightWrist, [-0.17, 0.0, 0.0]),
            (Joint::LeftFoot, [0.0, 0.0, 0.07]),
            (Joint::RightFoot, [0.0, 0.0, 0.07]),
        ]
        .map(|(joint, tip)| (joint, tip.map(|x| x * scale)))
    }
}

/// Where the bone that ends in a joint points in the T-pose. Those of the hubs stand in only for motions
/// whose hubs have no shape.
pub(super) fn direction(joint: Joint) -> DVec3 {
    use Joint::*;
    match joint {
        Pelvis => DVec3::ZERO,
        LeftHip => DVec3::new(0.8, -0.6, 0.0),
        RightHip => DVec3::new(-0.8, -0.6, 0.0),
        Spine1 | Spine2 | Spine3 | Neck | Head => DVec3::Y,
        LeftKnee | RightKnee | LeftAnkle | RightAnkle => DVec3::NEG_Y,
        // From the ankle down to the ball.
        LeftFoot | RightFoot => DVec3::new(0.0, -0.447_213_6, 0.894_427_2),
        LeftCollar => DVec3::new(0.6, 0.8, 0.0),
        RightCollar => DVec3::new(-0.6, 0.8, 0.0),
        LeftShoulder | LeftElbow | LeftWrist => DVec3::X,
        RightShoulder | RightElbow | RightWrist => DVec3::NEG_X,
    }
}

/// The places of a hub's children around it, upright: left to right along X, the spine in the plane of X
/// and Y. `None` if they lie on one line at every frame.
fn shape(poses: &[[DVec3; JOINTS]], hub: &Hub, lengths: &[f64; JOINTS]) -> Option<[DVec3; 3]> {
    let children = hub.children();
    let seen = |pose: &[DVec3; JOINTS]| {
        children.map(|child| pose[child.index()] - pose[hub.joint.index()])
    };
    let lengths = children.map(|child| lengths[child.index()]);
    let (mut sum, mut frames) = ([DVec3::ZERO; 3], 0);
    for pose in poses {
        let places = seen(pose);
        if let Some(upright) = upright(places) {
            for (sum, place) in sum.iter_mut().zip(places) {
                *sum += upright.transpose() * place;
            }
            frames += 1;
        }
    }
    if frames == 0 {
        return None;
    }
    // The mean of directions that differ is short.
    let full =
        |shape: [DVec3; 3]| std::array::from_fn(|i| shape[i].normalize_or_zero() * lengths[i]);
    let mut shape = full(sum);
    for _ in 0..ROUNDS {
        let mut sum = [DVec3::ZERO; 3];
        let mut turn = DQuat::IDENTITY;
        for pose in poses {
            let places = seen(pose);
            turn = fit(&shape, &places, turn);
            for (sum, place) in sum.iter_mut().zip(places) {
                *sum += turn.inverse() * place;
            }
        }
        shape = full(sum);
    }
    let upright = upright(shape)?;
    Some(shape.map(|place| upright.transpose() * place))
}

/// The frame in which X runs from the right child to the left one and Y towards the spine's.
fn upright([left, right, upper]: [DVec3; 3]) -> Option<DMat3> {
    let x = (left - right).try_normalize()?;
    let middle = (left + right) / 2.0;
    // Where the three are on one line, that line is above or below the hub; or the hub is on it too, and any
    // direction across is as good.
    let ups = [upper - middle, upper, -middle].map(|up| up - up.dot(x) * x);
    let up = ups.into_iter().find(|up| up.length() > SHORTEST);
    let y = up.unwrap_or(x.any_orthogonal_vector()).normalize();
    Some(DMat3::from_cols(x, y, x.cross(y)))
}
