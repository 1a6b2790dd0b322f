//! Loops, and the travel of a motion along the ground.
//!
//! ```text
//! Motion ──keyframes(rate)──▶ rotations at that rate (a loop: with the frame that closes it)
//!                                  │
//!                                  └── RootMotion: the path along the ground stays in the pelvis, moves to a root
//!                                      above it, or is removed
//! ```

use std::f64::consts::PI;
use std::fmt;
use std::str::FromStr;

use glam::{DQuat, DVec3};

use crate::features::{FeatureGroup, POSE_FEATURES};
use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::rotations::Rotations;
use crate::skeleton::JOINTS;

/// Where a file keeps the travel of a motion along the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum RootMotion {
    /// In the pelvis (the hips), as animators and Blender expect.
    #[default]
    Hips,
    /// In a node above the pelvis, as game engines expect that move the character by it (root motion).
    Root,
    /// Nowhere: the body stays in place. Feet that stand then slide back under it, as on a treadmill.
    None,
}

impl RootMotion {
    /// Returns the name: `hips`, `root` or `none`.
    pub fn name(self) -> &'static str {
        match self {
            RootMotion::Hips => "hips",
            RootMotion::Root => "root",
            RootMotion::None => "none",
        }
    }

    /// Returns what files say of a travel that is not in the hips.
    pub fn note(self) -> Option<&'static str> {
        match self {
            RootMotion::Hips => None,
            RootMotion::Root => Some("root: the node above the hips travels"),
            RootMotion::None => Some("none: the body stays in place, and planted feet slide"),
        }
    }
}

impl fmt::Display for RootMotion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for RootMotion {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let all = [RootMotion::Hips, RootMotion::Root, RootMotion::None];
        let found = all.into_iter().find(|place| place.name() == name);
        found.ok_or_else(|| format!("expected hips, root or none, found {name}"))
    }
}

/// The standard deviation of the Gaussian that smooths a path along the ground, in seconds. The sway of the hips from step
/// to step is faster and stays in the hips.
const SMOOTHING_SECONDS: f64 = 0.3;
/// Weights beyond so many standard deviations are left out.
const SMOOTHING_REACH: f64 = 3.0;

/// Returns the path of a body along the ground: the positions of its pelvis, `[x, y, z]`, smoothed by a Gaussian of 0.3 s,
/// as `[x, z]` at every frame.
///
/// The path begins and ends where the pelvis does. `loop_travel` is that of [`Motion::loop_travel`], if the positions are
/// those of a loop and of the frame that closes it; the path of a loop has no ends.
pub fn ground_path(
    positions: &[[f32; 3]],
    frames_per_second: f32,
    loop_travel: Option<[f32; 2]>,
) -> Vec<[f32; 2]> {
    let points: Vec<[f64; 2]> = { positions.iter() }
        .map(|[x, _, z]| [*x, *z].map(f64::from))
        .collect();
    let Some(last) = points.len().checked_sub(1).filter(|last| *last > 0) else {
        return positions.iter().map(|[x, _, z]| [*x, *z]).collect();
    };
    let deviation = SMOOTHING_SECONDS * f64::from(frames_per_second);
    let reach = (SMOOTHING_REACH * deviation).ceil() as isize;
    // A place before the first frame or after the last one.
    let at = |frame: isize| -> [f64; 2] {
        let (length, frame) = (last as isize, frame);
        match loop_travel {
            Some(travel) => {
                let cycle = frame.div_euclid(length);
                let point = points[frame.rem_euclid(length) as usize];
                std::array::from_fn(|axis| point[axis] + cycle as f64 * f64::from(travel[axis]))
            }
            None => {
                // Beyond an end, the path goes on as it came, turned by half a circle about the end.
                let mirror = |end: usize, frame: isize| -> [f64; 2] {
                    let inside = (2 * end as isize - frame).clamp(0, length) as usize;
                    std::array::from_fn(|axis| 2.0 * points[end][axis] - points[inside][axis])
                };
                match frame {
                    ..0 => mirror(0, frame),
                    _ if frame > length => mirror(last, frame),
                    _ => points[frame as usize],
                }
            }
        }
    };
    let weights: Vec<f64> = (-reach..=reach)
        .map(|step| (-0.5 * (step as f64 / deviation).powi(2)).exp())
        .collect();
    let total: f64 = weights.iter().sum();
    (0..=last as isize)
        .map(|frame| {
            let mut sum = [0.0; 2];
            for (step, weight) in (-reach..=reach).zip(&weights) {
                let point = at(frame + step);
                for axis in 0..2 {
                    sum[axis] += weight * point[axis];
                }
            }
            sum.map(|value| (value / total) as f32)
        })
        .collect()
}

/// A loop that travels by less than this in a cycle, in metres, is made one that does not travel.
const LEAST_TRAVEL: f64 = 0.1;

/// Closes the path of pose features (not normalised) that repeat: the row after the last one is the first one.
///
/// The body then faces at the end of a cycle as at its beginning, or has turned round whole times, and does not travel at
/// all if it travels by less than 10 cm. What is left over is spread evenly over the frames. Returns the travel of a cycle,
/// `[x, z]` in metres; see [`Motion::loop_travel`].
pub fn close_path(features: &mut [[f32; POSE_FEATURES]]) -> [f32; 2] {
    let frames = features.len() as f64;
    let yaw = FeatureGroup::RootYaw.range().start;
    let velocity = FeatureGroup::RootVelocity.range().start;
    // Pose features have half the angle, so a whole turn is π.
    let turned: f64 = features.iter().map(|row| f64::from(row[yaw])).sum();
    let excess = turned - (turned / PI).round() * PI;
    for row in features.iter_mut() {
        row[yaw] -= (excess / frames) as f32;
    }
    // The heading after each step, in which the velocity of the step is given.
    let headings = |features: &[[f32; POSE_FEATURES]]| -> Vec<DQuat> {
        let mut half_heading = 0.0;
        let after = features.iter().map(|row| {
            half_heading += f64::from(row[yaw]);
            DQuat::from_rotation_y(-2.0 * half_heading)
        });
        after.collect()
    };
    let headings = headings(features);
    let travel: DVec3 = { features.iter().zip(&headings) }
        .map(|(row, heading)| {
            let [x, z] = [row[velocity], row[velocity + 1]].map(f64::from);
            *heading * DVec3::new(x, 0.0, z)
        })
        .sum();
    if travel.length() >= LEAST_TRAVEL {
        return [travel.x as f32, travel.z as f32];
    }
    for (row, heading) in features.iter_mut().zip(headings) {
        let step = heading.inverse() * (travel / frames);
        row[velocity] -= step.x as f32;
        row[velocity + 1] -= step.z as f32;
    }
    [0.0; 2]
}

/// A motion as files hold it: rotations at the frame rate of the file, with the travel where [`RootMotion`] says.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframes {
    /// The rotations and the positions of the pelvis relative to the root. Those of a loop may end with the frame that
    /// closes it, which is the first frame again, moved on by the travel.
    pub rotations: Rotations,
    /// The positions of the root at every frame in metres, if the root travels.
    pub root_path: Option<Vec<[f32; 3]>>,
}

impl From<Rotations> for Keyframes {
    /// Takes rotations whose pelvis holds the travel.
    fn from(rotations: Rotations) -> Keyframes {
        Keyframes {
            rotations,
            root_path: None,
        }
    }
}

impl Keyframes {
    /// Moves the travel of rotations to where `root_motion` says. `loop_travel` is as for [`ground_path`].
    pub fn new(
        rotations: Rotations,
        root_motion: RootMotion,
        loop_travel: Option<[f32; 2]>,
    ) -> Keyframes {
        if root_motion == RootMotion::Hips {
            return rotations.into();
        }
        let path = ground_path(rotations.root(), rotations.frames_per_second(), loop_travel);
        let origin = match root_motion {
            RootMotion::None => path[0],
            _ => [0.0; 2],
        };
        let pelvis = rotations.root().iter().zip(&path);
        let pelvis = pelvis.map(|([x, y, z], [along_x, along_z])| {
            [x - along_x + origin[0], *y, z - along_z + origin[1]]
        });
        Keyframes {
            rotations: Rotations::new(
                rotations.rest().clone(),
                pelvis.collect(),
                rotations.local().to_vec(),
                rotations.frames_per_second(),
            ),
            root_path: (root_motion == RootMotion::Root)
                .then(|| path.into_iter().map(|[x, z]| [x, 0.0, z]).collect()),
        }
    }
}

/// Whether a loop ends with the frame that closes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopEnd {
    /// The last frame is the first one again, moved on by the travel. Formats with keyframes, such as glTF, need it, because
    /// their players jump from the last keyframe to the first.
    Closed,
    /// The last frame is one step before the first. Formats with frames, such as BVH, hold loops in this way.
    Open,
}

impl Motion {
    /// Returns the motion with a frame rate and its travel as files hold them.
    ///
    /// New frames lie on smooth curves through the motion's own ([`Rotations::resampled`]). The frame rate of a loop is
    /// changed so little that its cycle is a whole number of frames.
    ///
    /// # Panics
    ///
    /// If the frame rate is not a positive number.
    pub fn keyframes(&self, frames_per_second: f32, end: LoopEnd) -> Keyframes {
        let Some(travel) = self.loop_travel() else {
            let rotations = self.rotations().resampled(frames_per_second);
            return Keyframes::new(rotations, self.root_motion(), None);
        };
        let rate = loop_frame_rate(self.frames(), frames_per_second);
        let cycle = self.rotations().resampled_loop(travel, rate);
        let keyframes = Keyframes::new(cycle, self.root_motion(), Some(travel));
        match end {
            LoopEnd::Closed => keyframes,
            LoopEnd::Open => {
                let frames = keyframes.rotations.frames() - 1;
                Keyframes {
                    rotations: keyframes.rotations.first(frames),
                    root_path: keyframes.root_path.map(|path| path[..frames].to_vec()),
                }
            }
        }
    }

    /// Returns a loop played several times in a row, or `None` if the motion is no loop.
    ///
    /// # Panics
    ///
    /// If `cycles` is 0.
    pub fn repeated(&self, cycles: usize) -> Option<Motion> {
        assert!(cycles > 0, "a motion has at least one cycle");
        let travel = self.loop_travel()?;
        let frames = (0..cycles).flat_map(|cycle| {
            let shift = travel.map(|length| length * cycle as f32);
            self.joints().iter().map(move |pose| {
                let mut pose = *pose;
                for point in &mut pose {
                    point[0] += shift[0];
                    point[2] += shift[1];
                }
                pose
            })
        });
        let frames: Vec<[[f32; 3]; JOINTS]> = frames.collect();
        let motion = match self.is_rigid() {
            true => Motion::from_rotations(self.rotations().repeated(cycles, 0, travel)),
            false => Motion::from_joints(frames),
        };
        let motion = motion.expect("the frames of a motion are finite");
        Some(
            motion
                .with_copyright(self.copyright().map(str::to_owned))
                .with_root_motion(self.root_motion())
                .with_loop_travel(Some(travel.map(|length| length * cycles as f32))),
        )
    }

    /// Returns the joint positions as files of positions hold them: without the travel if [`root_motion`](Self::root_motion)
    /// says so, and else as they are.
    pub fn placed_joints(&self) -> Vec<[[f32; 3]; JOINTS]> {
        if self.root_motion() != RootMotion::None {
            return self.joints().to_vec();
        }
        let mut pelvis: Vec<[f32; 3]> = self.joints().iter().map(|pose| pose[0]).collect();
        let travel = self.loop_travel();
        if let Some([x, z]) = travel {
            pelvis.push([pelvis[0][0] + x, pelvis[0][1], pelvis[0][2] + z]);
        }
        let path = ground_path(&pelvis, FRAMES_PER_SECOND, travel);
        let poses = self.joints().iter().zip(&path);
        poses
            .map(|(pose, along)| {
                pose.map(|[x, y, z]| [x - along[0] + path[0][0], y, z - along[1] + path[0][1]])
            })
            .collect()
    }
}

/// Returns the frame rate nearest to the given one at which a loop of so many frames, at 20 a second, has a whole number of
/// frames.
pub fn loop_frame_rate(frames: usize, frames_per_second: f32) -> f32 {
    let seconds = frames as f64 / f64::from(FRAMES_PER_SECOND);
    let count = (seconds * f64::from(frames_per_second)).round().max(1.0);
    (count / seconds) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotations::RestPose;

    /// A body that goes along +Z at 1 m/s and sways to its sides, twice a second.
    fn walk(frames: usize) -> Motion {
        let root = (0..frames).map(|frame| {
            let time = frame as f32 / FRAMES_PER_SECOND;
            let sway = 0.03 * (2.0 * std::f32::consts::TAU * time).sin();
            [sway, 0.9, time]
        });
        let local = vec![[[0.0, 0.0, 0.0, 1.0]; JOINTS]; frames];
        let rotations = Rotations::new(
            RestPose::humanml3d(),
            root.collect(),
            local,
            FRAMES_PER_SECOND,
        );
        Motion::from_rotations(rotations).unwrap()
    }

    #[test]
    fn the_travel_of_a_walk_moves_to_the_root_and_the_sway_stays() {
        let motion = walk(60);
        for (motion, is_loop) in [
            (motion.clone(), false),
            (motion.with_loop_travel(Some([0.0, 3.0])), true),
        ] {
            let hips = motion.keyframes(20.0, LoopEnd::Open);
            assert_eq!(hips.root_path, None);
            let motion = motion.with_root_motion(RootMotion::Root);
            let root = motion.keyframes(20.0, LoopEnd::Open);
            let path = root.root_path.as_ref().unwrap();
            assert_eq!(path.len(), 60);
            for (frame, (place, pelvis)) in path.iter().zip(root.rotations.root()).enumerate() {
                let sum = [place[0] + pelvis[0], pelvis[1], place[2] + pelvis[2]];
                let whole = hips.rotations.root()[frame];
                for axis in 0..3 {
                    assert!((sum[axis] - whole[axis]).abs() < 1e-5, "{sum:?} {whole:?}");
                }
                // Only at the ends of a motion that is no loop the sway has no neighbours to be told by.
                if is_loop || (12..48).contains(&frame) {
                    assert!((pelvis[0] - whole[0]).abs() < 0.004, "{frame}: {pelvis:?}");
                    assert!(pelvis[2].abs() < 0.004, "{frame}: {pelvis:?}");
                }
            }
            let in_place = motion.with_root_motion(RootMotion::None);
            let joints = in_place.placed_joints();
            let rig = in_place.keyframes(20.0, LoopEnd::Open);
            for (pose, pelvis) in joints.iter().zip(rig.rotations.root()) {
                for axis in 0..3 {
                    assert!((pose[0][axis] - pelvis[axis]).abs() < 1e-5);
                }
                assert!(pelvis[2].abs() < 0.02, "{pelvis:?}");
            }
        }
    }

    #[test]
    fn loops_close_at_every_frame_rate() {
        let motion = walk(61).with_loop_travel(Some([0.0, 3.05]));
        for rate in [20.0, 24.0, 30.0, 60.0, 29.97] {
            let closed = motion.keyframes(rate, LoopEnd::Closed).rotations;
            let frames = closed.frames();
            let [first, last] = [closed.root()[0], closed.root()[frames - 1]];
            assert!((last[2] - first[2] - 3.05).abs() < 1e-4, "{last:?}");
            let seconds = (frames - 1) as f32 / closed.frames_per_second();
            assert!((seconds - 3.05).abs() < 1e-4, "{seconds}");
            assert!((closed.frames_per_second() - rate).abs() < 0.01 * rate);
            let open = motion.keyframes(rate, LoopEnd::Open).rotations;
            assert_eq!(open.root(), &closed.root()[..frames - 1]);
        }
        let twice = motion.repeated(2).unwrap();
        assert_eq!(
            (twice.frames(), twice.loop_travel()),
            (122, Some([0.0, 6.1]))
        );
        let step = twice.joints()[61][0][2] - twice.joints()[60][0][2];
        assert!((step - 0.05).abs() < 1e-5, "{step}");
        assert_eq!(walk(5).repeated(2), None);
    }
}
