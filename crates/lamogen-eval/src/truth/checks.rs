//! What a motion can be asked to do, and how its measurements decide.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use super::limits;
use super::measurements::Measurements;

/// A side of the body, or a direction as the body sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The body's own left.
    Left,
    /// The body's own right.
    Right,
}

impl Side {
    /// Both sides, in the order that measurements have.
    pub const ALL: [Side; 2] = [Side::Left, Side::Right];

    /// Index in pairs of measurements.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The other side.
    pub const fn other(self) -> Side {
        match self {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        }
    }

    /// The word, `left` or `right`.
    pub const fn name(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }

    /// 1 to the left, -1 to the right, as headings and ways to the left are counted.
    const fn sign(self) -> f32 {
        match self {
            Side::Left => 1.0,
            Side::Right => -1.0,
        }
    }
}

/// A way to travel, as the body faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Direction {
    Forward,
    Backward,
    Sideways(Side),
}

/// Something that a motion does. Where no side is given, either will do.
///
/// A check is written as in [`Check::ALL`], such as `turns around left`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Check {
    /// Goes a way, as the body faces step by step.
    Travels(Direction),
    /// Goes as fast as one runs.
    Runs,
    /// Goes no faster than one walks slowly.
    GoesSlowly,
    /// Remains about where it is.
    Stays,
    /// Lifts the feet in turn, and remains where it is.
    StepsInPlace,
    /// Has gone somewhere and stands at the end.
    Stops,
    /// Stands at the start and goes at the end.
    Starts,
    /// Faces farther to a side at the end than at the start.
    Turns(Side),
    /// Turns by about 90 degrees.
    TurnsQuarter(Side),
    /// Turns by about 180 degrees.
    TurnsAround(Option<Side>),
    /// Turns by about 360 degrees or more, on its way.
    TurnsInCircle(Option<Side>),
    /// Raises one hand to the shoulder or higher, and not the other.
    RaisesHand(Side),
    /// Raises one hand over the head, and not the other.
    RaisesHandOverHead(Side),
    /// Raises both hands over the shoulders at once.
    RaisesBothHands,
    /// Raises both hands over the head at once.
    RaisesBothHandsOverHead,
    /// Brings a hand near the head.
    BringsHandToHead,
    /// Thrusts a fist out, or swings it, faster than the other one, about where the body stands.
    Punches(Option<Side>),
    /// Flings a stretched leg up or out, higher than the other one.
    Kicks(Option<Side>),
    /// Raises a knee towards the height of the hip while the other leg stands.
    RaisesKnee(Side),
    /// Stands on one leg for a while.
    StandsOnLeg(Option<Side>),
    /// Sinks down with that foot ahead of the other one.
    Lunges(Side),
    /// Sinks down onto one leg, with the other one stretched to the side.
    LungesAside(Side),
    /// Goes down and comes up as many times.
    Squats(u8),
    /// Leaves the floor with both feet.
    Jumps,
    /// Jumps and remains where it is.
    JumpsInPlace,
    /// Jumps and gets forward.
    JumpsForward,
    /// Leaves the floor several times.
    JumpsAgain,
    /// Leaves the floor several times, with arms raised and legs spread.
    DoesJumpingJacks,
    /// Stands at the start and sits at the end.
    SitsDown,
    /// Sits or crouches at the start and stands at the end.
    StandsUp,
    /// Stands at the start, goes down, and stands at the end.
    SitsDownAndGetsUp,
    /// Comes to lie.
    LiesDown,
    /// Lies all the time.
    Lies,
    /// Lies at the start and is up at the end, on the feet or crouching.
    GetsUp,
    /// Goes forward close to the floor, the trunk along it.
    CrawlsForward,
    /// Goes backward close to the floor, the trunk along it.
    CrawlsBackward,
    /// Has a knee on the floor for a while, the trunk up.
    Kneels,
    /// Gets low on the feet.
    Crouches,
    /// Is higher at the end than at the start, and stood there.
    GoesUp,
    /// Is lower at the end than at the start, and stands.
    GoesDown,
    /// Lowers a hand far down, raises it again and stands.
    PicksUp,
    /// Inclines the trunk and raises it again.
    BendsForward,
    /// Remains calm on the feet.
    StandsStill,
    /// Moves limbs a lot and gets nowhere fast.
    Dances,
    /// Has the head lower than the hips at some time.
    GoesUpsideDown,
}

use Side::{Left, Right};

impl Check {
    /// Every check with the words that stand for it.
    pub const ALL: &'static [(&'static str, Check)] = &[
        ("travels forward", Check::Travels(Direction::Forward)),
        ("travels backward", Check::Travels(Direction::Backward)),
        ("travels left", Check::Travels(Direction::Sideways(Left))),
        ("travels right", Check::Travels(Direction::Sideways(Right))),
        ("runs", Check::Runs),
        ("goes slowly", Check::GoesSlowly),
        ("stays", Check::Stays),
        ("steps in place", Check::StepsInPlace),
        ("stops", Check::Stops),
        ("starts", Check::Starts),
        ("turns left", Check::Turns(Left)),
        ("turns right", Check::Turns(Right)),
        ("turns a quarter left", Check::TurnsQuarter(Left)),
        ("turns a quarter right", Check::TurnsQuarter(Right)),
        ("turns around", Check::TurnsAround(None)),
        ("turns around left", Check::TurnsAround(Some(Left))),
        ("turns around right", Check::TurnsAround(Some(Right))),
        ("turns in a circle", Check::TurnsInCircle(None)),
        ("turns in a circle left", Check::TurnsInCircle(Some(Left))),
        ("turns in a circle right", Check::TurnsInCircle(Some(Right))),
        ("raises left hand", Check::RaisesHand(Left)),
        ("raises right hand", Check::RaisesHand(Right)),
        (
            "raises left hand over head",
            Check::RaisesHandOverHead(Left),
        ),
        (
            "raises right hand over head",
            Check::RaisesHandOverHead(Right),
        ),
        ("raises both hands", Check::RaisesBothHands),
        (
            "raises both hands over head",
            Check::RaisesBothHandsOverHead,
        ),
        ("brings a hand to the head", Check::BringsHandToHead),
        ("punches", Check::Punches(None)),
        ("punches left", Check::Punches(Some(Left))),
        ("punches right", Check::Punches(Some(Right))),
        ("kicks", Check::Kicks(None)),
        ("kicks left", Check::Kicks(Some(Left))),
        ("kicks right", Check::Kicks(Some(Right))),
        ("raises left knee", Check::RaisesKnee(Left)),
        ("raises right knee", Check::RaisesKnee(Right)),
        ("stands on one leg", Check::StandsOnLeg(None)),
        ("stands on left leg", Check::StandsOnLeg(Some(Left))),
        ("stands on right leg", Check::StandsOnLeg(Some(Right))),
        ("lunges left", Check::Lunges(Left)),
        ("lunges right", Check::Lunges(Right)),
        ("lunges aside left", Check::LungesAside(Left)),
        ("lunges aside right", Check::LungesAside(Right)),
        ("squats once", Check::Squats(1)),
        ("squats twice", Check::Squats(2)),
        ("squats three times", Check::Squats(3)),
        ("jumps", Check::Jumps),
        ("jumps in place", Check::JumpsInPlace),
        ("jumps forward", Check::JumpsForward),
        ("jumps again and again", Check::JumpsAgain),
        ("does jumping jacks", Check::DoesJumpingJacks),
        ("sits down", Check::SitsDown),
        ("stands up", Check::StandsUp),
        ("sits down and gets up", Check::SitsDownAndGetsUp),
        ("lies down", Check::LiesDown),
        ("lies", Check::Lies),
        ("gets up", Check::GetsUp),
        ("crawls forward", Check::CrawlsForward),
        ("crawls backward", Check::CrawlsBackward),
        ("kneels", Check::Kneels),
        ("crouches", Check::Crouches),
        ("goes up", Check::GoesUp),
        ("goes down", Check::GoesDown),
        ("picks up", Check::PicksUp),
        ("bends forward", Check::BendsForward),
        ("stands still", Check::StandsStill),
        ("dances", Check::Dances),
        ("goes upside down", Check::GoesUpsideDown),
    ];

    /// Decides of a motion by its measurements.
    pub fn judge(self, measured: &Measurements) -> Verdict {
        Verdict {
            check: self,
            terms: self.terms(measured),
        }
    }

    /// What has to be so, all of it.
    fn terms(self, m: &Measurements) -> Vec<Term> {
        use limits::*;
        match self {
            Check::Travels(Direction::Forward) => {
                vec![at_least("forward_speed", m.forward_speed, TRAVELS)]
            }
            Check::Travels(Direction::Backward) => {
                vec![at_most("forward_speed", m.forward_speed, -TRAVELS)]
            }
            Check::Travels(Direction::Sideways(side)) => vec![
                side.at_least("left_speed", m.left_speed, SIDESTEPS),
                at_least("sideways_share", m.sideways_share, SIDEWAYS_SHARE),
            ],
            Check::Runs => vec![at_least("speed_high", m.speed_high, RUNS)],
            Check::GoesSlowly => vec![at_most("speed_high", m.speed_high, SLOW)],
            Check::Stays => vec![at_most("spread", m.spread, STAYS)],
            Check::StepsInPlace => vec![
                at_least("steps", m.steps, STEPS),
                at_most("spread", m.spread, STAYS),
            ],
            Check::Stops => vec![
                at_least("path", m.path, STOPS_AFTER),
                at_most("speed_end", m.speed_end, STANDS),
            ],
            Check::Starts => vec![
                at_most("speed_start", m.speed_start, STANDS),
                at_least("speed_end", m.speed_end, STARTED),
            ],
            Check::Turns(side) => vec![side.at_least("turn", m.turn, TURNS)],
            Check::TurnsQuarter(side) => vec![side.within("turn", m.turn, QUARTER_TURN)],
            Check::TurnsAround(Some(side)) => vec![side.within("turn", m.turn, HALF_TURN)],
            Check::TurnsAround(None) => vec![within("turn_either", m.turn_either, HALF_TURN)],
            Check::TurnsInCircle(side) => vec![
                match side {
                    Some(side) => side.at_least("turn", m.turn, CIRCLE),
                    None => at_least("turn_either", m.turn_either, CIRCLE),
                },
                at_least("path", m.path, CIRCLE_PATH),
            ],
            Check::RaisesHand(side) => vec![
                at_least(
                    "hand_over_shoulder",
                    m.hand_over_shoulder[side.index()],
                    HAND_RAISED,
                ),
                hangs(m, side.other()),
            ],
            Check::RaisesHandOverHead(side) => vec![
                at_least("hand_over_head", m.hand_over_head[side.index()], OVER_HEAD),
                hangs(m, side.other()),
            ],
            Check::RaisesBothHands => vec![at_least(
                "hands_over_shoulders",
                m.hands_over_shoulders,
                HANDS_RAISED,
            )],
            Check::RaisesBothHandsOverHead => {
                vec![at_least("hands_over_head", m.hands_over_head, OVER_HEAD)]
            }
            Check::BringsHandToHead => {
                let nearest = m.hand_to_head[0].min(m.hand_to_head[1]);
                vec![at_most("hand_to_head", nearest, HAND_AT_HEAD)]
            }
            Check::Punches(side) => {
                let hand = side.unwrap_or(leader(m.thrust_lead)).index();
                let mut terms = vec![
                    at_least("hand_speed", m.hand_speed[hand], PUNCH_SPEED),
                    at_least("hand_thrust", m.hand_thrust[hand], PUNCH_THRUST),
                    at_most("spread", m.spread, PUNCH_SPREAD),
                ];
                // Both fists may, where none is named.
                if side.is_some() {
                    terms.push(at_least("thrust_lead", m.thrust_lead[hand], PUNCH_LEAD));
                }
                terms
            }
            Check::Kicks(side) => {
                let side = side.unwrap_or(leader(m.kick_lead)).index();
                vec![
                    at_least("kick_height", m.kick_height[side], KICK_HEIGHT),
                    at_least("kick_lead", m.kick_lead[side], KICK_LEAD),
                    at_least("foot_speed", m.foot_speed[side], KICK_SPEED),
                ]
            }
            Check::RaisesKnee(side) => vec![
                at_least("knee_over_hip", m.knee_over_hip[side.index()], KNEE_HIGH),
                at_most(
                    "other knee_over_hip",
                    m.knee_over_hip[side.other().index()],
                    KNEE_RESTS,
                ),
            ],
            Check::StandsOnLeg(side) => {
                let longest = m.one_leg[0].max(m.one_leg[1]);
                let time = side.map_or(longest, |side| m.one_leg[side.index()]);
                vec![at_least("one_leg", time, ON_ONE_LEG)]
            }
            Check::Lunges(side) => vec![
                at_least("foot_ahead", m.foot_ahead[side.index()], LUNGE_LENGTH),
                at_most("stance_low", m.stance_low, LUNGE_DOWN),
            ],
            Check::LungesAside(side) => vec![
                at_least("knee_bent", m.knee_bent[side.index()], LUNGE_KNEE),
                at_least(
                    "knee_bent_lead",
                    m.knee_bent_lead[side.index()],
                    LUNGE_KNEE_LEAD,
                ),
                at_least("feet_apart_low", m.feet_apart_low, LUNGE_WIDTH),
            ],
            Check::Squats(times) => {
                let times = f32::from(times);
                vec![within("squats", m.squats, [times, times])]
            }
            Check::Jumps => jumps(m),
            Check::JumpsInPlace => with(jumps(m), at_most("spread", m.spread, STAYS)),
            Check::JumpsForward => with(jumps(m), at_least("advance", m.advance, JUMP_LENGTH)),
            Check::JumpsAgain => vec![at_least("flights", m.flights, SEVERAL)],
            Check::DoesJumpingJacks => vec![
                at_least("flights", m.flights, SEVERAL),
                at_least("hands_over_shoulders", m.hands_over_shoulders, HANDS_RAISED),
                at_least("feet_apart", m.feet_apart, LEGS_SPREAD),
            ],
            Check::SitsDown => vec![
                at_least("stance_start", m.stance_start, UPRIGHT),
                within("stance_end", m.stance_end, SEATED),
                at_most("inclination_end", m.inclination_end, SEATED_TRUNK),
            ],
            Check::StandsUp => vec![
                at_most("stance_start", m.stance_start, SEATED[1]),
                at_least("stance_end", m.stance_end, UPRIGHT),
            ],
            Check::SitsDownAndGetsUp => vec![
                at_least("stance_start", m.stance_start, UPRIGHT),
                within("stance_low", m.stance_low, SEATED),
                at_least("stance_end", m.stance_end, UPRIGHT),
            ],
            Check::LiesDown => vec![
                at_most("stance_end", m.stance_end, LYING),
                at_least("inclination_end", m.inclination_end, LYING_TRUNK),
                at_most("rise", m.rise, -TO_FLOOR),
            ],
            Check::Lies => vec![
                at_most("stance_median", m.stance_median, LYING),
                at_least("inclination_median", m.inclination_median, LYING_TRUNK),
                at_most("spread", m.spread, LYING_SPREAD),
            ],
            Check::GetsUp => vec![
                at_most("stance_start", m.stance_start, LYING),
                at_least("inclination_start", m.inclination_start, LYING_TRUNK),
                at_least("rise", m.rise, TO_FLOOR),
            ],
            Check::CrawlsForward => with(
                crawls(m),
                at_least("forward_speed", m.forward_speed, CRAWLS),
            ),
            Check::CrawlsBackward => with(
                crawls(m),
                at_most("forward_speed", m.forward_speed, -CRAWLS),
            ),
            Check::Kneels => vec![
                at_least("kneeling", m.kneeling, KNEELS),
                at_least("stance_median", m.stance_median, KNEELING_STANCE),
            ],
            Check::Crouches => vec![
                within("stance_low", m.stance_low, CROUCHED),
                at_most("inclination_high", m.inclination_high, CROUCHED_TRUNK),
            ],
            Check::GoesUp => vec![
                at_least("stance_start", m.stance_start, UPRIGHT),
                at_least("rise", m.rise, CLIMBS),
            ],
            Check::GoesDown => vec![
                at_most("rise", m.rise, -CLIMBS),
                at_least("stance_end", m.stance_end, UPRIGHT),
            ],
            Check::PicksUp => vec![
                at_most("hand_low", m.hand_low, HAND_DOWN),
                at_least("hand_dip", m.hand_dip, HAND_DIPS),
                at_least("stance_end", m.stance_end, UPRIGHT),
            ],
            Check::BendsForward => vec![
                at_most("inclination_start", m.inclination_start, TRUNK_STRAIGHT),
                at_least("inclination_high", m.inclination_high, TRUNK_BENT),
                at_most("inclination_end", m.inclination_end, TRUNK_STRAIGHT),
            ],
            Check::StandsStill => vec![
                at_most("spread", m.spread, STILL_SPREAD),
                at_most("bustle", m.bustle, STILL_SPEED),
                at_least("stance_low", m.stance_low, UPRIGHT),
            ],
            Check::Dances => vec![
                at_least("liveliness", m.liveliness, DANCE_LIVELINESS),
                within(
                    "forward_speed",
                    m.forward_speed,
                    [-DANCE_TRAVELS, DANCE_TRAVELS],
                ),
                at_most("spread", m.spread, DANCE_SPREAD),
            ],
            Check::GoesUpsideDown => {
                vec![at_least(
                    "inclination_high",
                    m.inclination_high,
                    UPSIDE_DOWN,
                )]
            }
        }
    }
}

impl Side {
    /// At least as much to this side; the value counts to the left.
    fn at_least(self, quantity: &'static str, value: f32, limit: f32) -> Term {
        match self {
            Side::Left => at_least(quantity, value, limit),
            Side::Right => at_most(quantity, value, -limit),
        }
    }

    /// Between two amounts to this side; the value counts to the left.
    fn within(self, quantity: &'static str, value: f32, [least, most]: [f32; 2]) -> Term {
        let mut limits = [least, most].map(|limit| self.sign() * limit);
        limits.sort_by(f32::total_cmp);
        within(quantity, value, limits)
    }
}

fn hangs(m: &Measurements, side: Side) -> Term {
    let height = m.hand_over_shoulder[side.index()];
    at_most("other hand_over_shoulder", height, limits::HAND_HANGS)
}

fn jumps(m: &Measurements) -> Vec<Term> {
    vec![
        at_least("flight", m.flight, limits::JUMP_TIME),
        at_least("flight_height", m.flight_height, limits::JUMP_HEIGHT),
        at_least("flight_rise", m.flight_rise, limits::JUMP_RISE),
    ]
}

fn crawls(m: &Measurements) -> Vec<Term> {
    vec![
        at_most("stance_median", m.stance_median, limits::CRAWLING),
        at_least(
            "inclination_median",
            m.inclination_median,
            limits::CRAWLING_TRUNK,
        ),
    ]
}

fn with(mut terms: Vec<Term>, term: Term) -> Vec<Term> {
    terms.push(term);
    terms
}

/// The side with the larger value.
fn leader([left, right]: [f32; 2]) -> Side {
    match left >= right {
        true => Side::Left,
        false => Side::Right,
    }
}

fn at_least(quantity: &'static str, value: f32, limit: f32) -> Term {
    Term {
        quantity,
        value,
        at_least: Some(limit),
        at_most: None,
    }
}

fn at_most(quantity: &'static str, value: f32, limit: f32) -> Term {
    Term {
        quantity,
        value,
        at_least: None,
        at_most: Some(limit),
    }
}

fn within(quantity: &'static str, value: f32, [least, most]: [f32; 2]) -> Term {
    Term {
        quantity,
        value,
        at_least: Some(least),
        at_most: Some(most),
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = Check::ALL.iter().find(|(_, check)| check == self);
        match words {
            Some((words, _)) => f.pad(words),
            // No sentence has it, since there are no words for it.
            None => write!(f, "{self:?}"),
        }
    }
}

impl Serialize for Check {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Words that are no check.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a check such as `travels forward`, found `{0}`")]
pub struct CheckError(pub String);

impl FromStr for Check {
    type Err = CheckError;

    fn from_str(words: &str) -> Result<Check, CheckError> {
        let words = words.trim();
        let known = Check::ALL.iter().find(|(known, _)| *known == words);
        known
            .map(|(_, check)| *check)
            .ok_or_else(|| CheckError(words.into()))
    }
}

/// A measured value with what it has to be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Term {
    /// The field of [`Measurements`], which says the unit; with `other` before it that of the side that is not meant.
    pub quantity: &'static str,
    /// What was measured.
    pub value: f32,
    /// The least that it may be, if there is one.
    pub at_least: Option<f32>,
    /// The most that it may be, if there is one.
    pub at_most: Option<f32>,
}

impl Term {
    /// Whether the value is as it has to be. A value that is no number is not.
    pub fn holds(&self) -> bool {
        let is_enough = self.at_least.is_none_or(|limit| self.value >= limit);
        let is_little_enough = self.at_most.is_none_or(|limit| self.value <= limit);
        is_enough && is_little_enough && !self.value.is_nan()
    }
}

impl fmt::Display for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:.2} (", self.quantity, self.value)?;
        match (self.at_least, self.at_most) {
            (Some(least), Some(most)) if least == most => write!(f, "{least}")?,
            (Some(least), Some(most)) => write!(f, "{least} to {most}")?,
            (Some(least), None) => write!(f, "at least {least}")?,
            (None, Some(most)) => write!(f, "at most {most}")?,
            (None, None) => write!(f, "any")?,
        }
        f.write_str(")")
    }
}

/// What a check made of a motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The check.
    pub check: Check,
    /// What was measured for it; all of it has to hold.
    pub terms: Vec<Term>,
}

impl Verdict {
    /// Whether the motion does it.
    pub fn holds(&self) -> bool {
        self.terms.iter().all(Term::holds)
    }

    /// What is not as it has to be.
    pub fn faults(&self) -> impl Iterator<Item = &Term> {
        self.terms.iter().filter(|term| !term.holds())
    }
}
