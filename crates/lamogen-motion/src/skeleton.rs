//! The 22 joints of HumanML3D (the SMPL body without its hands).

/// The number of joints of the skeleton.
pub const JOINTS: usize = 22;

/// A joint of the skeleton, in the order of HumanML3D.
///
/// `joint as usize` is its index in joint tensors `[batch, frames, 22, 3]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
#[repr(usize)]
pub enum Joint {
    Pelvis,
    LeftHip,
    RightHip,
    Spine1,
    LeftKnee,
    RightKnee,
    Spine2,
    LeftAnkle,
    RightAnkle,
    Spine3,
    LeftFoot,
    RightFoot,
    Neck,
    LeftCollar,
    RightCollar,
    Head,
    LeftShoulder,
    RightShoulder,
    LeftElbow,
    RightElbow,
    LeftWrist,
    RightWrist,
}

use Joint::*;

/// The five kinematic chains, from the root outwards: right leg, left leg, spine, right arm,
/// left arm. The arms start at the upper spine.
pub const CHAINS: [&[Joint]; 5] = [
    &[Pelvis, RightHip, RightKnee, RightAnkle, RightFoot],
    &[Pelvis, LeftHip, LeftKnee, LeftAnkle, LeftFoot],
    &[Pelvis, Spine1, Spine2, Spine3, Neck, Head],
    &[Spine3, RightCollar, RightShoulder, RightElbow, RightWrist],
    &[Spine3, LeftCollar, LeftShoulder, LeftElbow, LeftWrist],
];

/// The joints of the left and the right arm that turn it: shoulder, elbow and wrist.
pub const ARMS: [[Joint; 3]; 2] = [
    [LeftShoulder, LeftElbow, LeftWrist],
    [RightShoulder, RightElbow, RightWrist],
];

/// The joints of the left and the right leg that turn it: hip, knee and ankle.
pub const LEGS: [[Joint; 3]; 2] = [
    [LeftHip, LeftKnee, LeftAnkle],
    [RightHip, RightKnee, RightAnkle],
];

impl Joint {
    /// All joints, in index order.
    pub const ALL: [Joint; JOINTS] = [
        Pelvis,
        LeftHip,
        RightHip,
        Spine1,
        LeftKnee,
        RightKnee,
        Spine2,
        LeftAnkle,
        RightAnkle,
        Spine3,
        LeftFoot,
        RightFoot,
        Neck,
        LeftCollar,
        RightCollar,
        Head,
        LeftShoulder,
        RightShoulder,
        LeftElbow,
        RightElbow,
        LeftWrist,
        RightWrist,
    ];

    /// Returns the joint's index in joint tensors.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the name that SMPL and HumanML3D use, such as `left_wrist`.
    pub const fn name(self) -> &'static str {
        match self {
            Pelvis => "pelvis",
            LeftHip => "left_hip",
            RightHip => "right_hip",
            Spine1 => "spine1",
            LeftKnee => "left_knee",
            RightKnee => "right_knee",
            Spine2 => "spine2",
            LeftAnkle => "left_ankle",
            RightAnkle => "right_ankle",
            Spine3 => "spine3",
            LeftFoot => "left_foot",
            RightFoot => "right_foot",
            Neck => "neck",
            LeftCollar => "left_collar",
            RightCollar => "right_collar",
            Head => "head",
            LeftShoulder => "left_shoulder",
            RightShoulder => "right_shoulder",
            LeftElbow => "left_elbow",
            RightElbow => "right_elbow",
            LeftWrist => "left_wrist",
            RightWrist => "right_wrist",
        }
    }

    /// Returns the parent of this joint in the skeleton; `None` for the pelvis.
    pub const fn parent(self) -> Option<Joint> {
        Some(match self {
            Pelvis => return None,
            LeftHip | RightHip | Spine1 => Pelvis,
            LeftKnee => LeftHip,
            RightKnee => RightHip,
            Spine2 => Spine1,
            LeftAnkle => LeftKnee,
            RightAnkle => RightKnee,
            Spine3 => Spine2,
            LeftFoot => LeftAnkle,
            RightFoot => RightAnkle,
            Neck | LeftCollar | RightCollar => Spine3,
            Head => Neck,
            LeftShoulder => LeftCollar,
            RightShoulder => RightCollar,
            LeftElbow => LeftShoulder,
            RightElbow => RightShoulder,
            LeftWrist => LeftElbow,
            RightWrist => RightElbow,
        })
    }

    /// Returns the children of this joint in index order. Head, wrists and feet have none.
    pub fn children(self) -> impl Iterator<Item = Joint> {
        let joints = Joint::ALL.into_iter();
        joints.filter(move |joint| joint.parent() == Some(self))
    }

    /// Returns the joint on the other side of the body. A joint on the midline is its own mirror image.
    pub const fn mirrored(self) -> Joint {
        match self {
            LeftHip => RightHip,
            RightHip => LeftHip,
            LeftKnee => RightKnee,
            RightKnee => LeftKnee,
            LeftAnkle => RightAnkle,
            RightAnkle => LeftAnkle,
            LeftFoot => RightFoot,
            RightFoot => LeftFoot,
            LeftCollar => RightCollar,
            RightCollar => LeftCollar,
            LeftShoulder => RightShoulder,
            RightShoulder => LeftShoulder,
            LeftElbow => RightElbow,
            RightElbow => LeftElbow,
            LeftWrist => RightWrist,
            RightWrist => LeftWrist,
            Pelvis | Spine1 | Spine2 | Spine3 | Neck | Head => self,
        }
    }

    /// Returns the joint with a name as given by [`Joint::name`].
    pub fn from_name(name: &str) -> Option<Joint> {
        Joint::ALL.into_iter().find(|joint| joint.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_follow_the_order_of_humanml3d() {
        for (index, joint) in Joint::ALL.into_iter().enumerate() {
            assert_eq!(joint.index(), index);
            assert_eq!(Joint::from_name(joint.name()), Some(joint));
        }
        // The end-effectors as the HumanML3D tools number them.
        assert_eq!([LeftWrist.index(), RightWrist.index()], [20, 21]);
        assert_eq!([LeftFoot.index(), RightFoot.index()], [10, 11]);
        assert_eq!([Head.index(), Spine3.index()], [15, 9]);
    }

    #[test]
    fn a_parent_comes_before_its_child_and_only_the_pelvis_has_none() {
        for joint in Joint::ALL {
            match joint.parent() {
                Some(parent) => assert!(parent.index() < joint.index()),
                None => assert_eq!(joint, Pelvis),
            }
        }
    }

    #[test]
    fn chains_walk_every_bone_once() {
        let mut bones: Vec<_> = CHAINS
            .iter()
            .flat_map(|chain| chain.windows(2))
            .map(|bone| {
                assert_eq!(bone[1].parent(), Some(bone[0]));
                bone[1].index()
            })
            .collect();
        bones.sort_unstable();
        assert_eq!(bones, (1..JOINTS).collect::<Vec<_>>());
    }

    #[test]
    fn mirroring_twice_changes_nothing_and_keeps_the_tree() {
        for joint in Joint::ALL {
            assert_eq!(joint.mirrored().mirrored(), joint);
            assert_eq!(
                joint.mirrored().parent(),
                joint.parent().map(Joint::mirrored)
            );
        }
    }
}
