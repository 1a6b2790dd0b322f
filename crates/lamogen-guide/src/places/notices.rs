//! What is unusual about places. Motions through them are made all the same.

use super::ground_path::{GroundPath, Waypoint};
use super::reach::{Reach, ReachPart};
use super::{Places, frame_of};

/// The speed of a run in metres a second, above which a way is said to be fast.
const FAST: f32 = 3.0;
/// How far from the pelvis along the ground a hand, a foot or the head of a body gets that bends and stretches, in metres.
const OUTSTRETCHED: f32 = 1.0;
/// The depth below the floor in metres from which a position is said to be there.
const BELOW_FLOOR: f32 = 0.1;

/// Returns the height in metres that a part of the body gets to in a high jump or kick.
const fn highest(part: ReachPart) -> f32 {
    match part {
        ReachPart::LeftHand | ReachPart::RightHand => 2.3,
        ReachPart::LeftFoot | ReachPart::RightFoot => 1.9,
        ReachPart::Head => 2.0,
    }
}

/// Returns what is unusual about places, in sentences.
pub(super) fn notices(places: &Places) -> Vec<String> {
    let heights = places.reaches.iter().filter_map(height_notice);
    path_notices(places)
        .into_iter()
        .chain(heights)
        .chain(reach_notices(places))
        .collect()
}

/// A place on the ground at a moment, and how far from it the pelvis may be.
#[derive(Clone, Copy)]
struct Knot<'a> {
    seconds: f32,
    place: [f32; 2],
    slack: f32,
    reach: Option<&'a Reach>,
}

impl<'a> Knot<'a> {
    /// Where every motion starts.
    const START: Knot<'a> = Knot::of(&Waypoint {
        seconds: 0.0,
        place: [0.0; 2],
    });

    const fn of(waypoint: &Waypoint) -> Knot<'a> {
        Knot {
            seconds: waypoint.seconds,
            place: waypoint.place,
            slack: 0.0,
            reach: None,
        }
    }

    /// Returns the way in metres that the pelvis has to go to another place at least.
    fn way(&self, to: &Knot<'_>) -> f32 {
        let distance = (to.place[0] - self.place[0]).hypot(to.place[1] - self.place[1]);
        (distance - self.slack - to.slack).max(0.0)
    }

    /// Returns whether two places have the same frame.
    fn is_at_once(&self, other: &Knot<'_>) -> bool {
        frame_of(self.seconds) == frame_of(other.seconds)
    }
}

/// Returns a sentence for each part of the path that is faster than a run.
fn path_notices(places: &Places) -> Vec<String> {
    let points = places.path.iter().flat_map(GroundPath::waypoints);
    let knots: Vec<Knot<'_>> = std::iter::once(Knot::START)
        .chain(points.map(Knot::of))
        .collect();
    let parts = knots.windows(2).filter_map(|pair| {
        let [from, to] = [pair[0], pair[1]];
        let speed = from.way(&to) / (to.seconds - from.seconds);
        (speed > FAST).then(|| {
            format!(
                "The path goes {speed:.1} m/s from {} s to {} s, faster than the {FAST} m/s of a run: feet may slide there.",
                from.seconds, to.seconds
            )
        })
    });
    parts.collect()
}

/// Returns a sentence if a position is higher than a body gets, or below the floor.
fn height_notice(reach: &Reach) -> Option<String> {
    let height = reach.position()[1];
    let highest = highest(reach.part());
    if height > highest {
        return Some(format!(
            "{reach} is {height} m above the floor, higher than the {highest} m of a high jump or kick: the body will leave the ground to get there."
        ));
    }
    (height < -BELOW_FLOOR).then(|| {
        format!(
            "{reach} is {} m below the floor: the body will sink into it.",
            -height
        )
    })
}

/// Returns a sentence for each position that a body has to rush to, or away from, or that is out of reach from the path.
fn reach_notices(places: &Places) -> Vec<String> {
    let points = places.path.iter().flat_map(GroundPath::waypoints);
    let reaches = places.reaches.iter().map(|reach| {
        let [x, _, z] = reach.position();
        Knot {
            seconds: reach.seconds(),
            place: [x, z],
            slack: OUTSTRETCHED,
            reach: Some(reach),
        }
    });
    let mut knots: Vec<Knot<'_>> = { std::iter::once(Knot::START) }
        .chain(points.map(Knot::of))
        .chain(reaches)
        .collect();
    knots.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    let pairs = knots.windows(2).filter_map(|pair| {
        let [from, to] = [pair[0], pair[1]];
        let way = from.way(&to);
        let (reach, other) = match (from.reach, to.reach) {
            (_, Some(reach)) => (reach, from),
            (Some(reach), None) => (reach, to),
            (None, None) => return None,
        };
        if from.is_at_once(&to) {
            return (way > 0.0).then(|| {
                let other = name(&other);
                format!("{reach} is {way:.1} m further from {other} than a body reaches: it will rush or leave the ground.")
            });
        }
        let speed = way / (to.seconds - from.seconds);
        (speed > FAST).then(|| {
            format!(
                "The way from {} to {} takes {speed:.1} m/s, faster than the {FAST} m/s of a run: feet may slide there.",
                name(&from),
                name(&to)
            )
        })
    });
    pairs.collect()
}

/// Returns what messages call a place.
fn name(knot: &Knot<'_>) -> String {
    let [x, z] = knot.place;
    match knot.reach {
        Some(reach) => reach.to_string(),
        None if knot.seconds == 0.0 => "the start".to_owned(),
        None => format!("the place {}:{x},{z} of the path", knot.seconds),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notices_of(path: &str, reaches: &[&str]) -> Vec<String> {
        let places = Places {
            path: (!path.is_empty()).then(|| path.parse().unwrap()),
            reaches: reaches.iter().map(|text| text.parse().unwrap()).collect(),
            ..Places::default()
        };
        places.notices()
    }

    /// Asserts that there is one notice with all of the parts.
    fn one(notices: &[String], parts: &[&str]) {
        assert_eq!(notices.len(), 1, "{notices:?}");
        for part in parts {
            assert!(notices[0].contains(part), "{notices:?}");
        }
    }

    #[test]
    fn fast_parts_of_a_path_are_named() {
        one(
            &notices_of("0:0,0 1:0,2 2:0,6", &[]),
            &["4.0 m/s from 1 s to 2 s"],
        );
        // The way from the start to the first place counts too.
        one(&notices_of("0.5:0,3", &[]), &["6.0 m/s from 0 s to 0.5 s"]);
    }

    #[test]
    fn positions_that_a_body_reaches_are_not_named() {
        for (path, reaches) in [
            ("", &["right-hand@1.5=-0.3,1.6,0.5"][..]),
            ("0:0,0 2:1,0 4:1,2", &["left-hand@3=1.3,1.4,1.2"]),
            (
                "",
                &[
                    "left-foot@1=0.1,1.4,0.8",
                    "head@2=0,0.3,0.4",
                    "head@2.5=0,1.9,0",
                ],
            ),
            ("", &["left-hand@3=0,1,6", "right-hand@3=0.6,1,6"]),
        ] {
            assert_eq!(notices_of(path, reaches), Vec::<String>::new());
        }
    }

    #[test]
    fn positions_out_of_reach_are_named() {
        one(
            &notices_of("", &["right-hand@1=0,100,0"]),
            &["right-hand@1=0,100,0 is 100 m above", "2.3 m"],
        );
        one(&notices_of("", &["left-foot@1=0,2,0"]), &["1.9 m"]);
        one(
            &notices_of("", &["head@1=0,-1,0"]),
            &["1 m below the floor"],
        );
        one(
            &notices_of("", &["head@1=0,1,9"]),
            &["from the start to head@1=0,1,9 takes 8.0 m/s"],
        );
        one(
            &notices_of("0:0,0 2:0,2", &["left-hand@2=4,1,2"]),
            &["left-hand@2=4,1,2 is 3.0 m further from the place 2:0,2 of the path"],
        );
        one(
            &notices_of("", &["left-hand@3=0,1,6", "right-hand@3=-4,1,6"]),
            &["right-hand@3=-4,1,6 is 2.0 m further from left-hand@3=0,1,6"],
        );
        one(
            &notices_of("3:0,0", &["left-hand@2=0,1,6"]),
            &["from left-hand@2=0,1,6 to the place 3:0,0 of the path takes 5.0 m/s"],
        );
    }
}
