//! The places of a motion that is made a stretch at a time.
//!
//! ```text
//! places of the whole motion ──section──▶ places of a stretch, counted from where the stretch before ends:
//!                                          those at its frames, and where a path goes on, points of the way there at its end
//! ```

use std::ops::Range;

use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Motion, Placement};

use super::ground_path::{GroundPath, Waypoint};
use super::outcome::{self, PlaceOutcome};
use super::spline::CubicSpline;
use super::{Facing, KeyPose, PlaceError, Places, Reach, frame_of};

/// The number of frames from the end of a stretch to the first point of the way to a place beyond it: the two points decide where the
/// body is and how it moves there.
const WAY_FRAMES: usize = 10;
/// The number of frames after the end of a stretch at which a position or a pose is already taken at the end.
const LEAD_FRAMES: usize = 3;

/// The places of a motion that is made a stretch at a time, each stretch from where the one before ends.
#[derive(Clone, Debug)]
pub struct Itinerary {
    /// The places as they are counted in the whole motion.
    places: Places,
    /// Where the body stands and faces where the places are counted from.
    start: Placement,
}

impl Itinerary {
    /// Creates the itinerary of a motion. `after` is where the body stands and faces at the end of the motion that it continues, if
    /// there is one.
    pub fn new(places: Places, after: Option<Placement>) -> Itinerary {
        let mut places = places;
        if after.is_some() {
            // Where the motion before leads decides where the first frame is.
            let points = places.path.iter().flat_map(GroundPath::waypoints);
            let later = points.filter(|point| frame_of(point.seconds) > 0).copied();
            let later: Vec<Waypoint> = later.collect();
            places.path = (!later.is_empty()).then(|| GroundPath::of_checked(later));
        }
        Itinerary {
            places,
            start: after.unwrap_or(Placement::ORIGIN),
        }
    }

    /// Returns whether nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Returns an itinerary with other places, which are counted from where these are.
    pub fn with_places(&self, places: Places) -> Itinerary {
        Itinerary {
            places,
            start: self.start,
        }
    }

    /// Checks that no place is at one of the first `made` frames, but for the start of a path.
    ///
    /// # Errors
    ///
    /// If one is.
    pub fn check_from(&self, made: usize) -> Result<(), PlaceError> {
        let mut moments = self.places.moments().filter(|seconds| *seconds > 0.0);
        match moments.find(|seconds| frame_of(*seconds) < made) {
            Some(seconds) => Err(PlaceError::Passed {
                seconds,
                made: made as f32 / FRAMES_PER_SECOND,
            }),
            None => Ok(()),
        }
    }

    /// Returns the frames of all places, in the order of time, in a motion of `length` frames. The end of a motion is its last frame.
    pub fn frames(&self, length: usize) -> Vec<usize> {
        let mut frames: Vec<usize> = { self.places.moments() }
            .map(|seconds| frame_within(seconds, length))
            .collect();
        frames.sort_unstable();
        frames
    }

    /// Returns the places of the stretch that has these frames of a motion of `length` frames, counted from where the stretch begins.
    /// `before` are the joint positions of the last frames before it in metres, where the whole motion is; there may be none.
    pub fn section(
        &self,
        frames: &Range<usize>,
        length: usize,
        before: &[[[f32; 3]; JOINTS]],
    ) -> Places {
        let standing = before.last().map_or(self.start, Placement::of);
        let (to_room, to_own) = (
            Placement::ORIGIN.to(&self.start),
            standing.to(&Placement::ORIGIN),
        );
        let own = |point: [f32; 3]| to_own.of_point(to_room.of_point(point));
        let seconds = |frame: usize| (frame - frames.start) as f32 / FRAMES_PER_SECOND;
        // The frame at which a position or a pose is taken, if it is in this stretch.
        let taken = |at: f32| {
            let frame = frame_within(at, length);
            let is_near = frames.start <= frame && frame < frames.end + LEAD_FRAMES;
            is_near.then(|| frame.min(frames.end - 1))
        };
        // Those at the frames of the stretch itself come first.
        let mut reaches = Vec::new();
        for reach in in_time(&self.places.reaches, Reach::seconds) {
            let Some(frame) = taken(reach.seconds()) else {
                continue;
            };
            let moved = reach.moved(seconds(frame), own(reach.position()));
            let is_taken =
                |other: &Reach| other.part() == moved.part() && other.seconds() == moved.seconds();
            if !reaches.iter().any(is_taken) {
                reaches.push(moved);
            }
        }
        let mut poses: Vec<KeyPose> = Vec::new();
        for pose in in_time(&self.places.poses, KeyPose::seconds) {
            let Some(frame) = taken(pose.seconds()) else {
                continue;
            };
            let moved = pose.moved(seconds(frame));
            if !poses.iter().any(|other| other.seconds() == moved.seconds()) {
                poses.push(moved);
            }
        }
        let track = before.iter().map(|pose| {
            let [x, _, z] = to_own.of_point(pose[Joint::Pelvis.index()]);
            [x, z].map(f64::from)
        });
        let points = { self.places.path.iter() }
            .flat_map(GroundPath::waypoints)
            .map(|point| {
                let [x, _, z] = own([point.place[0], 0.0, point.place[1]]);
                (frame_within(point.seconds, length), [x, z])
            });
        let later: Vec<(usize, [f32; 2])> =
            points.filter(|(frame, _)| *frame >= frames.start).collect();
        let path: Vec<Waypoint> = way(&track.collect::<Vec<_>>(), &later, frames)
            .into_iter()
            .map(|(frame, place)| Waypoint {
                seconds: seconds(frame),
                place,
            })
            .collect();
        let facing = match (self.places.facing, before.is_empty()) {
            (Facing::Degrees(degrees), false) => {
                let turn = (self.start.heading() - standing.heading()).to_degrees() as f32;
                let degrees = degrees + turn;
                // The turn that is shorter than half a circle.
                Facing::Degrees(degrees - (degrees / 360.0).round() * 360.0)
            }
            (facing, _) => facing,
        };
        Places {
            path: (!path.is_empty()).then(|| GroundPath::of_checked(path)),
            facing,
            reaches,
            poses,
        }
    }

    /// Measures how near a stretch comes to the places at its frames, as they are asked for in the whole motion of `length` frames.
    pub fn outcomes(
        &self,
        frames: &Range<usize>,
        length: usize,
        motion: &Motion,
    ) -> Vec<PlaceOutcome> {
        let back = self.start.to(&Placement::ORIGIN);
        let poses = motion.joints().iter();
        let poses: Vec<_> = poses
            .map(|pose| pose.map(|point| back.of_point(point)))
            .collect();
        outcome::outcomes(&self.places, &poses, |seconds| {
            let frame = frame_within(seconds, length);
            frames.contains(&frame).then(|| frame - frames.start)
        })
    }
}

/// Returns the frame of a moment in a motion of `length` frames, of which the end is the last frame. A moment further on has a frame
/// beyond the motion.
fn frame_within(seconds: f32, length: usize) -> usize {
    match frame_of(seconds) {
        frame if frame == length => length.saturating_sub(1),
        frame => frame,
    }
}

/// Returns places in the order of their moments.
fn in_time<T>(places: &[T], seconds: impl Fn(&T) -> f32) -> Vec<&T> {
    let mut places: Vec<&T> = places.iter().collect();
    places.sort_by(|a, b| seconds(a).total_cmp(&seconds(b)));
    places
}

/// Returns the points of a path that a stretch with these frames passes: those that are asked for at its frames and, where there are
/// some beyond it, two at its end on the smooth way to them. `track` is where the pelvis was at the frames before, and `later` are
/// all points from the first frame of the stretch on.
fn way(
    track: &[[f64; 2]],
    later: &[(usize, [f32; 2])],
    frames: &Range<usize>,
) -> Vec<(usize, [f32; 2])> {
    let within = later.partition_point(|(frame, _)| *frame < frames.end);
    let mut points = later[..within].to_vec();
    if within == later.len() {
        return points;
    }
    // A second before is a whole step of a walk or more, so that its sway hardly counts.
    let mut knots = match track {
        [] => vec![(0.0, [0.0; 2])],
        [last] => vec![(-1.0, *last)],
        [first, .., last] => vec![(-(track.len() as f64), *first), (-1.0, *last)],
    };
    for (frame, place) in later {
        let time = (frame - frames.start) as f64;
        if time > knots[knots.len() - 1].0 {
            knots.push((time, place.map(f64::from)));
        }
    }
    let spline = CubicSpline::new(&knots);
    let last = frames.end - 1;
    for frame in [last.saturating_sub(WAY_FRAMES), last] {
        let is_taken = |(other, _): &(usize, [f32; 2])| other.abs_diff(frame) < WAY_FRAMES / 2;
        let has_room = frame >= frames.start + WAY_FRAMES / 2 && !points.iter().any(is_taken);
        let is_free = points.iter().all(|(other, _)| *other != frame);
        if has_room || (frame == last && is_free) {
            let [x, z] = spline.at((frame - frames.start) as f64);
            points.push((frame, [x as f32, z as f32]));
        }
    }
    points.sort_unstable_by_key(|(frame, _)| *frame);
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::testing::pose;

    fn places(path: &str, reaches: &[&str]) -> Places {
        Places {
            path: (!path.is_empty()).then(|| path.parse().unwrap()),
            reaches: reaches.iter().map(|text| text.parse().unwrap()).collect(),
            ..Places::default()
        }
    }

    fn points(places: &Places) -> Vec<(f32, [f32; 2])> {
        let points = places.path.iter().flat_map(GroundPath::waypoints);
        points.map(|point| (point.seconds, point.place)).collect()
    }

    fn close(found: f32, expected: f32, by: f32) {
        assert!((found - expected).abs() < by, "{found} {expected}");
    }

    #[test]
    fn the_first_stretch_has_the_places_at_its_frames_and_goes_on_to_the_next() {
        let all = Itinerary::new(
            places("0:0,0 8:0,8", &["head@1=0,1.6,1", "head@5=0,1.2,5"]),
            None,
        );
        let first = all.section(&(0..80), 200, &[]);
        // A straight way at 1 m/s.
        let expected = [(0.0, 0.0), (3.45, 3.45), (3.95, 3.95)];
        assert_eq!(points(&first).len(), 3);
        for ((seconds, place), expected) in points(&first).into_iter().zip(expected) {
            assert_eq!(seconds, expected.0);
            close(place[0], 0.0, 1e-4);
            close(place[1], expected.1, 1e-4);
        }
        assert_eq!(first.reaches, places("", &["head@1=0,1.6,1"]).reaches);
        assert_eq!(all.frames(200), [0, 20, 100, 160]);
        // Past its last place a path asks for nothing.
        let before = [pose([0.0, 8.0], 0.0)];
        assert!(all.section(&(170..200), 200, &before).is_empty());
    }

    #[test]
    fn places_of_a_later_stretch_are_counted_from_its_beginning() {
        // The body has gone ahead for four seconds, and faces left at (1, 3) now.
        let quarter = std::f32::consts::FRAC_PI_2;
        let before: Vec<_> = (0..20)
            .map(|t| pose([1.0 - 0.05 * (19 - t) as f32, 3.0], quarter))
            .collect();
        let asked = Places {
            facing: Facing::Degrees(-160.0),
            ..places("2:0,2 5:2,3 7:2,4", &["head@5.5=2,1.5,3.5"])
        };
        let own = Itinerary::new(asked, None).section(&(80..140), 140, &before);
        // Forward is to the left of the start, and left is back. The moment at the end is the last frame.
        let expected = [(1.0, [0.0, 1.0]), (2.95, [-1.0, 1.0])];
        assert_eq!(points(&own).len(), expected.len());
        for ((seconds, place), (at, [x, z])) in points(&own).into_iter().zip(expected) {
            close(seconds, at, 1e-6);
            close(place[0], x, 1e-5);
            close(place[1], z, 1e-5);
        }
        close(own.reaches[0].seconds(), 1.5, 1e-6);
        close(own.reaches[0].position()[0], -0.5, 1e-5);
        // -160° from the start are -250° from here, which is 110° to the left.
        assert!(matches!(own.facing, Facing::Degrees(degrees) if (degrees - 110.0).abs() < 1e-3));
    }

    #[test]
    fn a_way_passes_the_border_of_two_stretches_at_its_speed() {
        // A curve, whose place at the border belongs to the second stretch.
        let all = Itinerary::new(places("0:0,0 2:1,2 4:3,2 6:4,0", &[]), None);
        let first = points(&all.section(&(0..80), 120, &[]));
        let at = |index: usize| first[first.len() - 2 + index];
        assert_eq!([at(0).0, at(1).0], [3.45, 3.95]);
        let speed: Vec<f32> = (0..2)
            .map(|axis| (at(1).1[axis] - at(0).1[axis]) / 0.5)
            .collect();
        // A step further on the body is where it was asked to be.
        close(at(1).1[0] + 0.05 * speed[0], 3.0, 0.01);
        close(at(1).1[1] + 0.05 * speed[1], 2.0, 0.02);
    }

    #[test]
    fn a_position_at_a_border_is_reached_on_both_sides_of_it() {
        let all = Itinerary::new(places("", &["head@4=0,1,2", "left-hand@4.2=0,1,2"]), None);
        let first = all.section(&(0..80), 160, &[]);
        assert_eq!(first.reaches, places("", &["head@3.95=0,1,2"]).reaches);
        let second = all.section(&(80..160), 160, &[pose([0.0, 0.0], 0.0)]);
        assert_eq!(second.reaches.len(), 2);
        assert_eq!(second.reaches[0].seconds(), 0.0);
    }

    #[test]
    fn outcomes_are_those_of_the_whole_motion() {
        // The motion goes on from a body that stands at (0, 1) and faces left.
        let quarter = std::f32::consts::FRAC_PI_2;
        let after = Placement::of(&pose([0.0, 1.0], quarter));
        let all = Itinerary::new(places("0:0,0 1:0,1 3:0,3", &[]), Some(after));
        assert_eq!(all.frames(60), [20, 59]);
        let motion = |from: usize| {
            let poses = (from..from + 30).map(|t| pose([0.05 * t as f32, 1.0], quarter));
            Motion::from_joints(poses.collect()).unwrap()
        };
        let [first, second] =
            [0, 30].map(|start| all.outcomes(&(start..start + 30), 60, &motion(start)));
        assert_eq!((first.len(), second.len()), (1, 1));
        assert_eq!(first[0].seconds, 1.0);
        close(first[0].distance(), 0.0, 1e-5);
        close(second[0].reached[2], 2.95, 1e-5);
    }
}
