//! Checks for unusual properties of a body that was read. They may be intended.

use std::fmt;

use glam::DVec3;
use lamogen_motion::{JOINTS, Joint, LEGS, Motion};

/// An unusual property that a motion has throughout. The motion is read without any change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImportNotice {
    /// The head is below the pelvis and the ankles are above it.
    UpsideDown,
    /// Toes point and knees bend backwards: the motion is a mirror image, but its joints kept their names.
    Mirrored,
}

impl fmt::Display for ImportNotice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ImportNotice::UpsideDown => {
                "the body stands on its head throughout; if it should not, another axis points up, such as -y"
            }
            ImportNotice::Mirrored => {
                "toes point and knees bend backwards throughout: left and right may have been exchanged"
            }
        })
    }
}

/// The fraction of frames in which a property must hold to count as holding throughout.
const THROUGHOUT: f64 = 0.95;

/// Returns the unusual properties of a motion.
pub(crate) fn notices(motion: &Motion) -> Vec<ImportNotice> {
    let poses = motion.joints();
    let throughout = |has_property: fn(&Pose) -> bool| {
        let count = poses
            .iter()
            .filter(|pose| has_property(&Pose(pose)))
            .count();
        count as f64 >= THROUGHOUT * poses.len() as f64
    };
    let mut notices = Vec::new();
    if throughout(|pose| pose.is_upside_down()) {
        notices.push(ImportNotice::UpsideDown);
    }
    let bent = poses
        .iter()
        .filter(|pose| Pose(pose).knee_offset().is_some());
    let backwards = { bent.clone() }
        .filter(|pose| Pose(pose).knee_offset().is_some_and(|offset| offset < 0.0))
        .count();
    let knees_bend_backwards = backwards as f64 >= THROUGHOUT * bent.count() as f64;
    if throughout(|pose| pose.has_toes_behind()) && knees_bend_backwards {
        notices.push(ImportNotice::Mirrored);
    }
    notices
}

/// The joint positions of one frame, `[joint][axis]`, in metres.
struct Pose<'a>(&'a [[f32; 3]; JOINTS]);

impl Pose<'_> {
    fn position(&self, joint: Joint) -> DVec3 {
        DVec3::from(self.0[joint.index()].map(f64::from))
    }

    /// Returns whether the head is below the pelvis and both ankles are above it.
    fn is_upside_down(&self) -> bool {
        let pelvis = self.position(Joint::Pelvis).y;
        let ankles = [Joint::LeftAnkle, Joint::RightAnkle].map(|ankle| self.position(ankle).y);
        self.position(Joint::Head).y < pelvis && ankles.iter().all(|ankle| *ankle > pelvis)
    }

    /// Returns the direction that the front of the trunk faces, derived from the left and right hips and shoulders.
    fn facing_direction(&self) -> DVec3 {
        let across = self.position(Joint::LeftHip) - self.position(Joint::RightHip)
            + self.position(Joint::LeftShoulder)
            - self.position(Joint::RightShoulder);
        let up = self.position(Joint::Neck) - self.position(Joint::Pelvis);
        across.cross(up).normalize_or_zero()
    }

    /// Returns whether the feet point backwards on average.
    fn has_toes_behind(&self) -> bool {
        let facing = self.facing_direction();
        let toes = [
            (Joint::LeftAnkle, Joint::LeftFoot),
            (Joint::RightAnkle, Joint::RightFoot),
        ];
        let ahead: f64 = { toes.iter() }
            .map(|&(ankle, foot)| (self.position(foot) - self.position(ankle)).dot(facing))
            .sum();
        // Feet without length have no direction.
        ahead < -0.04
    }

    /// Returns the distance of the more bent knee in front of the line from hip to ankle, in metres: negative behind the
    /// line, and `None` if no knee is bent.
    fn knee_offset(&self) -> Option<f64> {
        /// The offset in metres above which a knee counts as bent.
        const MIN_BENT_OFFSET: f64 = 0.03;
        let facing = self.facing_direction();
        let ahead = LEGS.map(|leg| {
            let [hip, knee, ankle] = leg.map(|joint| self.position(joint));
            let line = (ankle - hip).normalize_or_zero();
            let off = (knee - hip) - (knee - hip).dot(line) * line;
            off.dot(facing)
        });
        let most = match ahead[0].abs() > ahead[1].abs() {
            true => ahead[0],
            false => ahead[1],
        };
        (most.abs() > MIN_BENT_OFFSET).then_some(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::RestPose;

    /// Returns the poses of a body that stands still with bent knees.
    fn standing() -> Vec<[[f32; 3]; JOINTS]> {
        let rest = RestPose::humanml3d();
        let mut pose = [[0.0f32; 3]; JOINTS];
        for joint in Joint::ALL {
            let offset = rest.offset(joint);
            let above = joint
                .parent()
                .map_or([0.0, 1.0, 0.0], |parent| pose[parent.index()]);
            pose[joint.index()] = std::array::from_fn(|axis| above[axis] + offset[axis]);
        }
        for knee in [Joint::LeftKnee, Joint::RightKnee] {
            pose[knee.index()][2] += 0.1;
        }
        vec![pose; 20]
    }

    fn notices_after(change: impl Fn([f32; 3]) -> [f32; 3]) -> Vec<ImportNotice> {
        let poses = standing().into_iter().map(|pose| pose.map(&change));
        notices(&Motion::from_joints(poses.collect()).unwrap())
    }

    #[test]
    fn a_standing_body_has_no_notice_whatever_its_direction() {
        assert_eq!(notices_after(|point| point), []);
        assert_eq!(notices_after(|[x, y, z]| [z, y, -x]), []);
        // Lying on its back.
        assert_eq!(notices_after(|[x, y, z]| [x, z, -y]), []);
    }

    #[test]
    fn upside_down_and_mirrored_bodies_are_noticed() {
        assert_eq!(
            notices_after(|[x, y, z]| [x, -y, -z]),
            [ImportNotice::UpsideDown]
        );
        assert_eq!(
            notices_after(|[x, y, z]| [-x, y, z]),
            [ImportNotice::Mirrored]
        );
        assert_eq!(
            notices_after(|[x, y, z]| [x, -y, z]),
            [ImportNotice::UpsideDown, ImportNotice::Mirrored]
        );
    }

    #[test]
    fn a_property_of_only_some_frames_is_not_noticed() {
        let mut poses = standing();
        for pose in &mut poses[..10] {
            *pose = pose.map(|[x, y, z]| [x, -y, -z]);
        }
        assert_eq!(notices(&Motion::from_joints(poses).unwrap()), []);
    }
}
