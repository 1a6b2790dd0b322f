//! Examples for the checks of hands and legs. There is one function per check.

use super::Examples;
use super::clips::{Clips, clips, clips_of_side, side_names};
use crate::truth::side::Side;

pub(super) fn raises_hand(side: Side) -> Examples {
    let [this, other] = side_names(side);
    let waves = |side: &str| {
        let [arm, hand] = ["arm", "hand"].map(|limb| format!("with the {side} {limb}"));
        let raises = format!("raises the {side} hand");
        clips(["wave", "greet"]).with_words([&arm, &hand, &raises])
    };
    Examples::new(
        vec![clips_of_side("arm-raise-side", side), waves(this)],
        vec![
            clips_of_side("arm-raise-side", side.other()),
            waves(other),
            clips(["squat", "walk", "run", "stand", "arm-extend-back-*"]),
        ],
    )
}

pub(super) fn raises_hand_over_head(side: Side) -> Examples {
    Examples::new(
        vec![
            clips_of_side("arm-raise-side", side)
                .with_words(["overhead", "over their head", "over his head", "up high"])
                .without_words(["not ", "only", "partway", "about as high"]),
        ],
        vec![
            clips_of_side("arm-raise-side", side.other()),
            clips(["arm-raise-diagonal-*", "arm-extend-back-*"]),
            clips(["squat", "walk", "run", "stand"]),
        ],
    )
}

pub(super) fn raises_both_hands() -> Examples {
    Examples::new(
        vec![
            clips(["jumping-jacks", "lift-overhead", "sit-to-stand"]),
            clips(["squat"]).with_words(["overhead", "over their head", "arms up"]),
        ],
        vec![clips_without_both_hands_up()],
    )
}

pub(super) fn raises_both_hands_over_head() -> Examples {
    Examples::new(
        vec![
            clips(["jumping-jacks", "lift-overhead"]),
            clips(["squat"]).with_words(["overhead", "over their head", "arms up"]),
        ],
        vec![clips_without_both_hands_up()],
    )
}

pub(super) fn brings_hand_to_head() -> Examples {
    Examples::new(
        vec![clips(["drink", "eat", "scratch-head"])],
        vec![
            clips(["walk", "run", "walk-back", "squat"]),
            clips(["leg-raise-*", "arm-extend-back-*"]),
        ],
    )
}

pub(super) fn punches(side: Option<Side>) -> Examples {
    let punches = |side: Side| {
        let [this, other] = side_names(side);
        let limbs = ["fist", "hand", "arm"].map(|limb| format!("{this} {limb}"));
        [
            clips(["punch"])
                .with_words(limbs.each_ref().map(|limb| &**limb))
                .without_words([other]),
            clips(["punch-*"]).with_words([this]).without_words([other]),
        ]
    };
    let others = vec![
        clips(["walk", "run", "stand", "squat", "lunge-*"]),
        clips(["arm-raise-*", "arm-extend-back-*"]),
    ];
    match side {
        Some(side) => {
            let opposite = punches(side.other()).into_iter();
            Examples::new(punches(side).into(), opposite.chain(others).collect())
        }
        None => Examples::new(vec![clips(["punch", "punch-*"])], others),
    }
}

pub(super) fn kicks(side: Option<Side>) -> Examples {
    let kicks = |side: Side| {
        let [this, other] = side_names(side);
        let kinds = [
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
        let contents = kinds.map(|kind| format!("kick-{kind}-{this}"));
        [
            clips(["kick"]).with_words([this]).without_words([other]),
            clips(contents.each_ref().map(|content| &**content)),
        ]
    };
    let others = vec![
        clips(["walk", "run", "stand", "squat", "punch", "punch-*"]),
        clips(["knee-raise-*", "lunge-*"]),
    ];
    match side {
        Some(side) => {
            let opposite = kicks(side.other()).into_iter();
            Examples::new(kicks(side).into(), opposite.chain(others).collect())
        }
        None => Examples::new(vec![clips(["kick", "kick-*"])], others),
    }
}

pub(super) fn raises_knee(side: Side) -> Examples {
    Examples::new(
        vec![clips_of_side("knee-raise", side)],
        vec![
            clips_of_side("knee-raise", side.other()),
            clips(["walk", "run", "stand", "squat", "lunge-*", "arm-raise-*"]),
        ],
    )
}

pub(super) fn stands_on_leg(side: Option<Side>) -> Examples {
    let balance = |side: &str| {
        let [leg, foot] = ["leg", "foot"].map(|limb| format!("{side} {limb}"));
        let [on_leg, on_foot] =
            [leg, foot].map(|limb| ["on the ", "on their "].map(|on| format!("{on}{limb}")));
        clips(["balance"]).with_words([&on_leg[0], &on_leg[1], &on_foot[0], &on_foot[1]])
    };
    let both = clips(["walk", "run", "stand", "squat", "arm-raise-*"]);
    match side {
        Some(side) => {
            let [this, other] = side_names(side);
            Examples::new(vec![balance(this)], vec![balance(other), both])
        }
        None => Examples::new(vec![clips(["balance"])], vec![both]),
    }
}

pub(super) fn lunges(side: Side) -> Examples {
    Examples::new(
        vec![clips_of_side("lunge", side)],
        vec![
            clips_of_side("lunge", side.other()),
            clips(["walk", "run", "stand", "squat", "sit-to-stand"]),
        ],
    )
}

pub(super) fn lunges_aside(side: Side) -> Examples {
    Examples::new(
        vec![clips_of_side("side-lunge", side)],
        vec![
            clips_of_side("side-lunge", side.other()),
            clips(["walk", "run", "stand", "squat", "sit-to-stand"]),
        ],
    )
}

/// Returns the choice of motions in which both hands are never up at once.
fn clips_without_both_hands_up() -> Clips {
    clips([
        "walk",
        "run",
        "stand",
        "arm-raise-*",
        "arm-extend-back-*",
        "drink",
    ])
}
