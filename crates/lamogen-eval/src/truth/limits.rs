//! Every threshold of the checks, in one place.
//!
//! They are set so that at least 95 of 100 real motions that are said to do a thing pass its check, and at most 10 of 100 that
//! are said to do something else: `cargo xtask truth --validate` repeats the count.

/// Frames to either side over which heading and travel are averaged: a fifth of a second in all.
pub const SMOOTHING_FRAMES: usize = 2;
/// Frames at either end over which a start or an end is averaged.
pub const EDGE_FRAMES: usize = 5;
/// Frames at either end over which the speed there is averaged: half a second.
pub const END_FRAMES: usize = 10;
/// The floor is where the lowest joint stays above in all but this share of the frames.
pub const FLOOR_QUANTILE: f32 = 0.05;
/// Height of a standing body's pelvis over the floor, in lengths of a leg from hip to ankle.
pub const STANDING_PELVIS: f32 = 1.15;

/// A squat has gone down where the stance is below this.
pub const SQUAT_DOWN: f32 = 0.83;
/// A squat has come up where the stance is above this.
pub const SQUAT_UP: f32 = 0.9;

/// A knee is at the floor below this height, m.
pub const KNEE_DOWN: f32 = 0.18;
/// A trunk is up below this inclination, degrees.
pub const TRUNK_UP: f32 = 80.0;

/// Frames in which a fist is thrust out.
pub const THRUST_FRAMES: usize = 6;

/// A leg is stretched where hip and ankle are farther apart than this share of its length.
pub const LEG_STRETCHED: f32 = 0.88;
/// A foot is lifted that is this much higher than the other, m.
pub const FOOT_LIFTED: f32 = 0.1;
/// A foot steps that is this much higher than the other, m.
pub const STEP_HEIGHT: f32 = 0.04;

/// An ankle stands this much higher than the toes beside it, m.
pub const ANKLE_OVER_TOES: f32 = 0.06;
/// Feet stand where the lower one is in this share of the frames, or below.
pub const FEET_STAND_QUANTILE: f32 = 0.2;
/// Both feet are off the floor where the lower one is this much higher than it stands, m.
pub const FLIGHT_HEIGHT: f32 = 0.05;
/// Both feet have left the floor after as many frames.
pub const FLIGHT_FRAMES: usize = 2;

/// Travels: this speed forward or backward over the whole motion, m/s.
pub const TRAVELS: f32 = 0.25;
/// Travels sideways: this speed to the side over the whole motion, m/s.
pub const SIDESTEPS: f32 = 0.15;
/// Travels sideways: the way to the side as a share of that and the way forward or backward.
pub const SIDEWAYS_SHARE: f32 = 0.3;
/// Runs: a fifth of the motion is faster, m/s.
pub const RUNS: f32 = 2.2;
/// Goes slowly: less than a fifth of the motion is faster, m/s.
pub const SLOW: f32 = 1.15;
/// Stays: no farther from the start, m.
pub const STAYS: f32 = 0.8;
/// Steps in place: as many times one foot is lifted and then the other.
pub const STEPS: f32 = 4.0;
/// Stops: after a way as long, m.
pub const STOPS_AFTER: f32 = 1.5;
/// Stands at the start or the end: no faster over half a second, m/s.
pub const STANDS: f32 = 0.3;
/// Has started: as fast over the last half second, m/s.
pub const STARTED: f32 = 0.35;

/// Turns to a side: as much, degrees.
pub const TURNS: f32 = 30.0;
/// A quarter turn, degrees.
pub const QUARTER_TURN: [f32; 2] = [45.0, 135.0];
/// A half turn, degrees.
pub const HALF_TURN: [f32; 2] = [130.0, 230.0];
/// A circle: as much or more, degrees.
pub const CIRCLE: f32 = 225.0;
/// A circle: on a way as long, m.
pub const CIRCLE_PATH: f32 = 1.5;

/// A hand is raised as high over its shoulder, m.
pub const HAND_RAISED: f32 = -0.02;
/// A hand hangs that stays as far below its shoulder, m.
pub const HAND_HANGS: f32 = -0.2;
/// Both hands are raised as high over the shoulders, m.
pub const HANDS_RAISED: f32 = 0.1;
/// A hand is over the head when as high over it, m.
pub const OVER_HEAD: f32 = 0.0;
/// A hand is at the head when no farther from it, wrist to middle of the head, m.
pub const HAND_AT_HEAD: f32 = 0.28;
/// A fist is as fast, m/s.
pub const PUNCH_SPEED: f32 = 1.0;
/// A fist is thrust out as far, m.
pub const PUNCH_THRUST: f32 = 0.07;
/// A fist is thrust out farther than the other by as much, m.
pub const PUNCH_LEAD: f32 = 0.015;
/// Who punches gets no farther, m.
pub const PUNCH_SPREAD: f32 = 1.2;

/// A kick is as high over the foot that stands, m.
pub const KICK_HEIGHT: f32 = 0.25;
/// A kick is higher than what the other foot does by as much, m.
pub const KICK_LEAD: f32 = 0.15;
/// A kicking foot is as fast, m/s.
pub const KICK_SPEED: f32 = 3.3;
/// A raised knee is as high over the hip, m.
pub const KNEE_HIGH: f32 = -0.12;
/// The knee of the leg that stands is no higher over the hip, m.
pub const KNEE_RESTS: f32 = -0.25;
/// Stands on one leg: as long, s.
pub const ON_ONE_LEG: f32 = 1.5;
/// A lunge: one foot is as far ahead of the other, m.
pub const LUNGE_LENGTH: f32 = 0.35;
/// A lunge: the stance is no higher.
pub const LUNGE_DOWN: f32 = 0.8;
/// A lunge to the side: its knee is bent as far, degrees.
pub const LUNGE_KNEE: f32 = 60.0;
/// A lunge to the side: its knee is bent farther than the other by as much, degrees.
pub const LUNGE_KNEE_LEAD: f32 = 30.0;
/// A lunge to the side: the ankles are as far apart, m.
pub const LUNGE_WIDTH: f32 = 0.5;

/// A jump: both feet are off the floor as long, s.
pub const JUMP_TIME: f32 = 0.15;
/// A jump: the lower foot gets as high, m.
pub const JUMP_HEIGHT: f32 = 0.06;
/// A jump: the pelvis gets as much higher, m.
pub const JUMP_RISE: f32 = 0.08;
/// A jump forward: as far in all, m.
pub const JUMP_LENGTH: f32 = 0.7;
/// Several times: as many.
pub const SEVERAL: f32 = 2.0;
/// Legs are spread where the ankles get as far apart, m.
pub const LEGS_SPREAD: f32 = 0.45;

/// Upright: the stance is as high.
pub const UPRIGHT: f32 = 0.85;
/// Seated, on a chair or lower, but not lying: the stance.
pub const SEATED: [f32; 2] = [0.05, 0.8];
/// Seated: the trunk is inclined no farther, degrees.
pub const SEATED_TRUNK: f32 = 50.0;
/// Lying: the stance is no higher.
pub const LYING: f32 = 0.45;
/// Lying: the trunk is inclined as far, degrees.
pub const LYING_TRUNK: f32 = 60.0;
/// Lying: no farther from the start, m.
pub const LYING_SPREAD: f32 = 0.5;
/// To the floor, or up from it: the pelvis moves as far, m.
pub const TO_FLOOR: f32 = 0.2;
/// Crawling: the stance is no higher half of the time.
pub const CRAWLING: f32 = 0.6;
/// Crawling: the trunk is inclined as far half of the time, degrees.
pub const CRAWLING_TRUNK: f32 = 50.0;
/// Crawling: as fast over the whole motion, m/s.
pub const CRAWLS: f32 = 0.07;
/// Kneels: as much of the motion, 0 to 1.
pub const KNEELS: f32 = 0.2;
/// Kneels: the median stance is as high.
pub const KNEELING_STANCE: f32 = 0.3;
/// Crouched: the stance at its lowest.
pub const CROUCHED: [f32; 2] = [0.25, 0.65];
/// Crouched: the trunk is never inclined farther, degrees.
pub const CROUCHED_TRUNK: f32 = 75.0;

/// Goes up or down: the pelvis is as much higher or lower at the end, m.
pub const CLIMBS: f32 = 0.18;
/// A hand that picks up gets as low, m over the floor.
pub const HAND_DOWN: f32 = 0.6;
/// A hand that picks up comes down and up by as much, m.
pub const HAND_DIPS: f32 = 0.3;
/// A trunk is bent that is inclined as far, degrees.
pub const TRUNK_BENT: f32 = 28.0;
/// A trunk is straight that is inclined no farther, degrees.
pub const TRUNK_STRAIGHT: f32 = 25.0;
/// Upside down: the trunk is inclined as far, degrees.
pub const UPSIDE_DOWN: f32 = 120.0;

/// Stands still: no farther from the start, m.
pub const STILL_SPREAD: f32 = 0.35;
/// Stands still: the fastest joint is slower in nine tenths of the motion, m/s.
pub const STILL_SPEED: f32 = 1.0;
/// Dances: joints move as fast on average, as seen from the pelvis, m/s.
pub const DANCE_LIVELINESS: f32 = 0.2;
/// Dances: no faster forward or backward over the whole motion, m/s.
pub const DANCE_TRAVELS: f32 = 0.8;
/// Dances: no farther from the start, m.
pub const DANCE_SPREAD: f32 = 4.3;

/// A check is good enough that holds for this share of the real motions that are said to do it, or more.
pub const TRUE_SHARE: f32 = 0.95;
/// A check is good enough that holds for this share of the real motions that do something else, or less.
pub const FALSE_SHARE: f32 = 0.1;
/// No pelvis turns farther between two frames, degrees.
pub const PELVIS_SNAP: f32 = 60.0;
