//! All thresholds of the checks.
//!
//! They are chosen so that at least 95 of 100 real motions that are labelled with an action pass its check, and at most
//! 10 of 100 that are labelled with another action: `cargo xtask truth --validate` repeats the count.

/// The number of frames on either side over which heading and travel are averaged: a fifth of a second in all.
pub const SMOOTHING_FRAMES: usize = 2;
/// The number of frames at either end over which quantities at the start and at the end are averaged.
pub const EDGE_FRAMES: usize = 5;
/// The number of frames at either end over which the speed is averaged: half a second.
pub const END_FRAMES: usize = 10;
/// The quantile over frames of the lowest joint's height that is taken as the height of the floor.
pub const FLOOR_QUANTILE: f32 = 0.05;
/// The height of a standing body's pelvis over the floor, in lengths of a leg from hip to ankle.
pub const STANDING_PELVIS: f32 = 1.15;

/// A squat goes down: the stance is below this.
pub const SQUAT_DOWN: f32 = 0.83;
/// A squat comes up again: the stance is above this.
pub const SQUAT_UP: f32 = 0.9;

/// A knee is on the floor: its height is below this, m.
pub const KNEE_DOWN: f32 = 0.18;
/// The trunk is up: its inclination is below this, degrees.
pub const TRUNK_UP: f32 = 80.0;

/// The number of frames within which a fist is thrust out.
pub const THRUST_FRAMES: usize = 6;

/// A leg is stretched: the distance of hip and ankle is more than this share of the leg's length.
pub const LEG_STRETCHED: f32 = 0.88;
/// A foot is lifted: it is more than this higher than the other foot, m.
pub const FOOT_LIFTED: f32 = 0.1;
/// A foot makes a step: it is more than this higher than the other foot, m.
pub const STEP_HEIGHT: f32 = 0.04;

/// The height of an ankle over the toes when the foot is on the floor, m.
pub const ANKLE_OVER_TOES: f32 = 0.06;
/// The quantile over frames of the lower foot's height that is taken as its height when it stands.
pub const FEET_STAND_QUANTILE: f32 = 0.2;
/// Both feet are off the floor: the lower foot is more than this higher than when it stands, m.
pub const FLIGHT_HEIGHT: f32 = 0.05;
/// The least number of frames with both feet off the floor that count as a flight.
pub const FLIGHT_FRAMES: usize = 2;

/// Travels: the least mean speed forward or backward, m/s.
pub const TRAVELS: f32 = 0.25;
/// Travels sideways: the least mean speed to the side, m/s.
pub const SIDESTEPS: f32 = 0.15;
/// Travels sideways: the least distance to the side, as a share of the distances to the side and forward or backward.
pub const SIDEWAYS_SHARE: f32 = 0.3;
/// Runs: a fifth of the motion is faster than this, m/s.
pub const RUNS: f32 = 2.2;
/// Goes slowly: less than a fifth of the motion is faster than this, m/s.
pub const SLOW: f32 = 1.15;
/// Stays: the greatest distance from the start, m.
pub const STAYS: f32 = 0.8;
/// Steps in place: the least number of times that one foot is lifted after the other.
pub const STEPS: f32 = 4.0;
/// Stops: the least length of the path before, m.
pub const STOPS_AFTER: f32 = 1.5;
/// Stands at the start or the end: the greatest mean speed over half a second, m/s.
pub const STANDS: f32 = 0.3;
/// Starts: the least mean speed over the last half second, m/s.
pub const STARTED: f32 = 0.35;

/// Turns to a side: the least angle, degrees.
pub const TURNS: f32 = 30.0;
/// A quarter turn: the least and the greatest angle, degrees.
pub const QUARTER_TURN: [f32; 2] = [45.0, 135.0];
/// A half turn: the least and the greatest angle, degrees.
pub const HALF_TURN: [f32; 2] = [130.0, 230.0];
/// A circle: the least angle, degrees.
pub const CIRCLE: f32 = 225.0;
/// A circle: the least length of the path, m.
pub const CIRCLE_PATH: f32 = 1.5;

/// A hand is raised: the least height over its shoulder, m.
pub const HAND_RAISED: f32 = -0.02;
/// A hand hangs: the greatest height over its shoulder, m.
pub const HAND_HANGS: f32 = -0.2;
/// Both hands are raised: the least height over the shoulders, m.
pub const HANDS_RAISED: f32 = 0.1;
/// A hand is over the head: the least height over the head, m.
pub const OVER_HEAD: f32 = 0.0;
/// A hand is at the head: the greatest distance of the wrist from the middle of the head, m.
pub const HAND_AT_HEAD: f32 = 0.28;
/// A punch: the least speed of the fist, m/s.
pub const PUNCH_SPEED: f32 = 1.0;
/// A punch: the least distance that the fist is thrust out, m.
pub const PUNCH_THRUST: f32 = 0.07;
/// A punch of one fist: the least distance that it is thrust out farther than the other fist, m.
pub const PUNCH_LEAD: f32 = 0.015;
/// A punch: the greatest distance of the body from its start, m.
pub const PUNCH_SPREAD: f32 = 1.2;

/// A kick: the least height over the other foot, m.
pub const KICK_HEIGHT: f32 = 0.25;
/// A kick: the least height by which it is higher than the other foot's kick, m.
pub const KICK_LEAD: f32 = 0.15;
/// A kick: the least speed of the foot, m/s.
pub const KICK_SPEED: f32 = 3.3;
/// A knee is raised: the least height over the hip, m.
pub const KNEE_HIGH: f32 = -0.12;
/// A knee is raised: the greatest height over the hip of the other knee, m.
pub const KNEE_RESTS: f32 = -0.25;
/// Stands on one leg: the least time, s.
pub const ON_ONE_LEG: f32 = 1.5;
/// A lunge: the least distance of one foot ahead of the other, m.
pub const LUNGE_LENGTH: f32 = 0.35;
/// A lunge: the greatest value of the lowest stance.
pub const LUNGE_DOWN: f32 = 0.8;
/// A lunge to the side: the least angle by which the knee of this side is bent, degrees.
pub const LUNGE_KNEE: f32 = 60.0;
/// A lunge to the side: the least angle by which this knee is bent farther than the other, degrees.
pub const LUNGE_KNEE_LEAD: f32 = 30.0;
/// A lunge to the side: the least distance of the ankles, m.
pub const LUNGE_WIDTH: f32 = 0.5;

/// A jump: the least time with both feet off the floor, s.
pub const JUMP_TIME: f32 = 0.15;
/// A jump: the least height that the lower foot reaches, m.
pub const JUMP_HEIGHT: f32 = 0.06;
/// A jump: the least rise of the pelvis, m.
pub const JUMP_RISE: f32 = 0.08;
/// A jump forward: the least distance forward in all, m.
pub const JUMP_LENGTH: f32 = 0.7;
/// Several times: the least number.
pub const SEVERAL: f32 = 2.0;
/// Legs are spread: the least distance of the ankles, m.
pub const LEGS_SPREAD: f32 = 0.45;

/// Upright: the least stance.
pub const UPRIGHT: f32 = 0.85;
/// Seated on a chair or lower, but not lying: the least and the greatest stance.
pub const SEATED: [f32; 2] = [0.05, 0.8];
/// Seated: the greatest inclination of the trunk, degrees.
pub const SEATED_TRUNK: f32 = 50.0;
/// Lying: the greatest stance.
pub const LYING: f32 = 0.45;
/// Lying: the least inclination of the trunk, degrees.
pub const LYING_TRUNK: f32 = 60.0;
/// Lying: the greatest distance from the start, m.
pub const LYING_SPREAD: f32 = 0.5;
/// Down to the floor, or up from it: the least change of the pelvis's height, m.
pub const TO_FLOOR: f32 = 0.2;
/// Crawling: the greatest median stance.
pub const CRAWLING: f32 = 0.6;
/// Crawling: the least median inclination of the trunk, degrees.
pub const CRAWLING_TRUNK: f32 = 50.0;
/// Crawling: the least mean speed forward or backward, m/s.
pub const CRAWLS: f32 = 0.07;
/// Kneels: the least share of the motion, 0 to 1.
pub const KNEELS: f32 = 0.2;
/// Kneels: the least median stance.
pub const KNEELING_STANCE: f32 = 0.3;
/// Crouched: the least and the greatest value of the lowest stance.
pub const CROUCHED: [f32; 2] = [0.25, 0.65];
/// Crouched: the greatest inclination of the trunk at any time, degrees.
pub const CROUCHED_TRUNK: f32 = 75.0;

/// Goes up or down: the least change of the pelvis's height from start to end, m.
pub const CLIMBS: f32 = 0.18;
/// Picks up: the greatest height over the floor of the hand at its lowest, m.
pub const HAND_DOWN: f32 = 0.6;
/// Picks up: the least distance that the hand comes down, and comes up again, m.
pub const HAND_DIPS: f32 = 0.3;
/// The trunk is bent: the least inclination, degrees.
pub const TRUNK_BENT: f32 = 28.0;
/// The trunk is straight: the greatest inclination, degrees.
pub const TRUNK_STRAIGHT: f32 = 25.0;
/// Upside down: the least inclination of the trunk, degrees.
pub const UPSIDE_DOWN: f32 = 120.0;

/// Stands still: the greatest distance from the start, m.
pub const STILL_SPREAD: f32 = 0.35;
/// Stands still: in nine tenths of the motion, the fastest joint is slower than this, m/s.
pub const STILL_SPEED: f32 = 1.0;
/// Dances: the least mean speed of the joints relative to the pelvis, m/s.
pub const DANCE_LIVELINESS: f32 = 0.2;
/// Dances: the greatest mean speed forward or backward, m/s.
pub const DANCE_TRAVELS: f32 = 0.8;
/// Dances: the greatest distance from the start, m.
pub const DANCE_SPREAD: f32 = 4.3;

/// A valid check: the least share of real motions of its action that it holds for.
pub const TRUE_SHARE: f32 = 0.95;
/// A valid check: the greatest share of real motions of other actions that it holds for.
pub const FALSE_SHARE: f32 = 0.1;
/// The greatest angle that a real pelvis turns between two frames, degrees.
pub const PELVIS_SNAP: f32 = 60.0;
