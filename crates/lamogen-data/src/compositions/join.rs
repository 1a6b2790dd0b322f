//! Two motions become one.

use lamogen_motion::{JOINTS, Placement, Rotations};

use super::part::{LocalPose, between};

/// The frames in which one motion passes into the next, 0.4 s.
const OVERLAP: usize = 8;
/// The frames at the end of the first motion and at the start of the second among which the best join is sought, 0.5 s.
const SEARCHED: usize = 10;
/// The least length of a motion that is joined to another: between two joins, less would be left of it than it says.
const SHORTEST: usize = 3 * OVERLAP;
/// The greatest mean distance of joints in the overlap, in metres. Motions that are farther apart are not joined.
const NEAR: f32 = 0.16;
/// What a frame that is cut off counts as, in metres: where poses are equally alike, little is cut off.
const PER_CUT_FRAME: f32 = 0.001;

/// Joins two motions at the frames near their ends at which their poses are most alike; the second is moved along the
/// ground to go on from the first.
///
/// No more than a sixth of either is cut off. Returns none if they are nowhere alike, or one of them is shorter than 1.2 s.
pub(super) fn join(first: &Rotations, second: &Rotations) -> Option<Rotations> {
    let [before, after] = [first, second].map(Rotations::joints);
    if before.len().min(after.len()) < SHORTEST {
        return None;
    }
    let mut best: Option<(f32, usize, usize)> = None;
    let last = before.len() - OVERLAP;
    let [most_before, most_after] = [&before, &after].map(|poses| SEARCHED.min(poses.len() / 6));
    for end in last - most_before..=last {
        for start in 0..=most_after {
            let distance = overlap_distance(&before[end..][..OVERLAP], &after[start..][..OVERLAP]);
            let distance = distance + PER_CUT_FRAME * (last - end + start) as f32;
            if best.is_none_or(|(least, ..)| distance < least) {
                best = Some((distance, end, start));
            }
        }
    }
    let (_, end, start) = best.filter(|(distance, ..)| *distance <= NEAR)?;
    let from = Placement::of(&after[start + OVERLAP / 2]);
    let to = Placement::of(&before[end + OVERLAP / 2]);
    let second = from
        .to(&to)
        .of_rotations(&second.between(start..second.frames()));
    let mut root = first.root()[..end].to_vec();
    let mut local = first.local()[..end].to_vec();
    for frame in 0..OVERLAP {
        let share = (frame + 1) as f32 / (OVERLAP + 1) as f32;
        let share = share * share * (3.0 - 2.0 * share);
        let [a, b] = [first.root()[end + frame], second.root()[frame]];
        root.push(std::array::from_fn(|axis| {
            a[axis] + share * (b[axis] - a[axis])
        }));
        let [a, b]: [&LocalPose; 2] = [&first.local()[end + frame], &second.local()[frame]];
        local.push(std::array::from_fn(|joint| {
            between(a[joint], b[joint], f64::from(share))
        }));
    }
    let rate = first.frames_per_second();
    let joined = Rotations::new(first.rest().clone(), root, local, rate);
    Some(joined.followed_by(&second.between(OVERLAP..second.frames())))
}

/// Returns the mean distance of the joints of two overlapping stretches, when the middle of the second is put where
/// that of the first is.
fn overlap_distance(first: &[[[f32; 3]; JOINTS]], second: &[[[f32; 3]; JOINTS]]) -> f32 {
    let middle = OVERLAP / 2;
    let ground = Placement::of(&second[middle]).to(&Placement::of(&first[middle]));
    let pairs = first.iter().flatten().zip(second.iter().flatten());
    let distances = pairs.map(|(a, b)| {
        let b = ground.of_point(*b);
        let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
        squares.sum::<f32>().sqrt()
    });
    distances.sum::<f32>() / (OVERLAP * JOINTS) as f32
}
