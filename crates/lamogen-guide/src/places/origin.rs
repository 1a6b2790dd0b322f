//! Where places are counted from, in a motion with known frames before and after those that are made.

use std::ops::Range;

use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Placement};

use super::ground_path::{GroundPath, Waypoint};
use super::{Facing, Places, frame_at};

/// Where the places of a motion are counted from, if some of its frames are known before it is made: moments from the first frame
/// that is made, and positions from where the body stands and faces at the last known frame before it.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaceOrigin {
    /// The frames that are made; those before and after them are known.
    made: Range<usize>,
    /// Where the pelvis is along the ground at each known frame before, x and z.
    track: Vec<[f64; 2]>,
    /// Where the body stands at the last of them.
    placement: Placement,
}

impl PlaceOrigin {
    /// Creates the origin of a motion of which the frames `made` are made. `before` are the joint positions of the known frames
    /// before them in metres, where the whole motion is; there may be none.
    pub fn new(before: &[[[f32; 3]; JOINTS]], made: Range<usize>) -> PlaceOrigin {
        let pelvis = before.iter().map(|pose| pose[Joint::Pelvis.index()]);
        PlaceOrigin {
            made,
            track: pelvis.map(|[x, _, z]| [x, z].map(f64::from)).collect(),
            placement: before.last().map_or(Placement::ORIGIN, Placement::of),
        }
    }

    /// Returns where the pelvis is along the ground at each known frame before those that are made, x and z.
    pub(super) fn track(&self) -> &[[f64; 2]] {
        &self.track
    }

    /// Returns where the body faces at the last known frame before those that are made, in radians to the left of +Z.
    pub(super) fn heading(&self) -> f64 {
        self.placement.heading()
    }

    /// Returns the poses of the frames that are made as they are seen from the origin.
    pub(super) fn seen(&self, poses: &[[[f32; 3]; JOINTS]]) -> Vec<[[f32; 3]; JOINTS]> {
        let back = self.placement.to(&Placement::ORIGIN);
        let made = poses[self.made.clone()].iter();
        made.map(|pose| pose.map(|point| back.of_point(point)))
            .collect()
    }

    /// Moves places that are counted from the origin to where they are in the whole motion.
    pub(super) fn places(&self, places: &Places) -> Places {
        let from_origin = Placement::ORIGIN.to(&self.placement);
        let seconds = |seconds: f32| {
            (self.made.start + frame_at(seconds, self.made.len())) as f32 / FRAMES_PER_SECOND
        };
        let facing = match places.facing {
            Facing::Degrees(degrees) => {
                Facing::Degrees(degrees + self.heading().to_degrees() as f32)
            }
            facing => facing,
        };
        let reaches = places.reaches.iter();
        let poses = places.poses.iter();
        let path = self.asked_path(places).map(|path| {
            let moved = path.into_iter().map(|point| {
                let [x, _, z] = from_origin.of_point([point.place[0], 0.0, point.place[1]]);
                Waypoint {
                    seconds: seconds(point.seconds),
                    place: [x, z],
                }
            });
            GroundPath::of_checked(moved.collect())
        });
        Places {
            path,
            facing,
            reaches: reaches
                .map(|reach| {
                    let position = from_origin.of_point(reach.position());
                    reach.moved(seconds(reach.seconds()), position)
                })
                .collect(),
            poses: poses
                .map(|pose| pose.moved(seconds(pose.seconds())))
                .collect(),
        }
    }

    /// Returns the places of a path that a motion is asked for; `None` if there are none. Where a body goes on from known frames,
    /// these decide where it is at the first frame that is made.
    fn asked_path(&self, places: &Places) -> Option<Vec<Waypoint>> {
        let is_asked = |point: &&Waypoint| {
            self.track.is_empty() || frame_at(point.seconds, self.made.len()) > 0
        };
        let points = places.path.iter().flat_map(GroundPath::waypoints);
        let asked: Vec<Waypoint> = points.filter(is_asked).copied().collect();
        (!asked.is_empty()).then_some(asked)
    }

    /// Returns the places that a motion is asked for, counted from the origin.
    pub(super) fn asked(&self, places: &Places) -> Places {
        Places {
            path: self.asked_path(places).map(GroundPath::of_checked),
            ..places.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::testing::pose;
    use crate::places::{KeyPose, Reach, ReachPart};

    #[test]
    fn places_are_counted_from_where_the_known_frames_end() {
        // Ten known frames that end at (2, 1), facing left; forty are made, and five known ones follow.
        let quarter = std::f32::consts::FRAC_PI_2;
        let before: Vec<_> = (0..10)
            .map(|t| pose([2.0 - 0.1 * (9 - t) as f32, 1.0], quarter))
            .collect();
        let origin = PlaceOrigin::new(&before, 10..50);
        assert_eq!(origin.track().len(), 10);
        let places = Places {
            path: Some("0:0,0 1:0,2 2:1,3".parse().unwrap()),
            facing: Facing::Degrees(10.0),
            reaches: vec![Reach::new(ReachPart::Head, 0.5, [0.5, 1.6, 1.0]).unwrap()],
            poses: vec![KeyPose::new(1.5, pose([0.0, 0.0], 0.0)).unwrap()],
        };
        let moved = origin.places(&places);
        let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
        // Forward is now to the left of the start, and left is back. The end is the last frame that is made.
        let points = moved.path.as_ref().unwrap().waypoints();
        let expected = [(1.5, [4.0, 1.0]), (2.45, [5.0, 0.0])];
        assert_eq!(points.len(), expected.len());
        for (point, (seconds, place)) in points.iter().zip(expected) {
            close(point.seconds, seconds);
            close(point.place[0], place[0]);
            close(point.place[1], place[1]);
        }
        assert!(matches!(moved.facing, Facing::Degrees(degrees) if (degrees - 100.0).abs() < 1e-3));
        close(moved.reaches[0].seconds(), 1.0);
        for (found, expected) in moved.reaches[0].position().into_iter().zip([3.0, 1.6, 0.5]) {
            close(found, expected);
        }
        close(moved.poses[0].seconds(), 2.0);
        // The way back.
        let all = vec![pose([4.0, 1.0], quarter); 55];
        let seen = origin.seen(&all);
        assert_eq!(seen.len(), 40);
        let pelvis = seen[0][Joint::Pelvis.index()];
        close(pelvis[0], 0.0);
        close(pelvis[2], 2.0);
    }

    #[test]
    fn without_known_frames_before_places_stay_where_they_are() {
        let origin = PlaceOrigin::new(&[], 0..40);
        let places = Places {
            path: Some("0:0,0 2:1,3".parse().unwrap()),
            ..Places::default()
        };
        let moved = origin.places(&places);
        let points = moved.path.as_ref().unwrap().waypoints();
        assert_eq!(points[0].place, [0.0, 0.0]);
        assert_eq!((points[1].seconds, points[1].place), (1.95, [1.0, 3.0]));
    }
}
