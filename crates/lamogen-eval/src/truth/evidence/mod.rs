//! Validation of the checks: the real motions that each check has to hold for, and those that it must not hold for.
//!
//! ```text
//! evidence ──▶ Evidence: check, choices of clips ──validate──▶ Validation: shares of clips that the check holds for
//! ```

mod clips;
mod limbs;
mod posture;
mod travel;

use serde::Serialize;

use super::checks::Check;
use super::limits;
use super::sentences::{Phrasing, Sentence, sentences};

pub use clips::{Clip, Clips};

/// The real motions that show whether a check is right.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// The check.
    pub check: Check,
    /// The motions that the check has to hold for: those of any of these choices.
    pub holds: Vec<Clips>,
    /// The motions that the check must not hold for: those of any of these choices that are not in `holds`.
    pub fails: Vec<Clips>,
}

/// The shares of real motions that a check holds for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// The check.
    pub check: Check,
    /// The number of motions that the check has to hold for.
    pub true_clips: usize,
    /// The share of these motions that the check holds for.
    pub true_share: f32,
    /// The names of these motions that the check does not hold for.
    pub missed: Vec<String>,
    /// The number of motions that the check must not hold for.
    pub false_clips: usize,
    /// The share of these motions that the check holds for.
    pub false_share: f32,
    /// The names of these motions that the check holds for.
    pub mistaken: Vec<String>,
}

impl Validation {
    /// Returns whether the check is good enough to be used.
    pub fn is_valid(&self) -> bool {
        let has_clips = self.true_clips > 0 && self.false_clips > 0;
        has_clips
            && self.true_share >= limits::TRUE_SHARE
            && self.false_share <= limits::FALSE_SHARE
    }
}

impl Evidence {
    /// Checks real motions and counts those that the check holds for.
    pub fn validate(&self, clips: &[Clip]) -> Validation {
        let is_in =
            |choices: &[Clips], clip: &Clip| choices.iter().any(|choice| choice.include(clip));
        let (mut missed, mut mistaken) = (Vec::new(), Vec::new());
        let (mut true_clips, mut false_clips) = (0, 0);
        for clip in clips {
            let holds = self.check.judge(&clip.measured).holds();
            if is_in(&self.holds, clip) {
                true_clips += 1;
                if !holds {
                    missed.push(clip.name.clone());
                }
            } else if is_in(&self.fails, clip) {
                false_clips += 1;
                if holds {
                    mistaken.push(clip.name.clone());
                }
            }
        }
        let share = |count: usize, of: usize| count as f32 / of.max(1) as f32;
        Validation {
            check: self.check,
            true_share: share(true_clips - missed.len(), true_clips),
            true_clips,
            missed,
            false_share: share(mistaken.len(), false_clips),
            false_clips,
            mistaken,
        }
    }
}

/// Returns the evidence of every check that a sentence has, in the order of [`Check::ALL`].
pub fn evidence() -> Vec<Evidence> {
    let sentences = sentences();
    let is_needed = |check: &Check| {
        sentences
            .iter()
            .any(|sentence| sentence.checks.contains(check))
    };
    let checks = Check::ALL.iter().map(|(_, check)| *check);
    let evidence = |check: Check| {
        let Examples { positive, negative } = examples(check);
        Evidence {
            check,
            holds: positive,
            fails: negative,
        }
    };
    checks.filter(is_needed).map(evidence).collect()
}

/// Returns sentences from the captions of real motions, each with the length of its motion.
///
/// For every check, it takes up to `motions_per_check` motions, spread evenly over the list, that the check has to hold
/// for and does hold for. The check of a sentence may be about something that its caption does not mention.
///
/// # Panics
///
/// If one of these motions has no caption.
pub fn captioned(clips: &[Clip], motions_per_check: usize) -> Vec<Sentence> {
    let mut sentences: Vec<Sentence> = Vec::new();
    for Evidence { check, holds, .. } in evidence() {
        let is_usable = |clip: &&Clip| {
            let is_positive = holds.iter().any(|choice| choice.include(clip));
            is_positive && check.judge(&clip.measured).holds()
        };
        let usable: Vec<&Clip> = clips.iter().filter(is_usable).collect();
        let count = motions_per_check.min(usable.len());
        for index in 0..count {
            let clip = usable[index * usable.len() / count];
            let caption = &clip.captions[index % clip.captions.len()];
            sentences.push(Sentence {
                group: clip.content.clone(),
                phrasing: Phrasing::Training,
                seconds: clip.seconds,
                text: caption.clone(),
                checks: vec![check],
            });
        }
    }
    sentences
}

/// The positive and negative examples of a check.
struct Examples {
    /// The motions that the check has to hold for.
    positive: Vec<Clips>,
    /// The motions that the check must not hold for, unless they are positive examples.
    negative: Vec<Clips>,
}

impl Examples {
    fn new(positive: Vec<Clips>, negative: Vec<Clips>) -> Examples {
        Examples { positive, negative }
    }
}

/// Returns the examples of a check.
fn examples(check: Check) -> Examples {
    match check {
        Check::Travels(direction) => travel::travels(direction),
        Check::Runs => travel::runs(),
        Check::GoesSlowly => travel::goes_slowly(),
        Check::Stays => travel::stays(),
        Check::StepsInPlace => travel::steps_in_place(),
        Check::Stops => travel::stops(),
        Check::Starts => travel::starts(),
        Check::Turns(side) => travel::turns(side),
        Check::TurnsQuarter(side) => travel::turns_quarter(side),
        Check::TurnsAround(side) => travel::turns_around(side),
        Check::TurnsInCircle(side) => travel::turns_in_circle(side),
        Check::RaisesHand(side) => limbs::raises_hand(side),
        Check::RaisesHandOverHead(side) => limbs::raises_hand_over_head(side),
        Check::RaisesBothHands => limbs::raises_both_hands(),
        Check::RaisesBothHandsOverHead => limbs::raises_both_hands_over_head(),
        Check::BringsHandToHead => limbs::brings_hand_to_head(),
        Check::Punches(side) => limbs::punches(side),
        Check::Kicks(side) => limbs::kicks(side),
        Check::RaisesKnee(side) => limbs::raises_knee(side),
        Check::StandsOnLeg(side) => limbs::stands_on_leg(side),
        Check::Lunges(side) => limbs::lunges(side),
        Check::LungesAside(side) => limbs::lunges_aside(side),
        Check::Squats(times) => posture::squats(times),
        Check::Jumps => posture::jumps(),
        Check::JumpsInPlace => posture::jumps_in_place(),
        Check::JumpsForward => posture::jumps_forward(),
        Check::JumpsAgain => posture::jumps_again(),
        Check::DoesJumpingJacks => posture::does_jumping_jacks(),
        Check::SitsDown => posture::sits_down(),
        Check::StandsUp => posture::stands_up(),
        Check::SitsDownAndGetsUp => posture::sits_down_and_gets_up(),
        Check::LiesDown => posture::lies_down(),
        Check::Lies => posture::lies(),
        Check::GetsUp => posture::gets_up(),
        Check::CrawlsForward => posture::crawls("crawl", "crawl-back"),
        Check::CrawlsBackward => posture::crawls("crawl-back", "crawl"),
        Check::Kneels => posture::kneels(),
        Check::Crouches => posture::crouches(),
        Check::GoesUp => posture::goes_up(),
        Check::GoesDown => posture::goes_down(),
        Check::PicksUp => posture::picks_up(),
        Check::BendsForward => posture::bends_forward(),
        Check::StandsStill => posture::stands_still(),
        Check::Dances => posture::dances(),
        Check::GoesUpsideDown => posture::goes_upside_down(),
    }
}

#[cfg(test)]
mod tests {
    use super::clips::clips;
    use super::*;
    use crate::truth::measurements::Measurements;

    fn clip(content: &str, caption: &str) -> Clip {
        Clip {
            name: content.into(),
            content: content.into(),
            seconds: 1.0,
            styled: false,
            captions: vec!["a person moves".into(), caption.into()],
            measured: Measurements::default(),
        }
    }

    #[test]
    fn every_check_of_a_sentence_has_positive_and_negative_examples() {
        let evidence = evidence();
        for sentence in sentences() {
            for check in sentence.checks {
                let found = evidence.iter().find(|evidence| evidence.check == check);
                let found = found.unwrap_or_else(|| panic!("no evidence of `{check}`"));
                assert!(
                    !found.holds.is_empty() && !found.fails.is_empty(),
                    "{check}"
                );
            }
        }
    }

    #[test]
    fn clips_are_chosen_by_content_words_and_style() {
        let kicks = clips(["kick-*"])
            .with_words(["left"])
            .without_words(["right"])
            .without_style();
        let left = clip("kick-side-left", "kicks with the left foot");
        assert!(kicks.include(&left));
        assert!(!kicks.include(&clip("kick-side-left", "kicks with the right, not left")));
        assert!(!kicks.include(&clip("kick", "kicks with the left foot")));
        assert!(!kicks.include(&Clip {
            styled: true,
            ..left
        }));
    }

    #[test]
    fn shares_are_of_the_chosen_motions_and_a_motion_counts_once() {
        let evidence = Evidence {
            check: Check::Runs,
            holds: vec![clips(["run"])],
            fails: vec![clips(["walk", "run"])],
        };
        let fast = |content: &str, speed_high: f32| Clip {
            measured: Measurements {
                speed_high,
                ..Measurements::default()
            },
            ..clip(content, "")
        };
        let clips = [
            fast("run", 3.0),
            fast("run", 1.0),
            fast("walk", 1.0),
            fast("jump", 9.0),
        ];
        let found = evidence.validate(&clips);
        assert_eq!((found.true_clips, found.true_share), (2, 0.5));
        assert_eq!((found.false_clips, found.false_share), (1, 0.0));
        assert_eq!(found.missed, ["run"]);
        assert!(!found.is_valid());
    }
}
