//! Motions that are made a stretch at a time, each going on from the one before.
//!
//! ```text
//! sentences     | a person walks forward            | a person jumps    | …
//! stretches     |-----------------|-----------------|-------------------|
//!                                ·|                ·|
//!                                 a stretch begins with the last 0.4 seconds of the one before, which it does not change
//! ```

use std::cmp::Reverse;
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use lamogen_guide::{Itinerary, Places};
use lamogen_laban::Goals;
use lamogen_motion::{Motion, Placement};

use crate::neighbours::{KNOWN_FRAMES, Predecessor, StretchEnd};
use crate::request::Request;

/// Some of the frames of a sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Section {
    /// The place of the sentence.
    pub(crate) sentence: usize,
    /// The frames among those of the sentence.
    pub(crate) frames: Range<usize>,
}

/// A sentence with its goals, of a motion that is made a stretch at a time.
#[derive(Clone, Debug)]
pub(crate) struct Sentence {
    pub(crate) prompt: String,
    pub(crate) frames: usize,
    pub(crate) goals: Option<Goals>,
}

impl Section {
    /// Returns the request of these frames of a sentence, with nothing but its goals.
    pub(crate) fn request(&self, sentence: &Sentence) -> Request {
        let goals = { sentence.goals.as_ref() }
            .map(|goals| goals.section(self.frames.clone(), sentence.frames));
        Request {
            goals,
            ..Request::new(&sentence.prompt).frames(self.frames.len())
        }
    }
}

/// Cuts sentences of these lengths into stretches of at most `longest` frames. A sentence that is longer than a stretch has
/// stretches of its own, which are equally long and have at least half as many frames, but for what keeps a border away from the
/// frames `places` of the whole motion, which are in the order of time ([`sections`]).
pub(crate) fn stretches(lengths: &[usize], longest: usize, places: &[usize]) -> Vec<Vec<Section>> {
    let mut stretches: Vec<Vec<Section>> = Vec::new();
    let mut free = 0;
    let mut start = 0;
    for (sentence, &length) in lengths.iter().enumerate() {
        let own = places_from(start, places);
        start += length;
        for frames in sections(length, 1..=longest, &own) {
            let section = Section { sentence, frames };
            let needed = section.frames.len();
            match stretches.last_mut().filter(|_| needed <= free) {
                Some(stretch) => {
                    free -= needed;
                    stretch.push(section);
                }
                None => {
                    free = longest.saturating_sub(needed);
                    stretches.push(vec![section]);
                }
            }
        }
    }
    stretches
}

/// Returns the frames of places from a frame on, counted from there.
pub(crate) fn places_from(start: usize, places: &[usize]) -> Vec<usize> {
    let later = places.iter().filter_map(|place| place.checked_sub(start));
    later.collect()
}

/// The number of frames by which a border of two sections is moved at most, so that a place does not follow it too closely.
const BORDER_SHIFT: usize = 10;
/// The number of frames that a body should have from the border of a section to the next place.
const WAY_TO_PLACE: usize = 20;

/// Cuts a sentence into the fewest equally long sections of these lengths; into longer ones, where these would be too short. Borders
/// are moved a little, and a section may be as much longer, where one of the frames `places` follows a border closely: what leads
/// to a place has to begin before it. These are in the order of time.
pub(crate) fn sections(
    length: usize,
    lengths: RangeInclusive<usize>,
    places: &[usize],
) -> Vec<Range<usize>> {
    let shortest = (*lengths.start()).max(1);
    let most = (length / shortest).max(1);
    let count = length.div_ceil(*lengths.end()).clamp(1, most);
    let longest = length.div_ceil(count).max(*lengths.end()) + BORDER_SHIFT;
    let mut borders = vec![0];
    for section in 1..count {
        let even = length * section / count;
        let (before, rest) = (borders[section - 1], count - section);
        let first = (before + shortest).max(length.saturating_sub(rest * longest));
        let last = (before + longest).min(length - rest * shortest);
        let way = |border: &usize| {
            let next = places.partition_point(|place| place < border);
            { places.get(next) }.map_or(WAY_TO_PLACE, |place| (place - border).min(WAY_TO_PLACE))
        };
        let near = even.saturating_sub(BORDER_SHIFT).max(first)..=(even + BORDER_SHIFT).min(last);
        let best = near.max_by_key(|border| (way(border), Reverse(border.abs_diff(even))));
        borders.push(best.unwrap_or(even));
    }
    borders.push(length);
    borders.windows(2).map(|pair| pair[0]..pair[1]).collect()
}

/// Returns the places of a request's motion, which is made a stretch at a time.
pub(crate) fn itinerary(request: &Request, places: Places) -> Itinerary {
    let after = request.after.as_ref().map(Predecessor::last_frames);
    let placement = after.and_then(|frames| frames.last().map(Placement::of));
    Itinerary::new(places, placement)
}

/// The number of frames that are made of a guided stretch beyond its end: half a second.
const AHEAD: usize = 10;

/// Returns the number of frames that are made of a stretch beyond its end. The last place of a stretch is often its last frame; a body
/// that is led there and no further arrives with a jerk. So does one with other goals, because the features of its last frames are
/// made of few of them: it rushes out of the stretch.
pub(crate) fn ahead(is_guided: bool) -> usize {
    if is_guided { AHEAD } else { 0 }
}

/// Returns the places of the stretch that has these frames of a motion of `length` frames; `request` is that of the stretch.
pub(crate) fn section_places(
    itinerary: &Itinerary,
    (frames, length): (&Range<usize>, usize),
    request: &Request,
) -> Places {
    let before = request.after.as_ref().map(Predecessor::last_frames);
    itinerary.section(frames, length, before.unwrap_or_default())
}

/// Returns the request of a stretch: its sentences, with the options of the request of the whole motion but its places.
///
/// The start noise of each stretch has a seed of its own.
pub(crate) fn stretch_request(
    options: &Request,
    sentences: impl IntoIterator<Item = Request>,
    index: usize,
    end: Option<StretchEnd>,
) -> Request {
    let mut sentences = sentences.into_iter();
    let first = sentences.next().expect("a stretch has a sentence");
    let request = Request {
        prompt: first.prompt,
        length: first.length,
        goals: first.goals,
        tags: Vec::new(),
        parts: Vec::new(),
        following: Vec::new(),
        seed: seed(options.seed, index),
        after: match end {
            Some(end) => Some(Predecessor::Stretch(Arc::new(end))),
            None => options.after.clone(),
        },
        before: None,
        ..options.clone().without_places()
    };
    sentences.fold(request, Request::then)
}

/// Returns the seed of a stretch: that of the whole motion for the first one.
fn seed(seed: u64, index: usize) -> u64 {
    // An odd number far from all small ones, so that no stretch has the noise of another small seed.
    seed.wrapping_add((index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15))
}

impl StretchEnd {
    /// Takes the last frames of both motions of a stretch.
    pub(crate) fn of(baseline: &Motion, guided: &Motion, changes_goals: bool) -> StretchEnd {
        StretchEnd {
            baseline: end_of(baseline),
            guided: end_of(guided),
            changes_goals,
        }
    }
}

/// Returns the frames of a motion that the next stretch sees.
fn end_of(motion: &Motion) -> Motion {
    let frames = motion.frames();
    let rotations = motion
        .rotations()
        .between(frames.saturating_sub(KNOWN_FRAMES)..frames);
    Motion::from_rotations(rotations).expect("the end of a motion is a motion")
}

/// Joins stretches of a motion, each of which stands where it goes on. Motions of pose features go on from one another by
/// themselves.
pub(crate) fn joined(stretches: &[Motion]) -> Motion {
    let features: Option<Vec<_>> = stretches.iter().map(Motion::features).collect();
    let motion = match features {
        Some(features) => Motion::from_pose_features(features.concat()),
        None => {
            let rotations = stretches
                .iter()
                .map(|stretch| stretch.rotations().into_owned());
            let joined = rotations.reduce(|before, next| before.followed_by(&next));
            Motion::from_rotations(joined.expect("a motion has a stretch"))
        }
    };
    let first = &stretches[0];
    motion
        .expect("stretches of a motion are a motion")
        .with_copyright(first.copyright())
        .with_root_motion(first.root_motion())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::request::Length;

    fn lengths(stretches: &[Vec<Section>]) -> Vec<Vec<(usize, usize)>> {
        let section = |section: &Section| (section.sentence, section.frames.len());
        { stretches.iter() }
            .map(|stretch| stretch.iter().map(section).collect())
            .collect()
    }

    #[test]
    fn stretches_have_all_frames_and_are_not_too_long() {
        assert_eq!(lengths(&stretches(&[60], 400, &[])), [[(0, 60)]]);
        assert_eq!(
            lengths(&stretches(&[200, 200, 40], 400, &[])),
            [vec![(0, 200), (1, 200)], vec![(2, 40)]]
        );
        assert_eq!(
            lengths(&stretches(&[900, 50], 400, &[])),
            [vec![(0, 300)], vec![(0, 300)], vec![(0, 300), (1, 50)]]
        );
        let ends = |length, lengths| -> Vec<usize> {
            let sections = sections(length, lengths, &[]).into_iter();
            sections.map(|frames| frames.end).collect()
        };
        assert_eq!(ends(1000, 1..=300), [250, 500, 750, 1000]);
        // No section is shorter than the shortest motion.
        assert_eq!(ends(100, 40..=40), [50, 100]);
        assert_eq!(ends(79, 40..=40), [79]);
    }

    #[test]
    fn borders_keep_away_from_the_places_that_follow_them() {
        let ends = |places: &[usize]| -> Vec<usize> {
            let sections = sections(240, 40..=80, places).into_iter();
            sections.map(|frames| frames.end).collect()
        };
        assert_eq!(ends(&[]), [80, 160, 240]);
        // A place at the border, or soon after it, is one of the section before.
        assert_eq!(ends(&[80]), [81, 160, 240]);
        assert_eq!(ends(&[85, 200]), [86, 160, 240]);
        // One that is later has a second.
        assert_eq!(ends(&[95]), [75, 160, 240]);
        assert_eq!(ends(&[92]), [72, 160, 240]);
        // Many places leave the longest way that there is.
        let many: Vec<usize> = (0..240).step_by(10).collect();
        assert_eq!(ends(&many), [81, 161, 240]);
        // Sections that cannot be shorter stay as they are.
        let short = sections(80, 40..=40, &[45]);
        assert_eq!(short, [0..40, 40..80]);
        let whole = stretches(&[100, 240], 120, &[100, 225]);
        assert_eq!(lengths(&whole), [[(0, 100)], [(1, 126)], [(1, 114)]]);
    }

    #[test]
    fn seeds_of_stretches_differ() {
        let seeds: Vec<u64> = (0..4).map(|index| seed(7, index)).collect();
        assert_eq!(seeds[0], 7);
        assert!(seeds[1..].iter().all(|seed| *seed > 1_000_000));
    }

    #[test]
    fn the_options_of_the_first_request_are_those_of_every_stretch() {
        let options = Request::new("walk").steps(5).seed(3).then("jump");
        let sections = [
            Request::new("walk").frames(50),
            Request::new("jump").frames(60),
        ];
        let request = stretch_request(&options, sections, 0, None);
        assert_eq!(request.steps, Some(5));
        assert_eq!((request.seed, request.following.len()), (3, 1));
        assert_eq!(request.length, Length::Frames(50));
    }
}
