//! The conditions of each check: measurements and their limits.

use super::checks::Check;
use super::limits;
use super::measurements::Measurements;
use super::side::{Direction, Side};
use super::verdict::Term;

impl Check {
    /// Returns the conditions of the check, which must all hold, with the measured values.
    pub(super) fn terms(self, m: &Measurements) -> Vec<Term> {
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
                hand_hangs(m, side.other()),
            ],
            Check::RaisesHandOverHead(side) => vec![
                at_least("hand_over_head", m.hand_over_head[side.index()], OVER_HEAD),
                hand_hangs(m, side.other()),
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
                let hand = side.unwrap_or(leading_side(m.thrust_lead)).index();
                let mut terms = vec![
                    at_least("hand_speed", m.hand_speed[hand], PUNCH_SPEED),
                    at_least("hand_thrust", m.hand_thrust[hand], PUNCH_THRUST),
                    at_most("spread", m.spread, PUNCH_SPREAD),
                ];
                // Without a side, both fists may be thrust out equally far.
                if side.is_some() {
                    terms.push(at_least("thrust_lead", m.thrust_lead[hand], PUNCH_LEAD));
                }
                terms
            }
            Check::Kicks(side) => {
                let side = side.unwrap_or(leading_side(m.kick_lead)).index();
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
            Check::Jumps => jump_terms(m),
            Check::JumpsInPlace => with_term(jump_terms(m), at_most("spread", m.spread, STAYS)),
            Check::JumpsForward => {
                with_term(jump_terms(m), at_least("advance", m.advance, JUMP_LENGTH))
            }
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
            Check::CrawlsForward => with_term(
                crawl_terms(m),
                at_least("forward_speed", m.forward_speed, CRAWLS),
            ),
            Check::CrawlsBackward => with_term(
                crawl_terms(m),
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
    /// Returns the condition that a value is at least a limit to this side. The value is positive to the left.
    fn at_least(self, quantity: &'static str, value: f32, limit: f32) -> Term {
        match self {
            Side::Left => at_least(quantity, value, limit),
            Side::Right => at_most(quantity, value, -limit),
        }
    }

    /// Returns the condition that a value is between two limits to this side. The value is positive to the left.
    fn within(self, quantity: &'static str, value: f32, [least, most]: [f32; 2]) -> Term {
        let mut limits = [least, most].map(|limit| self.sign() * limit);
        limits.sort_by(f32::total_cmp);
        within(quantity, value, limits)
    }
}

/// Returns the condition that the hand of a side hangs.
fn hand_hangs(m: &Measurements, side: Side) -> Term {
    let height = m.hand_over_shoulder[side.index()];
    at_most("other hand_over_shoulder", height, limits::HAND_HANGS)
}

/// Returns the conditions of a jump.
fn jump_terms(m: &Measurements) -> Vec<Term> {
    vec![
        at_least("flight", m.flight, limits::JUMP_TIME),
        at_least("flight_height", m.flight_height, limits::JUMP_HEIGHT),
        at_least("flight_rise", m.flight_rise, limits::JUMP_RISE),
    ]
}

/// Returns the conditions of crawling, without its direction.
fn crawl_terms(m: &Measurements) -> Vec<Term> {
    vec![
        at_most("stance_median", m.stance_median, limits::CRAWLING),
        at_least(
            "inclination_median",
            m.inclination_median,
            limits::CRAWLING_TRUNK,
        ),
    ]
}

/// Appends a condition to others.
fn with_term(mut terms: Vec<Term>, term: Term) -> Vec<Term> {
    terms.push(term);
    terms
}

/// Returns the side with the larger value.
fn leading_side([left, right]: [f32; 2]) -> Side {
    match left >= right {
        true => Side::Left,
        false => Side::Right,
    }
}

/// Returns the condition that a value is at least a limit.
fn at_least(quantity: &'static str, value: f32, limit: f32) -> Term {
    Term {
        quantity,
        value,
        at_least: Some(limit),
        at_most: None,
    }
}

/// Returns the condition that a value is at most a limit.
fn at_most(quantity: &'static str, value: f32, limit: f32) -> Term {
    Term {
        quantity,
        value,
        at_least: None,
        at_most: Some(limit),
    }
}

/// Returns the condition that a value is between two limits.
fn within(quantity: &'static str, value: f32, [least, most]: [f32; 2]) -> Term {
    Term {
        quantity,
        value,
        at_least: Some(least),
        at_most: Some(most),
    }
}
