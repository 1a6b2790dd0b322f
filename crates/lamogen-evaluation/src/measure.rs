//! Measurement of a motion: of the rig that users get, or of the motion's own joints.
//!
//! ```text
//! Motion ──rotations──▶ BVH ──read back──▶ MeasuredMotion ──▶ BodyMeasurements, Laban features, pose features
//! ```

use lamogen::files::bvh::{self, BvhOptions, read_text};
use lamogen::files::{ReadOptions, UpAxis};
use lamogen::motion::{BoneDrift, FootSliding, Jitter, JointTurning, encode_canonical};
use lamogen::{Joint, Motion};

use super::record::{BodyMeasurements, JointTurnMeasurements, TurnMeasurements};

/// The value of `--measure`: the form of a motion that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum MeasurementTarget {
    /// The file that users get: the motion as BVH, read back.
    Rig,
    /// The motion's joints as they are generated; its bones change their length.
    Joints,
}

impl MeasurementTarget {
    /// Returns the value as a word.
    pub fn name(self) -> &'static str {
        match self {
            MeasurementTarget::Rig => "rig",
            MeasurementTarget::Joints => "joints",
        }
    }

    /// Returns a motion in the form that is measured, or why there is none.
    pub fn measured_motion(self, motion: &Motion) -> Result<MeasuredMotion, String> {
        match self {
            MeasurementTarget::Rig => write_and_read_back(motion),
            MeasurementTarget::Joints => Ok(MeasuredMotion {
                motion: motion.clone(),
                turning: JointTurning::of(&motion.rotations()),
            }),
        }
    }
}

/// Writes a motion as BVH and reads it back.
fn write_and_read_back(motion: &Motion) -> Result<MeasuredMotion, String> {
    let options = BvhOptions::default();
    let text = bvh::text(&motion.rotations().into_owned().into(), &options);
    // Unit and axis are known. They must not be guessed, since the guess would be wrong for a body that lies or grows.
    let known = ReadOptions {
        unit: Some(options.unit),
        up: Some(UpAxis::Y),
        ..ReadOptions::default()
    };
    let read = read_text(&text, &known, "the motion's BVH").map_err(|error| error.to_string())?;
    Ok(MeasuredMotion {
        turning: read.turning.expect("a BVH has rotations"),
        motion: read.motion,
    })
}

/// A motion in the form that is measured.
pub struct MeasuredMotion {
    pub motion: Motion,
    turning: JointTurning,
}

impl MeasuredMotion {
    /// Returns the pose features for the evaluator. If the motion has pose features, these are returned. Otherwise they
    /// are computed from the joints, which are put on the ground; they then have one row less than there are frames.
    pub fn features(&self) -> Vec<f32> {
        match self.motion.features() {
            Some(rows) => rows.as_flattened().to_vec(),
            None => encode_canonical(self.motion.joints()).into_flattened(),
        }
    }

    /// Returns the measurements of the joints.
    pub fn body(&self) -> BodyMeasurements {
        let motion = &self.motion;
        let (sliding, jitter) = (FootSliding::of(motion), Jitter::of(motion));
        BodyMeasurements {
            sliding: sliding.ratio.into(),
            sliding_speed: sliding.speed.into(),
            ankles: jitter.ankles.into(),
            jerk: jitter.jerk.into(),
            drift: BoneDrift::of(motion).largest().into(),
            below_floor: below_floor(motion),
            turning: turning(&self.turning),
        }
    }
}

/// The angle in degrees between two frames above which a turn of the pelvis counts as a snap: nobody spins by 3 turns a
/// second.
const SNAP: f32 = 60.0;

/// Selects the measurements of how far joints turn.
fn turning(turning: &JointTurning) -> TurnMeasurements {
    let joint_measurements = |joint: Joint| JointTurnMeasurements {
        mean: turning.mean(joint).into(),
        largest: turning.largest(joint).degrees.into(),
    };
    TurnMeasurements {
        mean: turning.mean_without_pelvis().into(),
        largest: turning.largest_without_pelvis().degrees.into(),
        pelvis: turning.largest(Joint::Pelvis).degrees.into(),
        pelvis_snaps: turning.snaps(Joint::Pelvis, SNAP),
        spine3: joint_measurements(Joint::Spine3),
        neck: joint_measurements(Joint::Neck),
        left_shoulder: joint_measurements(Joint::LeftShoulder),
        right_shoulder: joint_measurements(Joint::RightShoulder),
    }
}

/// Returns how deep the deepest joint is below the floor, y = 0, in metres: the 99th percentile over frames.
fn below_floor(motion: &Motion) -> f64 {
    let depths = motion.joints().iter().map(|pose| {
        let depths = pose.iter().map(|place| -f64::from(place[1]));
        depths.fold(0.0, f64::max)
    });
    quantile(depths.collect(), 0.99).unwrap_or(0.0)
}

/// Returns the quantile of values for a fraction from 0 to 1, with linear interpolation, as in NumPy.
pub fn quantile(mut values: Vec<f64>, fraction: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let place = fraction * last as f64;
    let (below, above) = (
        values[place.floor() as usize],
        values[place.ceil() as usize],
    );
    Some(below + (above - below) * place.fract())
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen::JOINTS;
    use lamogen::motion::RestPose;

    /// Makes a motion of HumanML3D's body in its T-pose with the feet on the ground; `place` may move each joint.
    fn standing(frames: usize, place: impl Fn(usize, Joint, [f32; 3]) -> [f32; 3]) -> Motion {
        let rest = RestPose::humanml3d();
        let pose = |frame: usize| {
            let mut pose = [[0.0, 0.97, 0.0]; JOINTS];
            for joint in Joint::ALL {
                if let Some(parent) = joint.parent() {
                    let (above, offset) = (pose[parent.index()], rest.offset(joint));
                    pose[joint.index()] = std::array::from_fn(|axis| above[axis] + offset[axis]);
                }
            }
            Joint::ALL.map(|joint| place(frame, joint, pose[joint.index()]))
        };
        Motion::from_joints((0..frames).map(pose).collect()).unwrap()
    }

    #[test]
    fn a_rig_has_the_joints_of_a_motion_with_rigid_bones() {
        let motion = standing(30, |frame, _, [x, y, z]| [x, y, z + 0.01 * frame as f32]);
        let rig = MeasurementTarget::Rig.measured_motion(&motion).unwrap();
        assert!(rig.motion.distance(&motion) < 1e-4);
        assert_eq!(rig.features().len(), 29 * 263);
        let joints = MeasurementTarget::Joints.measured_motion(&motion).unwrap();
        assert_eq!(joints.motion, motion);
        let [rig, joints] = [rig, joints].map(|subject| subject.body());
        assert!((rig.sliding_speed - 0.2).abs() < 1e-3, "{rig:?}");
        assert!((rig.sliding_speed - joints.sliding_speed).abs() < 1e-3);
        assert!(rig.turning.largest < 0.1 && rig.turning.pelvis_snaps == 0);
    }

    #[test]
    fn a_rig_keeps_its_bones_and_its_snaps() {
        // A forearm grows, and the body faces the other way from frame 10 on.
        let motion = standing(20, |frame, joint, [x, y, z]| {
            let grown = match joint {
                Joint::LeftWrist => x + 0.01 * frame as f32,
                _ => x,
            };
            let side = if frame < 10 { 1.0 } else { -1.0 };
            [side * grown, y, side * z]
        });
        let [rig, joints] = [MeasurementTarget::Rig, MeasurementTarget::Joints]
            .map(|measure| measure.measured_motion(&motion).unwrap().body());
        assert!(joints.drift > 0.09, "{joints:?}");
        assert!(rig.drift < 1e-4, "{rig:?}");
        for body in [rig, joints] {
            assert_eq!(body.turning.pelvis_snaps, 1);
            assert!((body.turning.pelvis - 180.0).abs() < 0.1, "{body:?}");
        }
    }

    #[test]
    fn depth_ignores_one_frame_in_a_hundred() {
        // Both feet of the T-pose are 9 mm below the ground, and deep below it at one frame of 201.
        let deepest = |motion: &Motion| {
            let lowest = motion.joints()[0].iter().map(|place| place[1]);
            -f64::from(lowest.fold(0.0, f32::min))
        };
        let motion = standing(201, |frame, _, [x, y, z]| match frame {
            100 => [x, y - 0.5, z],
            _ => [x, y, z],
        });
        let found = below_floor(&motion);
        assert!(found > 0.0 && (found - deepest(&motion)).abs() < 1e-6);
        let above = standing(5, |_, _, [x, y, z]| [x, y + 1.0, z]);
        assert_eq!(below_floor(&above), 0.0);
    }

    #[test]
    fn quantiles_are_those_of_numpy() {
        let values = || vec![4.0, 1.0, 3.0, 2.0];
        assert_eq!(quantile(values(), 0.0), Some(1.0));
        assert_eq!(quantile(values(), 0.5), Some(2.5));
        assert_eq!(quantile(values(), 0.75), Some(3.25));
        assert_eq!(quantile(values(), 1.0), Some(4.0));
        assert_eq!(quantile(vec![], 0.5), None);
    }

    #[test]
    fn a_motion_that_fits_no_file_does_not_panic() {
        let wild = standing(20, |frame, joint, place| {
            let far = 1e30 * (frame * 7 + joint.index()) as f32;
            place.map(|x| x * far)
        });
        // The result is an error, or measurements.
        if let Ok(measured) = MeasurementTarget::Rig.measured_motion(&wild) {
            measured.body();
        }
        let flat = standing(20, |_, _, _| [0.0; 3]);
        if let Ok(measured) = MeasurementTarget::Rig.measured_motion(&flat) {
            assert_eq!(measured.body().turning.largest, 0.0);
        }
    }
}
