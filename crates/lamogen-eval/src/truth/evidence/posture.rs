//! Examples for the checks of the whole body, such as squats, jumps and lying. There is one function per check.

use super::Examples;
use super::clips::{Clips, clips, clips_in_place};

pub(super) fn squats(times: u8) -> Examples {
    let squats = |times: u8| {
        let squats = clips(["squat"]);
        let squats = match times {
            1 => squats.with_words([" once", "one time", " a squat", " a deep squat"]),
            2 => squats.with_words([" two ", "twice"]),
            _ => squats.with_words(["three"]),
        };
        // These words leave out squats that do not go far down, and a clip of many squats.
        squats.without_words([
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
    Examples::new(vec![squats(times)], fails)
}

pub(super) fn jumps() -> Examples {
    Examples::new(
        vec![clips([
            "jump",
            "hop",
            "leap",
            "jump-running",
            "jumping-jacks",
        ])],
        vec![
            clips(["walk", "run", "walk-back", "sidestep"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn jumps_in_place() -> Examples {
    Examples::new(
        vec![clips(["jump"]).with_words(["in place", "straight up", "on the spot", "vertical"])],
        vec![
            clips(["walk", "run", "walk-back", "sidestep"]),
            clips(["leap", "jump-running"]),
            clips(["jump"]).with_words(["forward"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn jumps_forward() -> Examples {
    Examples::new(
        vec![clips(["jump", "hop", "leap", "jump-running"]).with_words([
            "jumps forward",
            "hops forward",
            "leaps forward",
            "jumps far forward",
            "jumps over",
            "hops over",
        ])],
        vec![
            clips(["walk", "run", "walk-back", "sidestep"]),
            clips(["jump"]).with_words(["in place", "straight up"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn jumps_again() -> Examples {
    Examples::new(
        vec![clips(["jump", "hop", "jumping-jacks"]).with_words([
            "two times",
            "three times",
            "four times",
            "twice",
            "again and again",
            "many times",
        ])],
        vec![clips(["walk", "walk-back", "sidestep"]), clips_in_place()],
    )
}

pub(super) fn does_jumping_jacks() -> Examples {
    Examples::new(
        vec![clips(["jumping-jacks"])],
        vec![
            clips(["walk", "run", "jump", "hop", "sidestep"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn sits_down() -> Examples {
    Examples::new(
        vec![clips(["sit"]).with_words(["sits down on a low stool", "sits down on a stepstool"])],
        vec![
            clips(["walk", "run", "jump", "hop", "sidestep"]),
            clips(["lie-down", "stand-up", "get-up"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn stands_up() -> Examples {
    Examples::new(
        vec![
            clips(["crouch-to-walk", "crouch-to-run"]),
            clips(["stand-up"]).with_words(["low stool"]),
        ],
        vec![
            clips(["walk", "run", "jump", "hop", "sidestep"]),
            clips(["lie-down", "lie", "crawl"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn sits_down_and_gets_up() -> Examples {
    Examples::new(
        vec![clips(["sit-to-stand"])],
        vec![
            clips(["walk", "run", "hop", "sidestep", "lie-down", "lie", "crawl"]),
            clips(["stand", "look-around", "arm-raise-*", "leg-raise-*"]),
        ],
    )
}

pub(super) fn lies_down() -> Examples {
    Examples::new(
        vec![clips(["lie-down", "fall"])],
        vec![
            clips([
                "walk", "run", "jump", "get-up", "crawl", "lie", "crouch", "sit",
            ]),
            clips_in_place(),
        ],
    )
}

pub(super) fn lies() -> Examples {
    Examples::new(
        vec![clips(["lie"])],
        vec![
            clips(["walk", "run", "jump", "get-up", "crawl", "crouch", "sit"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn gets_up() -> Examples {
    Examples::new(
        vec![clips(["get-up"])],
        vec![
            clips([
                "walk", "run", "jump", "lie-down", "crawl", "lie", "crouch", "sit",
            ]),
            clips_in_place(),
        ],
    )
}

/// Returns the examples of crawling in the direction of the content `this`, with crawling in the opposite direction.
pub(super) fn crawls(this: &str, opposite: &str) -> Examples {
    Examples::new(
        vec![clips([this])],
        vec![
            clips([opposite, "walk", "run", "jump", "lie", "crouch", "sit"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn kneels() -> Examples {
    Examples::new(
        vec![clips(["kneel"])],
        vec![
            clips(["walk", "run", "jump", "lie", "crawl", "crawl-back", "sit"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn crouches() -> Examples {
    Examples::new(
        vec![clips(["crouch", "run-to-crouch", "walk-to-crouch"])],
        vec![
            clips(["walk", "run", "lie", "lie-down", "crawl", "crawl-back"]),
            clips(["stand", "look-around", "arm-raise-*", "arm-extend-back-*"]),
        ],
    )
}

pub(super) fn goes_up() -> Examples {
    Examples::new(
        vec![
            clips(["climb-stairs"]).without_words(["down"]),
            clips(["climb"])
                .with_words(["ladder"])
                .without_words(["down", "duck"]),
        ],
        vec![
            clips(["walk", "run", "jump", "sit", "go-down-stairs", "climb-down"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn goes_down() -> Examples {
    Examples::new(
        vec![clips(["go-down-stairs", "climb-down"])],
        vec![
            clips(["walk", "run", "jump", "sit", "crouch", "climb-stairs"]),
            clips_in_place(),
        ],
    )
}

pub(super) fn picks_up() -> Examples {
    Examples::new(
        vec![clips(["pick-up", "walk-pick-up", "run-pick-up"]).without_words(["table"])],
        vec![
            clips(["walk", "run", "jump", "sit", "stand", "look-around"]),
            clips([
                "arm-raise-*",
                "arm-extend-back-*",
                "drink",
                "referee-signal",
            ]),
        ],
    )
}

pub(super) fn bends_forward() -> Examples {
    Examples::new(
        vec![
            clips(["bow"]),
            clips(["pick-up", "wash", "walk-pick-up"])
                .with_words([
                    "bends over",
                    "bends down",
                    "bends forward",
                    "bends far forward",
                ])
                .without_words(["squat", "bends at the knees"]),
        ],
        vec![
            clips(["walk", "run"]).without_style(),
            clips(["stand", "look-around", "drink", "arm-raise-*"]),
        ],
    )
}

pub(super) fn stands_still() -> Examples {
    Examples::new(
        vec![clips(["stand"]).without_words(["drunk", "too much to drink", "begins to walk"])],
        vec![
            clips(["walk", "run", "jump", "dance", "punch", "kick", "sidestep"]),
            clips(["squat", "leg-raise-*", "knee-raise-*"]),
        ],
    )
}

pub(super) fn dances() -> Examples {
    Examples::new(
        vec![clips(["dance"]).without_words(["runs forward", "moves forward", "runs ahead"])],
        vec![
            clips(["walk", "run"]).without_style(),
            clips(["stand", "look-around", "lie", "drink"]),
            // These words leave out people who get up, walk about and sit down again.
            clips(["sit"]).without_words(["stands up", "gets up", "rises", "walk", "turn"]),
        ],
    )
}

pub(super) fn goes_upside_down() -> Examples {
    Examples::new(
        vec![clips(["cartwheel", "flip"])],
        vec![clips([
            "walk", "run", "jump", "hop", "dance", "squat", "lie", "crawl",
        ])],
    )
}
