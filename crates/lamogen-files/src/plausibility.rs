//! What is strange about a body that was read, though it may be meant.

use std::fmt;

use glam::DVec3;
use lamogen_motion::{JOINTS, Joint, Motion};

/// Something strange throughout a motion. The motion is read as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImportNotice {
    /// The head is below the pelvis and the ankles are above it.
    UpsideDown,
    /// Toes point and knees bend backwards: the motion is a mirror image whose joints kept their names.
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

/// The share of frames that makes a thing be so throughout.
const THROUGHOUT: f64 = 0.95;

/// What is strange about a motion.
pub(crate) fn notices(motion: &Motion) -> Vec<ImportNotice> {
    let poses = motion.joints();
    let throughout = |is_so: fn(&Pose) -> bool| {
        let count = poses.iter().filter(|pose| is_so(&Pose(pose))).count();
        count as f64 >= THROUGHOUT * poses.len() as f64
    };
    let mut notices = Vec::new();
    if throughout(|pose| pose.is_upside_down()) {
        notices.push(ImportNotice::UpsideDown);
    }
    let bent = poses.iter().filter(|pose| Pose(pose).knees().is_some());
    let backwards = { bent.clone() }
        .filter(|pose| Pose(pose).knees().is_some_and(|ahead| ahead < 0.0))
        .count();
    let knees_bend_backwards = backwards as f64 >= THROUGHOUT * bent.count() as f64;
    if throughout(|pose| pose.has_toes_behind()) && knees_bend_backwards {
        notices.push(ImportNotice::Mirrored);
    }
    notices
}

struct Pose<'a>(&'a [[f32; 3]; JOINTS]);

impl Pose<'_> {
    fn at(&self, joint: Joint) -> DVec3 {
        DVec3::from(self.0[joint.index()].map(f64::from))
    }

    fn is_upside_down(&self) -> bool {
        let pelvis = self.at(Joint::Pelvis).y;
        let ankles = [Joint::LeftAnkle, Joint::RightAnkle].map(|ankle| self.at(ankle).y);
        self.at(Joint::Head).y < pelvis && ankles.iter().all(|ankle| *ankle > pelvis)
    }

    /// Where the trunk faces, by the names of left and right.
    fn facing(&self) -> DVec3 {
        let across = self.at(Joint::LeftHip) - self.at(Joint::RightHip)
            + self.at(Joint::LeftShoulder)
            - self.at(Joint::RightShoulder);
        let up = self.at(Joint::Neck) - self.at(Joint::Pelvis);
        across.cross(up).normalize_or_zero()
    }

    fn has_toes_behind(&self) -> bool {
        let facing = self.facing();
        let toes = [
            (Joint::LeftAnkle, Joint::LeftFoot),
            (Joint::RightAnkle, Joint::RightFoot),
        ];
        let ahead: f64 = { toes.iter() }
            .map(|&(ankle, foot)| (self.at(foot) - self.at(ankle)).dot(facing))
            .sum();
        // Feet without a length point nowhere.
        ahead < -0.04
    }

    /// How far the more bent knee is ahead of the line from hip to ankle, in metres; none where no knee is bent.
    fn knees(&self) -> Option<f64> {
        const BENT: f64 = 0.03;
        let facing = self.facing();
        let legs = [
            [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle],
            [Joint::RightHip, Joint::RightKnee, Joint::RightAnkle],
        ];
        let ahead = legs.map(|leg| {
            let [hip, knee, ankle] = leg.map(|joint| self.at(joint));
            let line = (ankle - hip).normalize_or_zero();
            let off = (knee - hip) - (knee - hip).dot(line) * line;
            off.dot(facing)
        });
        let most = match ahead[0].abs() > ahead[1].abs() {
            true => ahead[0],
            false => ahead[1],
        };
        (most.abs() > BENT).then_some(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::RestPose;

    /// A body that stands with bent knees, in the same pose throughout.
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

    fn of(change: impl Fn([f32; 3]) -> [f32; 3]) -> Vec<ImportNotice> {
        let poses = standing().into_iter().map(|pose| pose.map(&change));
        notices(&Motion::from_joints(poses.collect()).unwrap())
    }

    #[test]
    fn a_body_that_stands_is_not_strange_wherever_it_faces() {
        assert_eq!(of(|point| point), []);
        assert_eq!(of(|[x, y, z]| [z, y, -x]), []);
        // Lying on its back.
        assert_eq!(of(|[x, y, z]| [x, z, -y]), []);
    }

    #[test]
    fn what_stands_on_its_head_or_in_a_mirror_is_noticed() {
        assert_eq!(of(|[x, y, z]| [x, -y, -z]), [ImportNotice::UpsideDown]);
        assert_eq!(of(|[x, y, z]| [-x, y, z]), [ImportNotice::Mirrored]);
        assert_eq!(
            of(|[x, y, z]| [x, -y, z]),
            [ImportNotice::UpsideDown, ImportNotice::Mirrored]
        );
    }

    #[test]
    fn what_is_so_only_for_a_while_is_not_noticed() {
        let mut poses = standing();
        for pose in &mut poses[..10] {
            *pose = pose.map(|[x, y, z]| [x, -y, -z]);
        }
        assert_eq!(notices(&Motion::from_joints(poses).unwrap()), []);
    }
}
