//! Examples for the checks of travel and turning. There is one function per check.

use super::Examples;
use super::clips::{Clips, clips, clips_in_place, clips_of_side, side_names};
use crate::truth::side::{Direction, Side};

pub(super) fn travels(direction: Direction) -> Examples {
    match direction {
        Direction::Forward => Examples::new(
            vec![clips(["walk", "run", "walk-turn-*", "run-turn-*"])],
            vec![clips(["walk-back", "run-back"]), clips_in_place()],
        ),
        Direction::Backward => Examples::new(
            vec![clips(["walk-back", "run-back"])],
            vec![clips(["walk", "run"]), clips_in_place()],
        ),
        Direction::Sideways(side) => {
            let [this, other] = side_names(side);
            Examples::new(
                vec![
                    clips_of_side("side-step", side),
                    clips_of_side("side-step-fast", side),
                    clips(["sidestep"])
                        .with_words([&format!("to the {this}")])
                        .without_words([other]),
                ],
                vec![
                    clips_of_side("side-step", side.other()),
                    clips_of_side("side-step-fast", side.other()),
                    clips(["walk", "run", "walk-back", "run-back", "stand", "squat"]),
                ],
            )
        }
    }
}

pub(super) fn runs() -> Examples {
    Examples::new(
        vec![clips(["run"]).without_style()],
        vec![clips(["walk", "walk-back", "sidestep"]), clips_in_place()],
    )
}

pub(super) fn goes_slowly() -> Examples {
    Examples::new(
        vec![clips(["walk"]).with_words(["slow"]).without_style()],
        vec![
            clips(["walk"])
                .with_words(["fast", "brisk"])
                .without_style(),
            clips(["run"]),
        ],
    )
}

pub(super) fn stays() -> Examples {
    Examples::new(
        vec![clips_in_place()],
        vec![clips(["walk", "run", "walk-back", "run-back", "sidestep"])],
    )
}

pub(super) fn steps_in_place() -> Examples {
    Examples::new(
        vec![clips(["jog-in-place"])],
        vec![clips(["walk", "run", "jump"]), clips_in_place()],
    )
}

pub(super) fn stops() -> Examples {
    Examples::new(
        vec![
            clips(["walk-to-stand", "run-to-stand"]),
            clips(["skip"])
                .with_words(["stop", "stands still", "halt"])
                .without_words(["standstill"]),
        ],
        vec![clips(["walk", "run", "walk-back"]), clips_in_place()],
    )
}

pub(super) fn starts() -> Examples {
    Examples::new(
        vec![clips(["stand-to-walk"])],
        vec![
            clips(["walk", "run", "walk-back", "walk-to-stand"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn turns(side: Side) -> Examples {
    Examples::new(
        vec![
            clips_of_side("walk-turn", side),
            clips_of_side("run-turn", side),
        ],
        vec![
            clips_of_side("walk-turn", side.other()),
            clips_of_side("run-turn", side.other()),
            clips(["walk", "run"]).without_style(),
            clips_in_place(),
        ],
    )
}

pub(super) fn turns_quarter(side: Side) -> Examples {
    Examples::new(
        [
            clips_of_side("walk-turn", side),
            clips_of_side("run-turn", side),
        ]
        .map(|turns| {
            turns
                .with_words(["90", "right angle", "ninety", "quarter"])
                .without_words(["more than", "135", "sharply", "most of the way"])
        })
        .into(),
        vec![
            clips_of_side("walk-turn", side.other()),
            clips_of_side("run-turn", side.other()),
            clips(["walk", "run"]).without_style(),
            clips(["walk-turn-around", "run-turn-around"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn turns_around(side: Option<Side>) -> Examples {
    let [this, other] = side.map_or(["", ""], side_names);
    let around = clips(["walk-turn-around", "run-turn-around"]);
    let opposite = match side {
        Some(_) => around.clone().with_words([other]),
        None => Clips::default(),
    };
    Examples::new(
        vec![around.with_words([this])],
        vec![
            opposite,
            clips(["walk", "run"]).without_style(),
            clips_in_place(),
        ],
    )
}

pub(super) fn turns_in_circle(side: Option<Side>) -> Examples {
    let circles = clips(["walk", "walk-back", "sidestep"]);
    let (holds, fails) = match side {
        Some(side) => {
            let circle = |side: Side| format!("in a full circle to the {}", side.name());
            let opposite = circles.clone().with_words([&circle(side.other())]);
            (circles.with_words([&circle(side)]), opposite)
        }
        None => (circles.with_words(["in a full circle"]), Clips::default()),
    };
    let turns = clips(["walk-turn-*", "run-turn-*"]);
    let straight = clips(["walk", "run"]).without_style();
    Examples::new(vec![holds], vec![fails, turns, straight, clips_in_place()])
}
