//! How one pose lies in the 263 numbers of HumanML3D (Guo et al. 2022, section 5).

use std::ops::Range;

use crate::skeleton::{JOINTS, Joint};

/// Width of a pose feature vector.
pub const POSE_FEATURES: usize = FeatureGroup::FootContact.range().end;

/// A run of the 263 pose features that belong together.
///
/// Frame `t` of the features describes the pose at `t` and the step from `t` to `t + 1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FeatureGroup {
    /// Half the change of heading from `t` to `t + 1`, in radians (1 value).
    RootYaw,
    /// Displacement of the root on the ground, x and z, in metres a frame, seen from the heading
    /// of `t + 1` (2 values).
    RootVelocity,
    /// Height of the root in metres (1 value).
    RootHeight,
    /// Positions of the 21 joints below the pelvis in metres, relative to the root on the ground
    /// plane, seen from the heading of `t` (63 values).
    LocalPositions,
    /// Rotations of the same joints, six values each: the first two columns of the matrix (126).
    Rotations,
    /// Displacement of all 22 joints from `t` to `t + 1` in metres, seen from the heading of `t`
    /// (66 values).
    Velocities,
    /// 1 where left ankle, left foot, right ankle, right foot stand on the ground (4 values).
    FootContact,
}

impl FeatureGroup {
    /// Every group, in the order of the vector.
    pub const ALL: [FeatureGroup; 7] = [
        FeatureGroup::RootYaw,
        FeatureGroup::RootVelocity,
        FeatureGroup::RootHeight,
        FeatureGroup::LocalPositions,
        FeatureGroup::Rotations,
        FeatureGroup::Velocities,
        FeatureGroup::FootContact,
    ];

    /// How many features the group has.
    pub const fn width(self) -> usize {
        match self {
            FeatureGroup::RootYaw | FeatureGroup::RootHeight => 1,
            FeatureGroup::RootVelocity => 2,
            FeatureGroup::LocalPositions => 3 * (JOINTS - 1),
            FeatureGroup::Rotations => 6 * (JOINTS - 1),
            FeatureGroup::Velocities => 3 * JOINTS,
            FeatureGroup::FootContact => 4,
        }
    }

    /// Where the group lies in the feature vector.
    pub const fn range(self) -> Range<usize> {
        let mut start = 0;
        let mut group = 0;
        while group < self as usize {
            start += FeatureGroup::ALL[group].width();
            group += 1;
        }
        start..start + self.width()
    }

    /// The name used in messages, such as `local positions`.
    pub const fn name(self) -> &'static str {
        match self {
            FeatureGroup::RootYaw => "root yaw",
            FeatureGroup::RootVelocity => "root velocity",
            FeatureGroup::RootHeight => "root height",
            FeatureGroup::LocalPositions => "local positions",
            FeatureGroup::Rotations => "rotations",
            FeatureGroup::Velocities => "velocities",
            FeatureGroup::FootContact => "foot contact",
        }
    }

    /// The group that a feature belongs to; `None` past the end of the vector.
    pub fn of(feature: usize) -> Option<FeatureGroup> {
        FeatureGroup::ALL
            .into_iter()
            .find(|group| group.range().contains(&feature))
    }
}

/// The joints of [`FeatureGroup::FootContact`], in its order.
pub const FOOT_CONTACT_JOINTS: [Joint; 4] = [
    Joint::LeftAnkle,
    Joint::LeftFoot,
    Joint::RightAnkle,
    Joint::RightFoot,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_tile_the_263_features() {
        assert_eq!(POSE_FEATURES, 263);
        let mut end = 0;
        for group in FeatureGroup::ALL {
            assert_eq!(group.range().start, end, "{}", group.name());
            end = group.range().end;
            assert_eq!(FeatureGroup::of(end - 1), Some(group));
        }
        assert_eq!(end, POSE_FEATURES);
        assert_eq!(FeatureGroup::of(POSE_FEATURES), None);
    }

    #[test]
    fn boundaries_are_those_of_humanml3d() {
        assert_eq!(FeatureGroup::LocalPositions.range(), 4..67);
        assert_eq!(FeatureGroup::Rotations.range(), 67..193);
        assert_eq!(FeatureGroup::Velocities.range(), 193..259);
        assert_eq!(FeatureGroup::FootContact.range(), 259..263);
    }
}
