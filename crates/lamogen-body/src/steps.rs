//! Steps in the place of feet that slide far.

use glam::DVec3;
use lamogen_motion::{JOINTS, Joint};

use crate::contacts::{FEET, FootContact, SWING_HEIGHT};

/// The number of frames in which a foot swings from one standing place to the next: a quarter of a second.
const SWING_FRAMES: usize = 5;
/// Contacts with fewer frames than this are left out.
const MIN_CONTACT_FRAMES: usize = 2;

/// Replaces contacts in which a foot slides further than `stride` metres along the ground by shorter ones, at the places
/// where the foot is on its way, with swings between them. The feet take turns.
///
/// Where a foot stands throughout, one contact would hold it back while the body goes on.
pub(crate) fn break_into_steps(
    contacts: Vec<FootContact>,
    poses: &[[DVec3; JOINTS]],
    stride: f64,
) -> Vec<FootContact> {
    let all = contacts.into_iter().flat_map(|contact| {
        let at = |frame: usize| poses[frame][contact.joint.index()] * DVec3::new(1.0, 0.0, 1.0);
        let displacement = at(contact.until - 1) - at(contact.from);
        match displacement.length() > stride {
            true => steps(&contact, &at, stride),
            false => vec![contact],
        }
    });
    all.collect()
}

/// Returns the contacts that replace one. `at` returns the place of the joint on the ground at a frame.
fn steps(contact: &FootContact, at: &dyn Fn(usize) -> DVec3, stride: f64) -> Vec<FootContact> {
    // Ways are counted from the first frame of the motion, so that ankle and ball of a foot step together, and one foot
    // steps half a stride after the other.
    let is_left = matches!(contact.joint, Joint::LeftAnkle | Joint::LeftFoot);
    let mut way = if is_left { 0.0 } else { 0.5 * stride };
    let mut numbers = Vec::with_capacity(contact.until);
    for frame in 0..contact.until {
        if frame > 0 {
            way += at(frame).distance(at(frame - 1));
        }
        numbers.push((way / stride) as usize);
    }
    let mut steps = Vec::new();
    let mut from = contact.from;
    for number in numbers[contact.from..].chunk_by(|a, b| a == b) {
        let until = from + number.len();
        // Half of each swing is before a step's place, and half after it.
        let first = match from == contact.from {
            true => from,
            false => from + SWING_FRAMES - SWING_FRAMES / 2,
        };
        let last = match until == contact.until {
            true => until,
            false => until.saturating_sub(SWING_FRAMES / 2),
        };
        if last >= first + MIN_CONTACT_FRAMES {
            let place = (first..last).map(at).sum::<DVec3>() / (last - first) as f64;
            steps.push(FootContact {
                joint: contact.joint,
                from: first,
                until: last,
                position: [place.x, contact.position[1], place.z],
            });
        }
        from = until;
    }
    steps
}

/// Sets how high the balls of the feet have to be where contacts were broken into steps. `least` holds the least height of
/// each foot at every frame, in metres; `contacts` are those before and those after.
pub(crate) fn lift_between_steps(
    least: &mut [[f64; 2]],
    contacts: [&[FootContact]; 2],
    ground: f64,
) {
    for (side, foot) in FEET.into_iter().enumerate() {
        let stands = |contacts: &[FootContact]| {
            let mut stands = vec![false; least.len()];
            for contact in contacts.iter().filter(|contact| contact.joint == foot) {
                stands[contact.from..contact.until].fill(true);
            }
            stands
        };
        let [before, after] = contacts.map(stands);
        let swings: Vec<bool> = before.iter().zip(after).map(|(a, b)| *a && !b).collect();
        let mut from = 0;
        for run in swings.chunk_by(|a, b| a == b) {
            if run[0] {
                for (k, least) in least[from..from + run.len()].iter_mut().enumerate() {
                    let part = (k + 1) as f64 / (run.len() + 1) as f64;
                    let height = SWING_HEIGHT * (std::f64::consts::PI * part).sin();
                    least[side] = least[side].max(ground + height);
                }
            }
            from += run.len();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a contact of a joint that slides so many metres forward in 60 frames, and its poses.
    fn slide(joint: Joint, metres: f64) -> (FootContact, Vec<[DVec3; JOINTS]>) {
        let pose = |t: usize| [DVec3::new(0.0, 0.02, metres * t as f64 / 59.0); JOINTS];
        let contact = FootContact {
            joint,
            from: 0,
            until: 60,
            position: [0.0, 0.02, metres / 2.0],
        };
        (contact, (0..60).map(pose).collect())
    }

    #[test]
    fn a_foot_that_slides_far_takes_steps_and_the_feet_take_turns() {
        let broken = |joint| {
            let (contact, poses) = slide(joint, 2.0);
            break_into_steps(vec![contact], &poses, 0.5)
        };
        let [left, right] = [Joint::LeftFoot, Joint::RightFoot].map(broken);
        for steps in [&left, &right] {
            assert!((4..=5).contains(&steps.len()), "{steps:?}");
            for step in steps {
                // Each stands in the middle of its part of the way.
                let middle = 2.0 * (step.from + step.until - 1) as f64 / 2.0 / 59.0;
                assert!((step.position[2] - middle).abs() < 1e-9);
                assert_eq!(step.position[1], 0.02);
            }
            for pair in steps.windows(2) {
                assert_eq!(pair[1].from - pair[0].until, SWING_FRAMES);
            }
        }
        // A foot that swings clears the ground.
        let mut least = vec![[f64::NEG_INFINITY; 2]; 60];
        let (contact, _) = slide(Joint::LeftFoot, 2.0);
        lift_between_steps(&mut least, [&[contact], &left], 0.1);
        let middle = (left[0].until + left[1].from) / 2;
        assert!(
            (least[middle][0] - 0.1 - SWING_HEIGHT).abs() < 1e-9,
            "{least:?}"
        );
        assert_eq!(least[left[1].from][0], f64::NEG_INFINITY);
        // While one foot swings, the other stands.
        for pair in left.windows(2) {
            let middle = (pair[0].until + pair[1].from) / 2;
            let stands = |step: &FootContact| (step.from..step.until).contains(&middle);
            assert!(right.iter().any(stands), "{left:?} {right:?}");
        }
    }

    #[test]
    fn a_foot_that_slides_little_is_held() {
        let (contact, poses) = slide(Joint::LeftAnkle, 0.4);
        let same = break_into_steps(vec![contact.clone()], &poses, 0.5);
        assert_eq!(same, [contact]);
    }
}
