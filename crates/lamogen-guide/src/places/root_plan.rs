//! The path of the root that leads a body through its places.

use std::f64::consts::TAU;

use burn::tensor::{Tensor, TensorData};
use lamogen_motion::{FRAMES_PER_SECOND, FeatureGroup, Normalization, smooth_step};

use super::facing::Facing;
use super::ground_path::GroundPath;
use super::spline::CubicSpline;
use super::{PlaceOrigin, Places, frame_at};
use crate::host::to_host;

/// The standard deviation in frames of the Gaussian that separates the way of a body from the sway of its steps.
const SWAY_FRAMES: f64 = 8.0;
/// The standard deviation in frames of the Gaussian that smooths the direction of a path.
const DIRECTION_FRAMES: f64 = 6.0;
/// The speed in metres a second at which the direction of a path counts half as much as that of a fast one.
const DIRECTION_SPEED: f64 = 0.2;
/// The number of frames in which a body turns from how it stands at the start to the direction of its path.
const START_FRAMES: usize = 12;
/// The number of frames after the last place of a path in which a body returns to its own way of going.
const RETURN_FRAMES: usize = 20;
/// The number of frames before and after a place at which the direction counts.
const FACING_REACH: usize = 5;
/// The distance along the ground in metres that a part of the body covers without a step.
const STEPLESS_REACH: f64 = 0.3;
/// The number of frames after a reach in which the root keeps its offset.
const KEPT_FRAMES: usize = 10;

/// The direction of a path at every frame.
#[derive(Clone, Debug)]
pub(super) struct Directions {
    /// Radians to the left of how the body stands at the start.
    pub(super) angles: Vec<f64>,
    /// How much the direction counts in the loss, 0 to 1.
    pub(super) weights: Vec<f64>,
}

/// Returns the last frame at which a motion is where the known frames before it lead: its first frame, or the one after them. What a
/// row of features holds is the step to the next frame.
fn start_frame(origin: Option<&PlaceOrigin>) -> usize {
    origin.map_or(0, |origin| origin.track().len())
}

/// Returns where a body faces on a path; `None` if it may face anywhere. The path is where it is in a motion with known frames, of
/// which `origin` is the end.
pub(super) fn directions(
    path: &GroundPath,
    facing: Facing,
    origin: Option<&PlaceOrigin>,
    frames: usize,
) -> Option<Directions> {
    let first = start_frame(origin);
    let heading = origin.map_or(0.0, PlaceOrigin::heading);
    // From how the body stands at the start.
    let turn = |(t, angle): (usize, f64)| {
        let share = smooth_step(t.saturating_sub(first) as f64 / START_FRAMES as f64);
        heading + (angle - heading) * share
    };
    let moments: Vec<usize> = { path.waypoints().iter() }
        .map(|point| frame_at(point.seconds, frames))
        .collect();
    let is_near = |t: usize| {
        moments
            .iter()
            .any(|moment| moment.abs_diff(t) <= FACING_REACH)
    };
    let weight = |t: usize| f64::from(u8::from(is_near(t) && t >= first + START_FRAMES));
    match facing {
        Facing::Free => None,
        Facing::Degrees(degrees) => {
            let angle = f64::from(degrees).to_radians();
            Some(Directions {
                angles: (0..frames).map(|t| turn((t, angle))).collect(),
                weights: (0..frames).map(weight).collect(),
            })
        }
        Facing::Path => {
            let known = origin.map_or(&[][..], PlaceOrigin::track);
            let spline = CubicSpline::new(&knots(known, path, frames, |_| [0.0; 2]));
            let (angles, shares) = tangents(&spline, frames, heading);
            let angles = angles.into_iter().enumerate();
            Some(Directions {
                angles: angles.map(turn).collect(),
                weights: (0..frames).map(|t| shares[t] * weight(t)).collect(),
            })
        }
    }
}

/// Returns the direction of a curve at every frame, smoothed along time, in radians to the left of z, and how much it
/// counts, 0 where the curve rests and nearly 1 where it is fast. Directions turn on from `heading`.
fn tangents(spline: &CubicSpline, frames: usize, heading: f64) -> (Vec<f64>, Vec<f64>) {
    let mut angles = Vec::with_capacity(frames);
    let mut shares = Vec::with_capacity(frames);
    let mut last = heading;
    for t in 0..frames {
        let [before, after] = [-0.5, 0.5].map(|step| spline.at(t as f64 + step));
        let step = [after[0] - before[0], after[1] - before[1]];
        let speed = step[0].hypot(step[1]) * f64::from(FRAMES_PER_SECOND);
        if speed > 1e-6 {
            // The turn from the last direction to this one that is shorter than half a circle.
            let turn = step[0].atan2(step[1]) - last;
            last += turn - (turn / TAU).round() * TAU;
        }
        angles.push(last);
        shares.push(speed.powi(2) / (speed.powi(2) + DIRECTION_SPEED.powi(2)));
    }
    let weights: Vec<f64> = shares.iter().map(|share| share + 1e-6).collect();
    (smooth(&angles, &weights, DIRECTION_FRAMES), shares)
}

/// Smooths values along time by a Gaussian; each value counts as much as its weight.
fn smooth(values: &[f64], weights: &[f64], deviation: f64) -> Vec<f64> {
    let mean = |t: usize| {
        let (mut sum, mut total) = (0.0, 0.0);
        for (k, (value, weight)) in values.iter().zip(weights).enumerate() {
            let share = weight * (-0.5 * ((k as f64 - t as f64) / deviation).powi(2)).exp();
            sum += share * value;
            total += share;
        }
        sum / total
    };
    (0..values.len()).map(mean).collect()
}

/// Returns the points of a path as knots, after those of the known frames before it, or of its start if there are none. `sway` is
/// what a body is off its way at a frame.
fn knots(
    known: &[[f64; 2]],
    path: &GroundPath,
    frames: usize,
    sway: impl Fn(usize) -> [f64; 2],
) -> Vec<(f64, [f64; 2])> {
    let at = |(frame, place): (usize, [f64; 2])| {
        let [x, z] = sway(frame);
        (frame as f64, [place[0] - x, place[1] - z])
    };
    let start = match known {
        [] => &[[0.0; 2]],
        known => known,
    };
    let mut knots: Vec<_> = start.iter().copied().enumerate().map(at).collect();
    for point in path.waypoints() {
        let frame = frame_at(point.seconds, frames);
        if frame >= start.len() {
            knots.push(at((frame, point.place.map(f64::from))));
        }
    }
    knots
}

/// Turns a vector along the ground to the left.
fn turned([x, z]: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [x * cos + z * sin, z * cos - x * sin]
}

/// The way of a root along the ground.
#[derive(Clone, Debug)]
struct RootTrack {
    /// Metres from the start, x and z, at every frame.
    places: Vec<[f64; 2]>,
    /// The heading of the pose features at every frame, in radians to the left of the start.
    headings: Vec<f64>,
}

/// The features that place the root, one row for each step from a frame to the next.
const ROOT_FEATURES: [usize; 5] = [
    FeatureGroup::RootYaw.range().start,
    FeatureGroup::RootVelocity.range().start,
    FeatureGroup::RootVelocity.range().start + 1,
    // The displacement of the pelvis, which the features have once more.
    FeatureGroup::Velocities.range().start,
    FeatureGroup::Velocities.range().start + 2,
];

impl RootTrack {
    /// Decodes the yaw and the velocities of the root: `rows` hold one step from a frame to the next each.
    fn decode(rows: impl Iterator<Item = [f64; 3]>) -> RootTrack {
        let (mut place, mut heading) = ([0.0; 2], 0.0);
        let (mut places, mut headings) = (Vec::new(), Vec::new());
        for [yaw, x, z] in rows {
            places.push(place);
            headings.push(heading);
            // Pose features have half the angle, and turn to the right.
            heading -= 2.0 * yaw;
            let step = turned([x, z], heading);
            place = [place[0] + step[0], place[1] + step[1]];
        }
        RootTrack { places, headings }
    }

    /// Encodes the track as [`ROOT_FEATURES`]. The last row repeats the step before it.
    fn encode(&self) -> Vec<[f64; 5]> {
        let steps = self.places.len().saturating_sub(1);
        let row = |t: usize| {
            let [from, to] = [self.places[t], self.places[t + 1]];
            let step = [to[0] - from[0], to[1] - from[1]];
            let (heading, next) = (self.headings[t], self.headings[t + 1]);
            let [x, z] = turned(step, -next);
            let [pelvis_x, pelvis_z] = turned(step, -heading);
            [0.5 * (heading - next), x, z, pelvis_x, pelvis_z]
        };
        let mut rows: Vec<[f64; 5]> = (0..steps).map(row).collect();
        rows.extend(rows.last().copied());
        rows
    }

    /// Returns what the body is off its way at every frame, seen from its heading.
    fn sway(&self) -> Vec<[f64; 2]> {
        let last = self.places.len() as isize - 1;
        let reach = (3.0 * SWAY_FRAMES) as isize;
        // Beyond an end, the way goes on as it came, turned by half a circle about the end.
        let at = |frame: isize, axis: usize| {
            let end = frame.clamp(0, last);
            let mirrored = (2 * end - frame).clamp(0, last);
            match end == frame {
                true => self.places[frame as usize][axis],
                false => {
                    2.0 * self.places[end as usize][axis] - self.places[mirrored as usize][axis]
                }
            }
        };
        let smoothed = |t: isize, axis: usize| {
            let (mut sum, mut total) = (0.0, 0.0);
            for step in -reach..=reach {
                let share = (-0.5 * (step as f64 / SWAY_FRAMES).powi(2)).exp();
                sum += share * at(t + step, axis);
                total += share;
            }
            sum / total
        };
        let off = |t: usize| {
            let off = [0, 1].map(|axis| self.places[t][axis] - smoothed(t as isize, axis));
            turned(off, -self.headings[t])
        };
        (0..self.places.len()).map(off).collect()
    }

    /// Returns a track that passes the places of a path with the sway of this one. After the last place it returns to
    /// the speed of this one. `directions` are those of the path; without them the body faces as in this track. Up to the frame
    /// `first`, the track stays as it is.
    // Frames and axes are indices into several tables at once.
    #[allow(clippy::needless_range_loop)]
    fn along(&self, path: &GroundPath, directions: Option<&Directions>, first: usize) -> RootTrack {
        let frames = self.places.len();
        let sway = self.sway();
        let last = path.waypoints().last();
        let last = last.map_or(0, |point| frame_at(point.seconds, frames));
        let mut headings = match directions {
            Some(directions) => directions.angles.clone(),
            None => self.headings.clone(),
        };
        if first > 0 {
            // The body faces somewhat elsewhere in the frame after the known ones than in the last of them. Where it has turned far in
            // them, its heading goes on from there, and not from the same direction less whole turns.
            let turn = self.headings[first] - headings[first];
            let whole_turns = (turn / TAU).round() * TAU;
            for t in 0..frames {
                let share = smooth_step(t.saturating_sub(first) as f64 / START_FRAMES as f64);
                match t <= first {
                    true => headings[t] = self.headings[t],
                    false => headings[t] += whole_turns + (turn - whole_turns) * (1.0 - share),
                }
            }
        }
        for t in last + 1..frames {
            headings[t] = headings[last] + self.headings[t] - self.headings[last];
        }
        let sway_at = |t: usize| turned(sway[t], headings[t]);
        let known = match first {
            0 => &[][..],
            _ => &self.places[..=first],
        };
        let spline = CubicSpline::new(&knots(known, path, frames, sway_at));
        let mut places = Vec::with_capacity(frames);
        for t in 0..frames {
            let [x, z] = spline.at(t as f64);
            let [sway_x, sway_z] = sway_at(t);
            places.push([x + sway_x, z + sway_z]);
        }
        for t in last + 1..frames {
            let own = [0, 1].map(|axis| self.places[t][axis] - self.places[t - 1][axis]);
            let own = turned(own, headings[t] - self.headings[t]);
            let [from, to] = [t - 1, t].map(|t| spline.at(t as f64));
            let share = smooth_step((t - last) as f64 / RETURN_FRAMES as f64);
            for axis in 0..2 {
                let step = to[axis] - from[axis];
                places[t][axis] = places[t - 1][axis] + step + (own[axis] - step) * share;
            }
        }
        RootTrack { places, headings }
    }

    /// Moves the track by an offset that changes smoothly through `offsets` at frames, from none up to the frame `first`.
    fn offset(&mut self, offsets: &[(usize, [f64; 2])], first: usize) {
        // Known frames keep the track as it is, so that it leaves them at their speed.
        let mut knots: Vec<_> = (0..=first).map(|t| (t as f64, [0.0; 2])).collect();
        for &(frame, offset) in offsets {
            if frame as f64 > knots[knots.len() - 1].0 {
                knots.push((frame as f64, offset));
            }
        }
        let (last, offset) = knots[knots.len() - 1];
        knots.push((last + KEPT_FRAMES as f64, offset));
        let spline = CubicSpline::new(&knots);
        for (t, place) in self.places.iter_mut().enumerate().skip(first) {
            let [x, z] = spline.at((t as f64).min(last + KEPT_FRAMES as f64));
            place[0] += x;
            place[1] += z;
        }
    }
}

/// The change of predicted motions so that their roots lead the bodies through their places.
#[derive(Clone, Debug)]
pub(crate) struct RootPlan {
    places: Places,
    /// The last frame at which the motions are where known frames before it lead, or the first one.
    first: usize,
    lengths: Vec<usize>,
    /// Where each motion faces on the path, if that is decided.
    directions: Vec<Option<Directions>>,
    means: Vec<f32>,
    deviations: Vec<f32>,
}

impl RootPlan {
    /// Prepares the change for motions of the given lengths, with known frames of which the places are counted from an origin; `None`
    /// if there are no places.
    pub(crate) fn new(
        places: &Places,
        origin: Option<&PlaceOrigin>,
        lengths: &[usize],
        normalization: &Normalization,
    ) -> Option<RootPlan> {
        if places.is_empty() {
            return None;
        }
        let [means, deviations] = normalization.values();
        let places = places.counted_from(origin);
        let of_length =
            |&frames: &usize| directions(places.path.as_ref()?, places.facing, origin, frames);
        Some(RootPlan {
            directions: lengths.iter().map(of_length).collect(),
            places: places.into_owned(),
            first: start_frame(origin),
            lengths: lengths.to_vec(),
            means,
            deviations,
        })
    }

    /// Changes the features of the root of predicted motions, normalised, `[batch, frames, features]`. A path decides where
    /// the root is, so that no gradient passes to what the network predicts of it. For positions to reach, gradients pass as
    /// if nothing had been changed.
    pub(crate) fn apply(&self, motions: Tensor<3>) -> Tensor<3> {
        let [batch, frames, features] = motions.dims();
        let read = FeatureGroup::LocalPositions.range().end;
        let rows = to_host(motions.clone().detach().narrow(2, 0, read));
        let mut planned = vec![0.0; batch * frames * features];
        let mut mask = vec![0.0; batch * frames * features];
        for (motion, &length) in self.lengths.iter().enumerate() {
            let value = |t: usize, feature: usize| {
                let normalized = rows[(motion * frames + t) * read + feature];
                f64::from(normalized * self.deviations[feature] + self.means[feature])
            };
            let steps = (0..length).map(|t| [0, 1, 2].map(|root| value(t, ROOT_FEATURES[root])));
            let track = RootTrack::decode(steps);
            // Early predictions of an unsuited network may not be finite; the loss reports them.
            if track.places.iter().flatten().any(|x| !x.is_finite()) {
                continue;
            }
            let track = self.plan(motion, track, &value).encode();
            for (t, row) in track.into_iter().enumerate() {
                for (feature, value) in ROOT_FEATURES.into_iter().zip(row) {
                    let at = (motion * frames + t) * features + feature;
                    planned[at] = (value as f32 - self.means[feature]) / self.deviations[feature];
                    mask[at] = 1.0;
                }
            }
        }
        let device = motions.device();
        let tensor = |values: Vec<f32>| {
            Tensor::<3>::from_data(TensorData::new(values, [batch, frames, features]), &device)
        };
        let mask = tensor(mask);
        let own = match self.places.path.is_some() {
            // The path decides where the root is, whatever the network predicts.
            true => motions.clone(),
            false => motions.clone().detach(),
        };
        motions + (tensor(planned) - own * mask)
    }

    /// Plans the track of one motion. `value` returns a feature at a frame.
    fn plan(
        &self,
        motion: usize,
        track: RootTrack,
        value: &dyn Fn(usize, usize) -> f64,
    ) -> RootTrack {
        let frames = track.places.len();
        if let Some(path) = &self.places.path {
            return track.along(path, self.directions[motion].as_ref(), self.first);
        }
        let mut offsets: Vec<(usize, [f64; 2])> = { self.places.reaches.iter() }
            .map(|reach| {
                let frame = frame_at(reach.seconds(), frames);
                let joint = reach.part().joint().index();
                let local = FeatureGroup::LocalPositions.range().start + 3 * (joint - 1);
                let local = [value(frame, local), value(frame, local + 2)];
                let [x, z] = turned(local, track.headings[frame]);
                let position = reach.position();
                let gap = [
                    f64::from(position[0]) - track.places[frame][0] - x,
                    f64::from(position[2]) - track.places[frame][1] - z,
                ];
                let distance = gap[0].hypot(gap[1]);
                let share = (1.0 - STEPLESS_REACH / distance.max(1e-9)).max(0.0);
                (frame, gap.map(|gap| gap * share))
            })
            .collect();
        offsets.sort_by_key(|(frame, _)| *frame);
        let mut planned = track;
        planned.offset(&offsets, self.first);
        planned
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use lamogen_motion::{POSE_FEATURES, joints};

    use super::*;

    /// A walk straight ahead at 1 m/s that sways 4 cm to both sides, with two steps a second.
    fn walk(frames: usize) -> RootTrack {
        let place = |t: usize| {
            let sway = (t as f64 * TAU / 20.0).sin();
            [0.04 * sway, 0.05 * t as f64]
        };
        RootTrack {
            places: (0..frames).map(place).collect(),
            headings: vec![0.0; frames],
        }
    }

    /// Normalisation that leaves features as they are.
    fn identity() -> Normalization {
        let device = Device::flex();
        Normalization::from_slices(&[0.0; POSE_FEATURES], &[1.0; POSE_FEATURES], &device).unwrap()
    }

    /// The features of a track, `[1, frames, 263]`; joints are where the root is.
    fn features(track: &RootTrack) -> Tensor<3> {
        let frames = track.places.len();
        let mut values = vec![0.0; frames * POSE_FEATURES];
        for (t, row) in track.encode().into_iter().enumerate() {
            for (feature, value) in ROOT_FEATURES.into_iter().zip(row) {
                values[t * POSE_FEATURES + feature] = value as f32;
            }
        }
        let data = TensorData::new(values, [1, frames, POSE_FEATURES]);
        Tensor::from_data(data, &Device::flex())
    }

    #[test]
    fn tracks_are_encoded_as_pose_features_have_them() {
        let path: GroundPath = "1:1,1 2:0,2".parse().unwrap();
        let track = walk(60).along(&path, directions(&path, Facing::Path, None, 60).as_ref(), 0);
        let rows = track.encode().into_iter();
        let again = RootTrack::decode(rows.map(|[yaw, x, z, ..]| [yaw, x, z]));
        for (own, again) in track.places.iter().zip(&again.places) {
            assert!((own[0] - again[0]).abs() < 1e-9 && (own[1] - again[1]).abs() < 1e-9);
        }
        for (own, again) in track.headings.iter().zip(&again.headings) {
            assert!((own - again).abs() < 1e-9);
        }
        // The decoder of pose features agrees.
        let joints = to_host(joints(features(&track)));
        for (t, place) in track.places.iter().enumerate() {
            let [x, z] = [0, 2].map(|axis| f64::from(joints[t * 66 + axis]));
            assert!(
                (x - place[0]).abs() < 1e-4 && (z - place[1]).abs() < 1e-4,
                "{t}"
            );
        }
    }

    #[test]
    fn a_track_passes_its_places_facing_along_the_path_with_the_sway_of_its_steps() {
        let path: GroundPath = "0:0,0 2:1,0 4:1,2".parse().unwrap();
        let track = walk(80).along(&path, directions(&path, Facing::Path, None, 80).as_ref(), 0);
        for (frame, place) in [(0, [0.0, 0.0]), (40, [1.0, 0.0]), (79, [1.0, 2.0])] {
            for (own, asked) in track.places[frame].into_iter().zip(place) {
                let off: f64 = own - asked;
                assert!(off.abs() < 1e-9, "{frame}: {off}");
            }
        }
        // The body stands as it did at the start, and then goes to the left.
        assert_eq!(track.headings[0], 0.0);
        let degrees = |frame: usize| track.headings[frame].to_degrees();
        assert!((80.0..120.0).contains(&degrees(20)), "{}", degrees(20));
        assert!(degrees(75).abs() < 30.0, "{}", degrees(75));
        let sway = track.sway();
        let largest = sway.iter().map(|off| off[0].abs()).fold(0.0, f64::max);
        assert!((0.02..0.1).contains(&largest), "{largest}");
    }

    #[test]
    fn a_track_leads_on_from_known_frames_without_a_jump() {
        // Twenty known frames in which the body turns to the left by 270 degrees while it walks; then it walks on.
        let mut track = walk(80);
        for (t, heading) in track.headings.iter_mut().enumerate() {
            *heading = 0.75 * TAU * (t.min(20) as f64 / 20.0);
        }
        let heading = -0.25 * TAU;
        let [left, forward] = [heading.cos() as f32, -heading.sin() as f32];
        let pose = |t: usize| {
            let [x, z] = track.places[t].map(|x| x as f32);
            let mut pose = [[x, 0.9, z]; lamogen_motion::JOINTS];
            for (joint, side) in [(1, 0.1), (2, -0.1), (16, 0.2), (17, -0.2)] {
                pose[joint] = [x + side * left, 0.9, z + side * forward];
            }
            pose
        };
        let known: Vec<_> = (0..20).map(pose).collect();
        let origin = PlaceOrigin::new(&known, 20..80);
        assert!((origin.heading() - heading).abs() < 1e-6);
        let places = Places {
            path: Some("1:0,1 2:1,2".parse().unwrap()),
            ..Places::default()
        };
        let places = places.counted_from(Some(&origin));
        let path = places.path.as_ref().unwrap();
        let directions = directions(path, Facing::Path, Some(&origin), 80);
        let led = track.along(path, directions.as_ref(), start_frame(Some(&origin)));
        for t in 0..=20 {
            assert!((led.headings[t] - track.headings[t]).abs() < 1e-9);
            for axis in 0..2 {
                assert!((led.places[t][axis] - track.places[t][axis]).abs() < 1e-9);
            }
        }
        for t in 21..80 {
            let turn = (led.headings[t] - led.headings[t - 1]).to_degrees();
            assert!(turn.abs() < 25.0, "{t}: {turn}");
            let step = [0, 1].map(|axis| led.places[t][axis] - led.places[t - 1][axis]);
            assert!(step[0].hypot(step[1]) < 0.15, "{t}: {step:?}");
        }
        for (point, frame) in path.waypoints().iter().zip([40, 60]) {
            for axis in 0..2 {
                let off = led.places[frame][axis] - f64::from(point.place[axis]);
                assert!(off.abs() < 1e-6, "{frame}: {off}");
            }
        }
    }

    #[test]
    fn a_track_goes_on_at_its_own_speed_after_its_last_place() {
        let path: GroundPath = "1:0.5,0".parse().unwrap();
        let track = walk(100).along(
            &path,
            directions(&path, Facing::Path, None, 100).as_ref(),
            0,
        );
        let speed = |t: usize| {
            let [from, to] = [track.places[t - 10], track.places[t + 10]];
            (to[0] - from[0]).hypot(to[1] - from[1])
        };
        assert!((speed(10) - 0.5).abs() < 0.15, "{}", speed(10));
        assert!((speed(80) - 1.0).abs() < 0.05, "{}", speed(80));
    }

    #[test]
    fn a_root_moves_by_what_a_hand_cannot_reach_from_where_it_stands() {
        let standing = RootTrack {
            places: vec![[0.0; 2]; 40],
            headings: vec![0.0; 40],
        };
        let apply = |text: &str| {
            let places = Places {
                reaches: vec![text.parse().unwrap()],
                ..Places::default()
            };
            let plan = RootPlan::new(&places, None, &[40], &identity()).unwrap();
            let joints = to_host(joints(plan.apply(features(&standing))));
            // The wrist is where the pelvis is.
            [0, 2].map(|axis| joints[20 * 66 + axis])
        };
        let near = apply("right-hand@1=0.2,1,0.1");
        assert!(near.iter().all(|x| x.abs() < 1e-4), "{near:?}");
        let far = apply("right-hand@1=0,1,1.3");
        assert!(
            far[0].abs() < 1e-4 && (far[1] - 1.0).abs() < 1e-3,
            "{far:?}"
        );
    }

    #[test]
    fn no_gradient_passes_to_the_root_of_a_path() {
        let places = Places {
            path: Some("1.5:1,1".parse().unwrap()),
            ..Places::default()
        };
        let plan = RootPlan::new(&places, None, &[40], &identity()).unwrap();
        let leaf = features(&walk(40)).autodiff().require_grad();
        let loss = plan.apply(leaf.clone()).square().sum() + leaf.clone().sum();
        let gradient = leaf.grad_remove(&mut loss.backward()).unwrap();
        let gradient = to_host(gradient);
        // The sum of the leaf has the gradient 1 everywhere.
        for feature in ROOT_FEATURES {
            assert!((gradient[10 * POSE_FEATURES + feature] - 1.0).abs() < 1e-6);
        }
        assert!(RootPlan::new(&Places::default(), None, &[40], &identity()).is_none());
    }
}
