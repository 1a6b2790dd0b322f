//! Which real motions a check has to hold for, and for which not.

use serde::Serialize;

use super::checks::{Check, Direction, Side};
use super::measurements::Measurements;
use super::sentences::{Phrasing, Sentence};
use super::{limits, sentences};

/// A real motion, with what is said of it.
#[derive(Clone, Debug)]
pub struct Clip {
    /// Its name.
    pub name: String,
    /// What is done in it, in a word such as `walk-turn-left`.
    pub content: String,
    /// Its length, s.
    pub seconds: f32,
    /// Whether it is done in a style, such as that of a chicken.
    pub styled: bool,
    /// Sentences that describe it.
    pub captions: Vec<String>,
    /// What was measured of it.
    pub measured: Measurements,
}

/// A choice of real motions by what is said of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clips {
    contents: Vec<String>,
    said: Vec<String>,
    unsaid: Vec<String>,
    plain: bool,
}

/// Motions of these contents; `kick-*` are all that begin so.
fn clips<const N: usize>(contents: [&str; N]) -> Clips {
    Clips {
        contents: contents.map(str::to_owned).into(),
        ..Clips::default()
    }
}

impl Clips {
    /// Of these, motions with one of these words in a caption.
    fn said<const N: usize>(self, words: [&str; N]) -> Clips {
        let said = words.map(str::to_owned).into();
        Clips { said, ..self }
    }

    /// Of these, motions with none of these words in any caption.
    fn unsaid<const N: usize>(self, words: [&str; N]) -> Clips {
        let unsaid = words.map(str::to_owned).into();
        Clips { unsaid, ..self }
    }

    /// Of these, motions that are done in no style.
    fn plain(self) -> Clips {
        Clips {
            plain: true,
            ..self
        }
    }

    /// Whether a motion is meant.
    pub fn include(&self, clip: &Clip) -> bool {
        let is_of = |content: &String| match content.strip_suffix('*') {
            Some(start) => clip.content.starts_with(start),
            None => clip.content == *content,
        };
        let says = |words: &String| clip.captions.iter().any(|caption| caption.contains(words));
        self.contents.iter().any(is_of)
            && !(self.plain && clip.styled)
            && (self.said.is_empty() || self.said.iter().any(says))
            && !self.unsaid.iter().any(says)
    }
}

/// What real motions say of a check.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// The check.
    pub check: Check,
    /// Motions that it has to hold for: those of any of these choices.
    pub holds: Vec<Clips>,
    /// Motions that it must not hold for: those of any of these choices, unless they are among the others.
    pub fails: Vec<Clips>,
}

/// How often a check holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// The check.
    pub check: Check,
    /// How many motions it has to hold for.
    pub true_clips: usize,
    /// The share of them that it does hold for.
    pub true_share: f32,
    /// Of these, the motions that it does not hold for.
    pub missed: Vec<String>,
    /// How many motions it must not hold for.
    pub false_clips: usize,
    /// The share of them that it does hold for.
    pub false_share: f32,
    /// Of these, the motions that it holds for.
    pub mistaken: Vec<String>,
}

impl Validation {
    /// Whether the check is good enough to be used.
    pub fn is_valid(&self) -> bool {
        let there_are = self.true_clips > 0 && self.false_clips > 0;
        there_are
            && self.true_share >= limits::TRUE_SHARE
            && self.false_share <= limits::FALSE_SHARE
    }
}

impl Evidence {
    /// Counts over real motions.
    pub fn validate(&self, clips: &[Clip]) -> Validation {
        let is_in = |choices: &[Clips], clip: &Clip| choices.iter().any(|some| some.include(clip));
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

/// The evidence of every check that a sentence needs, in the order of [`Check::ALL`].
pub fn evidence() -> Vec<Evidence> {
    let sentences = sentences();
    let is_needed = |check: &Check| {
        sentences
            .iter()
            .any(|sentence| sentence.checks.contains(check))
    };
    let checks = Check::ALL.iter().map(|(_, check)| *check);
    checks.filter(is_needed).map(evidence_of).collect()
}

/// Sentences that are said of real motions, at the length of these: for every check so many of the motions that it has to hold for, and does,
/// from all over the list. What a caption leaves out is asked for as well.
pub fn captioned(clips: &[Clip], motions_per_check: usize) -> Vec<Sentence> {
    let mut sentences: Vec<Sentence> = Vec::new();
    for Evidence { check, holds, .. } in evidence() {
        let is_meant = |clip: &&Clip| {
            let is_meant = holds.iter().any(|some| some.include(clip));
            is_meant && check.judge(&clip.measured).holds()
        };
        let meant: Vec<&Clip> = clips.iter().filter(is_meant).collect();
        let count = motions_per_check.min(meant.len());
        for place in 0..count {
            let clip = meant[place * meant.len() / count];
            let caption = &clip.captions[place % clip.captions.len()];
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

/// Motions on the spot, on both feet or one, with upright trunk.
fn on_the_spot() -> Clips {
    clips([
        "stand",
        "look-around",
        "arm-raise-*",
        "arm-extend-back-*",
        "referee-signal",
        "drink",
        "squat",
        "sit-to-stand",
        "leg-raise-*",
        "knee-raise-*",
    ])
}

/// The evidence of a check.
fn evidence_of(check: Check) -> Evidence {
    let evidence = |holds: Vec<Clips>, fails: Vec<Clips>| Evidence {
        check,
        holds,
        fails,
    };
    match check {
        Check::Travels(Direction::Forward) => evidence(
            vec![clips(["walk", "run", "walk-turn-*", "run-turn-*"])],
            vec![clips(["walk-back", "run-back"]), on_the_spot()],
        ),
        Check::Travels(Direction::Backward) => evidence(
            vec![clips(["walk-back", "run-back"])],
            vec![clips(["walk", "run"]), on_the_spot()],
        ),
        Check::Travels(Direction::Sideways(side)) => {
            let [this, other] = names(side);
            evidence(
                vec![
                    of_side("side-step", side),
                    of_side("side-step-fast", side),
                    clips(["sidestep"])
                        .said([&format!("to the {this}")])
                        .unsaid([other]),
                ],
                vec![
                    of_side("side-step", side.other()),
                    of_side("side-step-fast", side.other()),
                    clips(["walk", "run", "walk-back", "run-back", "stand", "squat"]),
                ],
            )
        }
        Check::Runs => evidence(
            vec![clips(["run"]).plain()],
            vec![clips(["walk", "walk-back", "sidestep"]), on_the_spot()],
        ),
        Check::GoesSlowly => evidence(
            vec![clips(["walk"]).said(["slow"]).plain()],
            vec![
                clips(["walk"]).said(["fast", "brisk"]).plain(),
                clips(["run"]),
            ],
        ),
        Check::Stays => evidence(
            vec![on_the_spot()],
            vec![clips(["walk", "run", "walk-back", "run-back", "sidestep"])],
        ),
        Check::StepsInPlace => evidence(
            vec![clips(["jog-in-place"])],
            vec![clips(["walk", "run", "jump"]), on_the_spot()],
        ),
        Check::Stops => evidence(
            vec![
                clips(["walk-to-stand", "run-to-stand"]),
                clips(["skip"])
                    .said(["stop", "stands still", "halt"])
                    .unsaid(["standstill"]),
            ],
            vec![clips(["walk", "run", "walk-back"]), on_the_spot()],
        ),
        Check::Starts => evidence(
            vec![clips(["stand-to-walk"])],
            vec![
                clips(["walk", "run", "walk-back", "walk-to-stand"]),
                on_the_spot(),
            ],
        ),
        Check::Turns(side) => evidence(
            vec![of_side("walk-turn", side), of_side("run-turn", side)],
            vec![
                of_side("walk-turn", side.other()),
                of_side("run-turn", side.other()),
                clips(["walk", "run"]).plain(),
                on_the_spot(),
            ],
        ),
        Check::TurnsQuarter(side) => evidence(
            [of_side("walk-turn", side), of_side("run-turn", side)]
                .map(|turns| {
                    turns
                        .said(["90", "right angle", "ninety", "quarter"])
                        .unsaid(["more than", "135", "sharply", "most of the way"])
                })
                .into(),
            vec![
                of_side("walk-turn", side.other()),
                of_side("run-turn", side.other()),
                clips(["walk", "run"]).plain(),
                clips(["walk-turn-around", "run-turn-around"]),
                on_the_spot(),
            ],
        ),
        Check::TurnsAround(side) => {
            let [this, other] = side.map_or(["", ""], names);
            let around = clips(["walk-turn-around", "run-turn-around"]);
            let opposite = match side {
                Some(_) => around.clone().said([other]),
                None => Clips::default(),
            };
            evidence(
                vec![around.said([this])],
                vec![opposite, clips(["walk", "run"]).plain(), on_the_spot()],
            )
        }
        Check::TurnsInCircle(side) => {
            let circles = clips(["walk", "walk-back", "sidestep"]);
            let (holds, fails) = match side {
                Some(side) => {
                    let circle = |side: Side| format!("in a full circle to the {}", side.name());
                    let opposite = circles.clone().said([&circle(side.other())]);
                    (circles.said([&circle(side)]), opposite)
                }
                None => (circles.said(["in a full circle"]), Clips::default()),
            };
            let turns = clips(["walk-turn-*", "run-turn-*"]);
            let straight = clips(["walk", "run"]).plain();
            evidence(vec![holds], vec![fails, turns, straight, on_the_spot()])
        }
        Check::RaisesHand(side) => {
            let [this, other] = names(side);
            let waves = |side: &str| {
                let [arm, hand] = ["arm", "hand"].map(|limb| format!("with the {side} {limb}"));
                let raises = format!("raises the {side} hand");
                clips(["wave", "greet"]).said([&arm, &hand, &raises])
            };
            evidence(
                vec![of_side("arm-raise-side", side), waves(this)],
                vec![
                    of_side("arm-raise-side", side.other()),
                    waves(other),
                    clips(["squat", "walk", "run", "stand", "arm-extend-back-*"]),
                ],
            )
        }
        Check::RaisesHandOverHead(side) => evidence(
            vec![
                of_side("arm-raise-side", side)
                    .said(["overhead", "over their head", "over his head", "up high"])
                    .unsaid(["not ", "only", "partway", "about as high"]),
            ],
            vec![
                of_side("arm-raise-side", side.other()),
                clips(["arm-raise-diagonal-*", "arm-extend-back-*"]),
                clips(["squat", "walk", "run", "stand"]),
            ],
        ),
        Check::RaisesBothHands => evidence(
            vec![
                clips(["jumping-jacks", "lift-overhead", "sit-to-stand"]),
                clips(["squat"]).said(["overhead", "over their head", "arms up"]),
            ],
            vec![arms_apart()],
        ),
        Check::RaisesBothHandsOverHead => evidence(
            vec![
                clips(["jumping-jacks", "lift-overhead"]),
                clips(["squat"]).said(["overhead", "over their head", "arms up"]),
            ],
            vec![arms_apart()],
        ),
        Check::BringsHandToHead => evidence(
            vec![clips(["drink", "eat", "scratch-head"])],
            vec![
                clips(["walk", "run", "walk-back", "squat"]),
                clips(["leg-raise-*", "arm-extend-back-*"]),
            ],
        ),
        Check::Punches(side) => {
            let blows = |side: Side| {
                let [this, other] = names(side);
                let limbs = ["fist", "hand", "arm"].map(|limb| format!("{this} {limb}"));
                [
                    clips(["punch"])
                        .said(limbs.each_ref().map(|limb| &**limb))
                        .unsaid([other]),
                    clips(["punch-*"]).said([this]).unsaid([other]),
                ]
            };
            let still = vec![
                clips(["walk", "run", "stand", "squat", "lunge-*"]),
                clips(["arm-raise-*", "arm-extend-back-*"]),
            ];
            match side {
                Some(side) => {
                    let opposite = blows(side.other()).into_iter();
                    evidence(blows(side).into(), opposite.chain(still).collect())
                }
                None => evidence(vec![clips(["punch", "punch-*"])], still),
            }
        }
        Check::Kicks(side) => {
            let kicks = |side: Side| {
                let [this, other] = names(side);
                let ends = [
                    "roundhouse",
                    "crescent",
                    "push",
                    "spin",
                    "side",
                    "double",
                    "front",
                    "back",
                    "axe",
                ];
                let of = ends.map(|kind| format!("kick-{kind}-{this}"));
                [
                    clips(["kick"]).said([this]).unsaid([other]),
                    clips(of.each_ref().map(|content| &**content)),
                ]
            };
            let other = vec![
                clips(["walk", "run", "stand", "squat", "punch", "punch-*"]),
                clips(["knee-raise-*", "lunge-*"]),
            ];
            match side {
                Some(side) => {
                    let opposite = kicks(side.other()).into_iter();
                    evidence(kicks(side).into(), opposite.chain(other).collect())
                }
                None => evidence(vec![clips(["kick", "kick-*"])], other),
            }
        }
        Check::RaisesKnee(side) => evidence(
            vec![of_side("knee-raise", side)],
            vec![
                of_side("knee-raise", side.other()),
                clips(["walk", "run", "stand", "squat", "lunge-*", "arm-raise-*"]),
            ],
        ),
        Check::StandsOnLeg(side) => {
            let balance = |side: &str| {
                let [leg, foot] = ["leg", "foot"].map(|limb| format!("{side} {limb}"));
                let [on, on_foot] = [leg, foot]
                    .map(|limb| ["on the ", "on their "].map(|on| format!("{on}{limb}")));
                clips(["balance"]).said([&on[0], &on[1], &on_foot[0], &on_foot[1]])
            };
            let both = clips(["walk", "run", "stand", "squat", "arm-raise-*"]);
            match side {
                Some(side) => {
                    let [this, other] = names(side);
                    evidence(vec![balance(this)], vec![balance(other), both])
                }
                None => evidence(vec![clips(["balance"])], vec![both]),
            }
        }
        Check::Lunges(side) => evidence(
            vec![of_side("lunge", side)],
            vec![
                of_side("lunge", side.other()),
                clips(["walk", "run", "stand", "squat", "sit-to-stand"]),
            ],
        ),
        Check::LungesAside(side) => evidence(
            vec![of_side("side-lunge", side)],
            vec![
                of_side("side-lunge", side.other()),
                clips(["walk", "run", "stand", "squat", "sit-to-stand"]),
            ],
        ),
        Check::Squats(times) => {
            let squats = |times: u8| {
                let squats = clips(["squat"]);
                let squats = match times {
                    1 => squats.said([" once", "one time", " a squat", " a deep squat"]),
                    2 => squats.said([" two ", "twice"]),
                    _ => squats.said(["three"]),
                };
                // Squats that do not go down, and a clip of many.
                squats.unsaid([
                    "weak",
                    "part",
                    "half",
                    "small",
                    "slight",
                    "without squatting",
                    "little",
                    "not ",
                    "shallow",
                    "does squats",
                ])
            };
            let others = [1, 2, 3].into_iter().filter(|other| *other != times);
            let mut fails: Vec<Clips> = others.map(squats).collect();
            fails.push(clips([
                "walk",
                "run",
                "jump",
                "stand",
                "leg-raise-*",
                "arm-raise-*",
            ]));
            evidence(vec![squats(times)], fails)
        }
        Check::Jumps => evidence(
            vec![clips([
                "jump",
                "hop",
                "leap",
                "jump-running",
                "jumping-jacks",
            ])],
            vec![
                clips(["walk", "run", "walk-back", "sidestep"]),
                on_the_spot(),
            ],
        ),
        Check::JumpsInPlace => evidence(
            vec![clips(["jump"]).said(["in place", "straight up", "on the spot", "vertical"])],
            vec![
                clips(["walk", "run", "walk-back", "sidestep"]),
                clips(["leap", "jump-running"]),
                clips(["jump"]).said(["forward"]),
                on_the_spot(),
            ],
        ),
        Check::JumpsForward => evidence(
            vec![clips(["jump", "hop", "leap", "jump-running"]).said([
                "jumps forward",
                "hops forward",
                "leaps forward",
                "jumps far forward",
                "jumps over",
                "hops over",
            ])],
            vec![
                clips(["walk", "run", "walk-back", "sidestep"]),
                clips(["jump"]).said(["in place", "straight up"]),
                on_the_spot(),
            ],
        ),
        Check::JumpsAgain => evidence(
            vec![clips(["jump", "hop", "jumping-jacks"]).said([
                "two times",
                "three times",
                "four times",
                "twice",
                "again and again",
                "many times",
            ])],
            vec![clips(["walk", "walk-back", "sidestep"]), on_the_spot()],
        ),
        Check::DoesJumpingJacks => evidence(
            vec![clips(["jumping-jacks"])],
            vec![
                clips(["walk", "run", "jump", "hop", "sidestep"]),
                on_the_spot(),
            ],
        ),
        Check::SitsDown => evidence(
            vec![clips(["sit"]).said(["sits down on a low stool", "sits down on a stepstool"])],
            vec![
                clips(["walk", "run", "jump", "hop", "sidestep"]),
                clips(["lie-down", "stand-up", "get-up"]),
                on_the_spot(),
            ],
        ),
        Check::StandsUp => evidence(
            vec![
                clips(["crouch-to-walk", "crouch-to-run"]),
                clips(["stand-up"]).said(["low stool"]),
            ],
            vec![
                clips(["walk", "run", "jump", "hop", "sidestep"]),
                clips(["lie-down", "lie", "crawl"]),
                on_the_spot(),
            ],
        ),
        Check::SitsDownAndGetsUp => evidence(
            vec![clips(["sit-to-stand"])],
            vec![
                clips(["walk", "run", "hop", "sidestep", "lie-down", "lie", "crawl"]),
                clips(["stand", "look-around", "arm-raise-*", "leg-raise-*"]),
            ],
        ),
        Check::LiesDown => evidence(
            vec![clips(["lie-down", "fall"])],
            vec![
                clips([
                    "walk", "run", "jump", "get-up", "crawl", "lie", "crouch", "sit",
                ]),
                on_the_spot(),
            ],
        ),
        Check::Lies => evidence(
            vec![clips(["lie"])],
            vec![
                clips(["walk", "run", "jump", "get-up", "crawl", "crouch", "sit"]),
                on_the_spot(),
            ],
        ),
        Check::GetsUp => evidence(
            vec![clips(["get-up"])],
            vec![
                clips([
                    "walk", "run", "jump", "lie-down", "crawl", "lie", "crouch", "sit",
                ]),
                on_the_spot(),
            ],
        ),
        Check::CrawlsForward | Check::CrawlsBackward => {
            let [this, opposite] = match check {
                Check::CrawlsForward => ["crawl", "crawl-back"],
                _ => ["crawl-back", "crawl"],
            };
            evidence(
                vec![clips([this])],
                vec![
                    clips([opposite, "walk", "run", "jump", "lie", "crouch", "sit"]),
                    on_the_spot(),
                ],
            )
        }
        Check::Kneels => evidence(
            vec![clips(["kneel"])],
            vec![
                clips(["walk", "run", "jump", "lie", "crawl", "crawl-back", "sit"]),
                on_the_spot(),
            ],
        ),
        Check::Crouches => evidence(
            vec![clips(["crouch", "run-to-crouch", "walk-to-crouch"])],
            vec![
                clips(["walk", "run", "lie", "lie-down", "crawl", "crawl-back"]),
                clips(["stand", "look-around", "arm-raise-*", "arm-extend-back-*"]),
            ],
        ),
        Check::GoesUp => evidence(
            vec![
                clips(["climb-stairs"]).unsaid(["down"]),
                clips(["climb"]).said(["ladder"]).unsaid(["down", "duck"]),
            ],
            vec![
                clips(["walk", "run", "jump", "sit", "go-down-stairs", "climb-down"]),
                on_the_spot(),
            ],
        ),
        Check::GoesDown => evidence(
            vec![clips(["go-down-stairs", "climb-down"])],
            vec![
                clips(["walk", "run", "jump", "sit", "crouch", "climb-stairs"]),
                on_the_spot(),
            ],
        ),
        Check::PicksUp => evidence(
            vec![clips(["pick-up", "walk-pick-up", "run-pick-up"]).unsaid(["table"])],
            vec![
                clips(["walk", "run", "jump", "sit", "stand", "look-around"]),
                clips([
                    "arm-raise-*",
                    "arm-extend-back-*",
                    "drink",
                    "referee-signal",
                ]),
            ],
        ),
        Check::BendsForward => evidence(
            vec![
                clips(["bow"]),
                clips(["pick-up", "wash", "walk-pick-up"])
                    .said([
                        "bends over",
                        "bends down",
                        "bends forward",
                        "bends far forward",
                    ])
                    .unsaid(["squat", "bends at the knees"]),
            ],
            vec![
                clips(["walk", "run"]).plain(),
                clips(["stand", "look-around", "drink", "arm-raise-*"]),
            ],
        ),
        Check::StandsStill => evidence(
            vec![clips(["stand"]).unsaid(["drunk", "too much to drink", "begins to walk"])],
            vec![
                clips(["walk", "run", "jump", "dance", "punch", "kick", "sidestep"]),
                clips(["squat", "leg-raise-*", "knee-raise-*"]),
            ],
        ),
        Check::Dances => evidence(
            vec![clips(["dance"]).unsaid(["runs forward", "moves forward", "runs ahead"])],
            vec![
                clips(["walk", "run"]).plain(),
                clips(["stand", "look-around", "lie", "drink"]),
                // Not those who get up, walk about and sit down again.
                clips(["sit"]).unsaid(["stands up", "gets up", "rises", "walk", "turn"]),
            ],
        ),
        Check::GoesUpsideDown => evidence(
            vec![clips(["cartwheel", "flip"])],
            vec![clips([
                "walk", "run", "jump", "hop", "dance", "squat", "lie", "crawl",
            ])],
        ),
    }
}

/// Motions in which no two hands go up at once.
fn arms_apart() -> Clips {
    clips([
        "walk",
        "run",
        "stand",
        "arm-raise-*",
        "arm-extend-back-*",
        "drink",
    ])
}

/// Motions of a content that ends with the side.
fn of_side(content: &str, side: Side) -> Clips {
    clips([&format!("{content}-{}", side.name())])
}

fn names(side: Side) -> [&'static str; 2] {
    [side.name(), side.other().name()]
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn every_check_of_a_sentence_has_motions_for_and_against_it() {
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
        let kicks = clips(["kick-*"]).said(["left"]).unsaid(["right"]).plain();
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
    fn shares_are_of_the_motions_that_are_meant_and_a_motion_counts_once() {
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
