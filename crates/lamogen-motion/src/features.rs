//! The layout of HumanML3D's 263 pose features (Guo et al. 2022, section 5).

use std::ops::Range;

use crate::skeleton::{JOINTS, Joint};

/// The number of pose features of a frame: 263.
pub const POSE_FEATURES: usize = FeatureGroup::FootContact.range().end;

/// A group of consecutive pose features.
///
/// Row `t` of the features describes the pose at frame `t` and the step from `t` to `t + 1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FeatureGroup {
    /// Half the change of heading from `t` to `t + 1`, in radians (1 value).
    RootYaw,
    /// Displacement of the root on the ground, x and z, in metres a frame, relative to the heading
    /// at `t + 1` (2 values).
    RootVelocity,
    /// Height of the root in metres (1 value).
    RootHeight,
    /// Positions of the 21 joints below the pelvis in metres, relative to the point on the
    /// ground below the root and to the heading at `t` (63 values).
    LocalPositions,
    /// Rotations of the same joints, six values each: the first two columns of the rotation matrix
    /// (126 values).
    Rotations,
    /// Displacement of all 22 joints from `t` to `t + 1` in metres, relative to the heading at `t`
    /// (66 values).
    Velocities,
    /// 1 for each of left ankle, left foot, right ankle and right foot that stands on the ground, else 0
    /// (4 values).
    FootContact,
}

impl FeatureGroup {
    /// All groups, in the order of the feature vector.
    pub const ALL: [FeatureGroup; 7] = [
        FeatureGroup::RootYaw,
        FeatureGroup::RootVelocity,
        FeatureGroup::RootHeight,
        FeatureGroup::LocalPositions,
        FeatureGroup::Rotations,
        FeatureGroup::Velocities,
        FeatureGroup::FootContact,
    ];

    /// Returns the number of features of the group.
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

    /// Returns the indices of the group's features in the feature vector.
    pub const fn range(self) -> Range<usize> {
        let mut start = 0;
        let mut group = 0;
        while group < self as usize {
            start += FeatureGroup::ALL[group].width();
            group += 1;
        }
        start..start + self.width()
    }

    /// Returns the name used in messages, such as `local positions`.
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

    /// Returns the group of a feature index, or `None` past the end of the vector.
    pub fn of(feature: usize) -> Option<FeatureGroup> {
        FeatureGroup::ALL
            .into_iter()
            .find(|group| group.range().contains(&feature))
    }
}

/// The joints of the four features of [`FeatureGroup::FootContact`], in their order.
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
