//! A recorded motion becomes a part of a composed one.

use glam::{DQuat, DVec3};
use lamogen_motion::{ARMS, FRAMES_PER_SECOND, JOINTS, Placement, Rotations, ground_path};

use super::recipe::Part;

impl Part {
    /// Changes a recorded motion as the part says. `speed` and `turn` (degrees) are what was drawn from their ranges, and
    /// `arms` is the motion from which the arms are taken.
    ///
    /// Returns none if too little of the motion is left.
    pub fn shape(
        &self,
        recorded: &Rotations,
        arms: Option<&Rotations>,
        speed: f32,
        turn: Option<f32>,
    ) -> Option<Rotations> {
        let frames = recorded.frames();
        let frame = |share: f32| (share * frames as f32).round() as usize;
        let [start, end] = self.span.map(frame);
        if end <= start + 1 {
            return None;
        }
        let mut part = recorded.between(start..end);
        if self.reversed {
            part = reversed(&part);
        }
        if speed != 1.0 {
            let slower = part.resampled(FRAMES_PER_SECOND / speed);
            part = moving(&part, slower.root().to_vec(), slower.local().to_vec());
        }
        if let Some(arms) = arms {
            part = with_arms(&part, arms);
        }
        if let Some(turn) = turn {
            part = bent(&part, turn);
        }
        if self.in_place {
            part = staying(&part);
        }
        Some(part)
    }
}

/// Returns the body of a motion with other places and rotations.
fn moving(motion: &Rotations, root: Vec<[f32; 3]>, local: Vec<LocalPose>) -> Rotations {
    Rotations::new(
        motion.rest().clone(),
        root,
        local,
        motion.frames_per_second(),
    )
}

/// Returns the motion with the arms of another, which runs forward and backward as often as it takes.
fn with_arms(motion: &Rotations, arms: &Rotations) -> Rotations {
    let there_and_back = (0..arms.frames()).chain((1..arms.frames().max(2) - 1).rev());
    let frames = there_and_back.cycle().map(|frame| &arms.local()[frame]);
    let local = motion.local().iter().zip(frames).map(|(pose, arms)| {
        let mut pose = *pose;
        for joint in ARMS.into_iter().flatten() {
            pose[joint.index()] = arms[joint.index()];
        }
        pose
    });
    moving(motion, motion.root().to_vec(), local.collect())
}

/// Returns the motion with time running backward.
fn reversed(motion: &Rotations) -> Rotations {
    let mut root = motion.root().to_vec();
    let mut local = motion.local().to_vec();
    root.reverse();
    local.reverse();
    moving(motion, root, local)
}

/// Bends the path along its length, so that the body turns by `turn` degrees in all, positive to the left.
fn bent(motion: &Rotations, turn: f32) -> Rotations {
    let further = f64::from(turn).to_radians() - total_turn(motion);
    let root = motion.root();
    let place = |frame: usize| {
        let [x, y, z] = root[frame].map(f64::from);
        DVec3::new(x, y, z)
    };
    let flat = |v: DVec3| DVec3::new(v.x, 0.0, v.z);
    let steps: Vec<f64> = (1..root.len())
        .map(|frame| flat(place(frame) - place(frame - 1)).length())
        .collect();
    let length = steps.iter().sum::<f64>().max(f64::EPSILON);
    let mut turned = 0.0;
    let mut moved = place(0);
    let mut places = vec![root[0]];
    let mut turns = vec![0.0];
    for (frame, step) in (1..root.len()).zip(&steps) {
        let now = turned + further * step / length;
        let change = place(frame) - place(frame - 1);
        moved += DQuat::from_rotation_y((turned + now) / 2.0) * change;
        turned = now;
        places.push(moved.as_vec3().to_array());
        turns.push(turned);
    }
    let local = motion.local().iter().zip(&turns).map(|(pose, turned)| {
        let mut pose = *pose;
        let turned = DQuat::from_rotation_y(*turned) * DQuat::from_array(pose[0].map(f64::from));
        pose[0] = turned.to_array().map(|x| x as f32);
        pose
    });
    moving(motion, places, local.collect())
}

/// Returns how far the body turns in all, in radians, positive to the left.
fn total_turn(motion: &Rotations) -> f64 {
    let poses = motion.joints();
    let headings: Vec<f64> = { poses.iter() }
        .map(|pose| Placement::of(pose).heading())
        .collect();
    let turns = headings.windows(2).map(|pair| {
        let turn = pair[1] - pair[0];
        turn.sin().atan2(turn.cos())
    });
    turns.sum()
}

/// Returns the motion without its travel: of its path only the swaying is left.
fn staying(motion: &Rotations) -> Rotations {
    let root = motion.root();
    let path = ground_path(root, motion.frames_per_second(), None);
    let places = root.iter().zip(&path);
    let places = places.map(|([x, y, z], path)| [x - path[0], *y, z - path[1]]);
    moving(motion, places.collect(), motion.local().to_vec())
}

/// Returns a rotation between two, the nearer way round.
pub(super) fn between(a: [f32; 4], b: [f32; 4], share: f64) -> [f32; 4] {
    let [a, b] = [a, b].map(|turn| DQuat::from_array(turn.map(f64::from)).normalize());
    a.slerp(b, share).to_array().map(|x| x as f32)
}

/// The local rotations of a pose.
pub(super) type LocalPose = [[f32; 4]; JOINTS];
