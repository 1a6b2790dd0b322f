//! Mirror images of pose features.

use lamogen_motion::{FOOT_CONTACT_JOINTS, FeatureGroup, Joint, POSE_FEATURES};

/// The mapping from a row of pose features to the row of the mirrored motion, in which left and right are exchanged
/// and x is negated: `mirrored[i] = row[source[i]] * sign[i]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Mirror {
    source: [usize; POSE_FEATURES],
    sign: [f32; POSE_FEATURES],
}

/// The signs by which mirroring in x multiplies the coordinates of a point.
const POINT: [f32; 3] = [-1.0, 1.0, 1.0];
/// The signs by which mirroring in x multiplies the first two columns of a rotation: R becomes M R M, with
/// M = diag(-1, 1, 1).
const COLUMNS: [f32; 6] = [1.0, -1.0, -1.0, -1.0, 1.0, 1.0];

impl Default for Mirror {
    fn default() -> Self {
        Mirror::new()
    }
}

impl Mirror {
    /// Returns the mirror mapping of HumanML3D's features.
    pub fn new() -> Mirror {
        let mut mirror = Mirror {
            source: std::array::from_fn(|feature| feature),
            sign: [1.0; POSE_FEATURES],
        };
        // A turn to the left becomes a turn to the right; of the velocity, x changes its sign and z does not.
        mirror.sign[FeatureGroup::RootYaw.range().start] = -1.0;
        mirror.sign[FeatureGroup::RootVelocity.range().start] = -1.0;
        mirror.map_joints(FeatureGroup::LocalPositions, &Joint::ALL[1..], &POINT);
        mirror.map_joints(FeatureGroup::Rotations, &Joint::ALL[1..], &COLUMNS);
        mirror.map_joints(FeatureGroup::Velocities, &Joint::ALL, &POINT);
        mirror.map_joints(FeatureGroup::FootContact, &FOOT_CONTACT_JOINTS, &[1.0]);
        mirror
    }

    /// Returns the mirror mapping that a file holds. It is `None` unless every feature occurs once in `source` and
    /// every sign is 1 or -1.
    pub(crate) fn from_arrays(source: &[i32], sign: &[f32]) -> Option<Mirror> {
        let source: Vec<usize> = source.iter().map(|&i| i as usize).collect();
        let mut sorted = source.clone();
        sorted.sort_unstable();
        let is_permutation = sorted.into_iter().eq(0..POSE_FEATURES);
        let are_signs = sign.iter().all(|sign| sign.abs() == 1.0);
        match is_permutation && are_signs {
            true => Some(Mirror {
                source: source.try_into().ok()?,
                sign: sign.try_into().ok()?,
            }),
            false => None,
        }
    }

    /// Returns, for every feature of the mirror image, the index of the original feature that it is computed from.
    pub fn source(&self) -> &[usize; POSE_FEATURES] {
        &self.source
    }

    /// Returns the factor of every feature of the mirror image: 1 or -1.
    pub fn sign(&self) -> &[f32; POSE_FEATURES] {
        &self.sign
    }

    /// Returns the mirror image of a row.
    pub fn apply(&self, row: &[f32; POSE_FEATURES]) -> [f32; POSE_FEATURES] {
        std::array::from_fn(|feature| row[self.source[feature]] * self.sign[feature])
    }

    /// Sets the mapping of a feature group that has `signs.len()` values for each of `joints`.
    fn map_joints(&mut self, group: FeatureGroup, joints: &[Joint], signs: &[f32]) {
        let start = group.range().start;
        for (index, joint) in joints.iter().enumerate() {
            let other = joints.iter().position(|other| *other == joint.mirrored());
            let other = other.expect("a group has both sides of the body");
            for (value, &sign) in signs.iter().enumerate() {
                let feature = start + index * signs.len() + value;
                self.source[feature] = start + other * signs.len() + value;
                self.sign[feature] = sign;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::walk;
    use lamogen_motion::encode_canonical;

    #[test]
    fn mirrored_features_are_those_of_the_mirrored_motion() {
        let poses = walk(7, 120);
        let mirrored: Vec<_> = poses
            .iter()
            .map(|pose| {
                Joint::ALL.map(|joint| {
                    let [x, y, z] = pose[joint.mirrored().index()];
                    [-x, y, z]
                })
            })
            .collect();
        let mirror = Mirror::new();
        let expected = encode_canonical(&mirrored);
        let rows = encode_canonical(&poses);
        let mut changed = 0.0f32;
        for (row, expected) in rows.iter().zip(&expected) {
            for (feature, (found, expected)) in mirror.apply(row).iter().zip(expected).enumerate() {
                assert!(
                    (found - expected).abs() < 2e-5,
                    "feature {feature}: {found} instead of {expected}"
                );
                changed = changed.max((row[feature] - expected).abs());
            }
        }
        assert!(changed > 0.1, "the motion should not be symmetric");
    }

    #[test]
    fn mirroring_twice_changes_nothing() {
        let mirror = Mirror::new();
        let row = std::array::from_fn(|feature| feature as f32 + 1.0);
        assert_eq!(mirror.apply(&mirror.apply(&row)), row);
        assert_ne!(mirror.apply(&row), row);
    }

    #[test]
    fn a_mirror_of_a_file_takes_every_feature_once() {
        let mirror = Mirror::new();
        let source: Vec<i32> = mirror.source.iter().map(|&i| i as i32).collect();
        assert_eq!(
            Mirror::from_arrays(&source, &mirror.sign),
            Some(mirror.clone())
        );
        let mut twice = source.clone();
        twice[3] = 4;
        assert_eq!(Mirror::from_arrays(&twice, &mirror.sign), None);
        let mut scaled = mirror.sign;
        scaled[3] = 0.5;
        assert_eq!(Mirror::from_arrays(&source, &scaled), None);
        assert_eq!(Mirror::from_arrays(&source[1..], &mirror.sign), None);
        let negative: Vec<i32> = source.iter().map(|i| -i).collect();
        assert_eq!(Mirror::from_arrays(&negative, &mirror.sign), None);
    }
}
