//! Other frame rates: new frames on smooth curves through those of a motion, with feet that stay where they stand.

use std::ops::RangeInclusive;

use glam::{DQuat, DVec3};

use super::{Rotations, WorldPose, quaternion};
use crate::limb::bend_limb;
use crate::precise::{smooth_step, vector};
use crate::skeleton::{JOINTS, Joint, LEGS};

/// The speeds of an ankle, in metres a second, up to which a foot stands, and from which on it swings.
const STANDING: f64 = 0.2;
const SWINGING: f64 = 0.6;

/// The shortest bone of a leg, in metres, that is bent.
const SHORTEST_BONE: f64 = 1e-3;

impl Rotations {
    /// Resamples the movement to another frame rate. Rotations, and the places of pelvis and feet, follow smooth curves
    /// through those of the frames: a foot that stands at two frames also stands between them. The result begins with the
    /// first frame and ends with the last one, or up to half a new frame before or after it, and is no loop
    /// ([`Motion::keyframes`](crate::Motion::keyframes) keeps loops).
    ///
    /// # Panics
    ///
    /// If the rate is not a positive number.
    pub fn resampled(&self, frames_per_second: f32) -> Rotations {
        assert!(
            frames_per_second.is_finite() && frames_per_second > 0.0,
            "a frame rate is a positive number, not {frames_per_second}"
        );
        if frames_per_second == self.frames_per_second {
            return self.clone();
        }
        self.resampled_within(0..=self.frames() - 1, frames_per_second)
    }

    /// Resamples a loop with the given travel from its first frame to the one that closes it. The curves go on over the
    /// seam.
    pub(crate) fn resampled_loop(&self, travel: [f32; 2], frames_per_second: f32) -> Rotations {
        if frames_per_second == self.frames_per_second {
            return self.repeated(1, 1, travel);
        }
        // The second cycle has neighbours on both sides.
        let around = self.repeated(2, 2, travel);
        let range = self.frames()..=2 * self.frames();
        let mut cycle = around.resampled_within(range, frames_per_second);
        for root in &mut cycle.root {
            root[0] -= travel[0];
            root[2] -= travel[1];
        }
        cycle
    }

    /// Resamples some of the frames. The curves go on through the frames before and after them.
    fn resampled_within(&self, range: RangeInclusive<usize>, frames_per_second: f32) -> Rotations {
        let poses = { self.root.iter().zip(&self.local) }
            .map(|(&root, local)| WorldPose::new(&self.rest, root, local));
        let curves = Curves {
            motion: self,
            poses: poses.collect(),
        };
        let step = f64::from(self.frames_per_second) / f64::from(frames_per_second);
        let (first, last) = range.into_inner();
        let frames = ((last - first) as f64 / step).round() as usize + 1;
        let between = (0..frames).map(|frame| {
            // Each new frame lies between two old ones: the index of the first, and the fraction of the way to the second.
            let time = (first as f64 + frame as f64 * step).min(last as f64);
            let before = (time.floor() as usize).min(last.saturating_sub(1).max(first));
            curves.frame(before, time - before as f64)
        });
        let (root, local) = between.unzip();
        Rotations {
            rest: self.rest.clone(),
            root,
            local,
            frames_per_second,
            loop_travel: None,
        }
    }
}

/// The curves through the frames of a motion.
struct Curves<'m> {
    motion: &'m Rotations,
    /// Where the joints are at every frame.
    poses: Vec<WorldPose>,
}

impl Curves<'_> {
    /// Returns the place of the pelvis and the local rotations between a frame and the next.
    fn frame(&self, before: usize, fraction: f64) -> ([f32; 3], [[f32; 4]; JOINTS]) {
        let Rotations { root, local, .. } = self.motion;
        if fraction == 0.0 {
            return (root[before], local[before]);
        }
        let root = self.root(before, fraction).as_vec3().to_array();
        let mut local = Joint::ALL.map(|joint| {
            let turns = |frame: usize| quaternion(local[frame][joint.index()]);
            let turn = self.rotation(turns, before, fraction);
            turn.to_array().map(|x| x as f32)
        });
        self.place_feet(root, &mut local, before, fraction);
        (root, local)
    }

    /// Returns the changes from the frame before a frame to it, from there to the next, and from that to the one after, if `change`
    /// says what leads from one frame to another. Beyond the ends, changes go on.
    fn changes(&self, before: usize, change: impl Fn(usize, usize) -> DVec3) -> [DVec3; 3] {
        let step = change(before, before + 1);
        let earlier = { before.checked_sub(1) }.map_or(step, |frame| change(frame, before));
        let later = match before + 2 < self.poses.len() {
            true => change(before + 1, before + 2),
            false => step,
        };
        [earlier, step, later]
    }

    /// Returns the place of the pelvis on a Catmull-Rom spline through four neighbours; it goes straight on beyond the ends.
    fn root(&self, before: usize, fraction: f64) -> DVec3 {
        let at = |frame: usize| vector(self.motion.root[frame]);
        let [earlier, step, later] = self.changes(before, |from, to| at(to) - at(from));
        let speeds = [(earlier + step) / 2.0, (step + later) / 2.0];
        on_spline([at(before), at(before + 1)], speeds, fraction)
    }

    /// Returns the place of a joint on a spline that does not swing beyond a place of rest.
    fn place(&self, joint: Joint, before: usize, fraction: f64) -> DVec3 {
        let at = |frame: usize| self.poses[frame].positions[joint.index()];
        let [earlier, step, later] = self.changes(before, |from, to| at(to) - at(from));
        let speeds = [resting_speed(earlier, step), resting_speed(step, later)];
        on_spline([at(before), at(before + 1)], speeds, fraction)
    }

    /// Returns a rotation on a smooth curve through the rotations at four frames (a Bézier curve, Shoemake 1985).
    fn rotation(&self, at: impl Fn(usize) -> DQuat, before: usize, fraction: f64) -> DQuat {
        let [earlier, step, later] =
            self.changes(before, |from, to| turn_between(at(from), at(to)));
        let (from, to) = (at(before), at(before + 1));
        let near_from = from * DQuat::from_scaled_axis(resting_speed(earlier, step) / 3.0);
        let near_to = to * DQuat::from_scaled_axis(-resting_speed(step, later) / 3.0);
        let between = |a: DQuat, b: DQuat| a.slerp(b, fraction);
        let middle = between(near_from, near_to);
        let first = between(between(from, near_from), middle);
        first.slerp(between(middle, between(near_to, to)), fraction)
    }

    /// Bends legs whose feet stand, so that the feet are on their own curves, as turned as on theirs. Legs that swing are left
    /// as they are: the rotations of their joints tell more of the way of the foot than its places do.
    fn place_feet(
        &self,
        root: [f32; 3],
        local: &mut [[f32; 4]; JOINTS],
        before: usize,
        fraction: f64,
    ) {
        let pose = WorldPose::new(&self.motion.rest, root, local);
        for [hip, knee, ankle] in LEGS {
            let joints = [hip, knee, ankle].map(|joint| pose.positions[joint.index()]);
            let bones = [joints[1] - joints[0], joints[2] - joints[1]];
            if bones.iter().any(|bone| bone.length() < SHORTEST_BONE) {
                continue;
            }
            let [start, end] =
                [before, before + 1].map(|frame| self.poses[frame].positions[ankle.index()]);
            let speed = start.distance(end) * f64::from(self.motion.frames_per_second);
            let standing = 1.0 - smooth_step((speed - STANDING) / (SWINGING - STANDING));
            if standing == 0.0 {
                continue;
            }
            let target = joints[2].lerp(self.place(ankle, before, fraction), standing);
            let bent = bend_limb(joints, target, None);
            let [thigh, shin] = [(bent[0], hip), (bent[1], knee)]
                .map(|(turn, joint)| turn * pose.rotations[joint.index()]);
            let foot = |frame: usize| self.poses[frame].rotations[ankle.index()];
            let foot = self.rotation(foot, before, fraction);
            let foot = pose.rotations[ankle.index()].slerp(foot, standing);
            let pelvis = pose.rotations[Joint::Pelvis.index()];
            for (joint, parent, turned) in [
                (hip, pelvis, thigh),
                (knee, thigh, shin),
                (ankle, shin, foot),
            ] {
                let place = &mut local[joint.index()];
                let turn = (parent.conjugate() * turned).normalize();
                // Of both quaternions of the rotation, the nearer one.
                let turn = match turn.dot(quaternion(*place)) < 0.0 {
                    true => -turn,
                    false => turn,
                };
                *place = turn.to_array().map(|x| x as f32);
            }
        }
    }
}

/// Returns a point on the cubic curve from one point to another that has these speeds at its ends.
fn on_spline([from, to]: [DVec3; 2], speeds: [DVec3; 2], fraction: f64) -> DVec3 {
    let [t, t2, t3] = [1, 2, 3].map(|power| fraction.powi(power));
    from * (2.0 * t3 - 3.0 * t2 + 1.0)
        + speeds[0] * (t3 - 2.0 * t2 + t)
        + to * (3.0 * t2 - 2.0 * t3)
        + speeds[1] * (t3 - t2)
}

/// Returns the rotation that leads from one to another on the shortest arc, as an axis times an angle, seen from the first.
fn turn_between(from: DQuat, to: DQuat) -> DVec3 {
    let turn = from.conjugate() * to;
    match turn.w < 0.0 {
        true => -turn,
        false => turn,
    }
    .to_scaled_axis()
}

/// Returns the speed at a frame from the changes before and after it: their mean, but not more than twice the smaller one. A
/// foot that comes to rest within a frame would otherwise swing beyond its place.
fn resting_speed(before: DVec3, after: DVec3) -> DVec3 {
    let most = 2.0 * before.length().min(after.length());
    ((before + after) / 2.0).clamp_length_max(most)
}
