//! What is measured of a motion, once for all checks.

use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion};
use serde::Serialize;

use super::limits;
use super::trajectory::{Trajectory, difference, length, quantile};

/// What checks look at: numbers of one motion, measured on its joint positions. Lengths are metres, times seconds, angles degrees;
/// pairs are of the left and the right side.
///
/// *Forward* and *left* are the body's own: which way hips and shoulders face. The *floor* is the motion's own, the level that
/// its lowest joint keeps to. A *stance* is the height of the pelvis as a share of that of a standing body.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Measurements {
    /// Length of the motion, s.
    pub seconds: f32,
    /// How far it gets forward, as it faces at its start, m.
    pub net_forward: f32,
    /// How far it gets to the left, as it faces at its start, m.
    pub net_left: f32,
    /// How far it goes forward, step by step as it faces at the time, less what it goes backward, m.
    pub advance: f32,
    /// How far it goes to the left, step by step as it faces at the time, less what it goes to the right, m.
    pub sidle: f32,
    /// `advance` a second, m/s.
    pub forward_speed: f32,
    /// `sidle` a second, m/s.
    pub left_speed: f32,
    /// The way to the side, left less right, as a share of that and `advance`, both whichever way they are; 0 to 1.
    pub sideways_share: f32,
    /// The way of the pelvis along the ground, m.
    pub path: f32,
    /// How far the pelvis gets from where it starts, along the ground, m.
    pub spread: f32,
    /// The speed along the ground that four fifths of the motion stay below, m/s.
    pub speed_high: f32,
    /// The median speed along the ground, m/s.
    pub speed_median: f32,
    /// The mean speed along the ground of the first half second, m/s.
    pub speed_start: f32,
    /// The mean speed along the ground of the last half second, m/s.
    pub speed_end: f32,
    /// The change of heading from start to end, degrees; to the left is positive.
    pub turn: f32,
    /// The change of heading from start to end whichever way it is, degrees.
    pub turn_either: f32,
    /// How much higher the pelvis is at the end than at the start, m.
    pub rise: f32,
    /// The highest that the pelvis gets above where it starts, m.
    pub climb: f32,
    /// The stance at the start.
    pub stance_start: f32,
    /// The stance at the end.
    pub stance_end: f32,
    /// The least stance.
    pub stance_low: f32,
    /// The greatest stance.
    pub stance_high: f32,
    /// The median stance.
    pub stance_median: f32,
    /// How often the pelvis goes down and comes up again.
    pub squats: f32,
    /// Inclination of the trunk at the start, degrees: 0 upright, 90 lying.
    pub inclination_start: f32,
    /// Inclination of the trunk at the end, degrees.
    pub inclination_end: f32,
    /// The greatest inclination of the trunk, degrees.
    pub inclination_high: f32,
    /// The median inclination of the trunk, degrees.
    pub inclination_median: f32,
    /// How high each hand gets over its shoulder, m; negative where it stays below.
    pub hand_over_shoulder: [f32; 2],
    /// How high both hands get over their shoulders at once, m: the lower of both counts.
    pub hands_over_shoulders: f32,
    /// How high each hand gets over the head, m.
    pub hand_over_head: [f32; 2],
    /// How high both hands get over the head at once, m.
    pub hands_over_head: f32,
    /// How low a hand gets over the floor, the lower of both, m.
    pub hand_low: f32,
    /// How much a hand comes down from where it is before to where it is lowest, and comes up again: the lesser of both, m.
    pub hand_dip: f32,
    /// The greatest speed of each hand as seen from the pelvis, m/s.
    pub hand_speed: [f32; 2],
    /// How near each hand gets to the head, m.
    pub hand_to_head: [f32; 2],
    /// How far each hand is thrust out from its shoulder within a short time, m.
    pub hand_thrust: [f32; 2],
    /// How much farther each hand is thrust out so than the other one, m.
    pub thrust_lead: [f32; 2],
    /// How high each foot gets over the other one with its leg stretched, m.
    pub kick_height: [f32; 2],
    /// How much higher each foot gets so than the other one does, m.
    pub kick_lead: [f32; 2],
    /// The longest time that the body stands on each leg, with the other foot lifted, s.
    pub one_leg: [f32; 2],
    /// The greatest speed of each foot as seen from the pelvis, m/s.
    pub foot_speed: [f32; 2],
    /// How high each knee gets over the hip, m, while the other foot stands and its knee is lower; negative where it stays below.
    pub knee_over_hip: [f32; 2],
    /// How far each ankle gets in front of the other one while the pelvis is lowest, m.
    pub foot_ahead: [f32; 2],
    /// How far each knee is bent while the pelvis is lowest, degrees; 0 is a straight leg.
    pub knee_bent: [f32; 2],
    /// How much farther each knee is bent then than the other one, degrees.
    pub knee_bent_lead: [f32; 2],
    /// How far the ankles get apart along the ground, m.
    pub feet_apart: f32,
    /// How far the ankles are apart along the ground while the pelvis is lowest, m.
    pub feet_apart_low: f32,
    /// How often both feet leave the floor.
    pub flights: f32,
    /// The longest time that both feet are off the floor, s.
    pub flight: f32,
    /// How high the lower foot gets over where it stands, m.
    pub flight_height: f32,
    /// How much higher the pelvis gets while both feet are off the floor than when it stands, m.
    pub flight_rise: f32,
    /// How low a knee gets over the floor, m.
    pub knee_low: f32,
    /// The share of the motion in which a knee is at the floor and the trunk is up, 0 to 1.
    pub kneeling: f32,
    /// How often the feet change which of them is higher.
    pub steps: f32,
    /// The mean speed of all joints as seen from the pelvis, m/s.
    pub liveliness: f32,
    /// The speed of the fastest joint that nine tenths of the motion stay below, m/s.
    pub bustle: f32,
}

const SIDES: [usize; 2] = [0, 1];
const HIPS: [Joint; 2] = [Joint::LeftHip, Joint::RightHip];
const KNEES: [Joint; 2] = [Joint::LeftKnee, Joint::RightKnee];
const ANKLES: [Joint; 2] = [Joint::LeftAnkle, Joint::RightAnkle];
const TOES: [Joint; 2] = [Joint::LeftFoot, Joint::RightFoot];
const SHOULDERS: [Joint; 2] = [Joint::LeftShoulder, Joint::RightShoulder];
const WRISTS: [Joint; 2] = [Joint::LeftWrist, Joint::RightWrist];

impl Measurements {
    /// Measures a motion.
    pub fn of(motion: &Motion) -> Measurements {
        let body = Trajectory::of(motion);
        let mut measured = Measurements {
            seconds: motion.seconds(),
            ..Measurements::default()
        };
        measured.travel(&body);
        measured.posture(&body);
        measured.hands(&body);
        measured.legs(&body);
        measured.flights(&body);
        measured.activity(&body);
        measured
    }

    fn travel(&mut self, body: &Trajectory) {
        let last = body.frames() - 1;
        let from_start = |frame: usize| {
            let ([x, z], [start_x, start_z]) = (body.pelvis[frame], body.pelvis[0]);
            [x - start_x, z - start_z]
        };
        let start = mean(start_frames(body).map(|frame| body.heading[frame]));
        [self.net_forward, self.net_left] = Trajectory::seen_from(start, from_start(last));
        for frame in 1..body.frames() {
            let step = body.step(frame);
            let [forward, left] = Trajectory::seen_from(body.heading[frame], step);
            self.advance += forward;
            self.sidle += left;
            self.path += step[0].hypot(step[1]);
        }
        let spreads = (0..body.frames()).map(|frame| {
            let [x, z] = from_start(frame);
            x.hypot(z)
        });
        self.spread = most(spreads);
        let speed = |frame: usize| {
            let [x, z] = body.step(frame);
            x.hypot(z) * FRAMES_PER_SECOND
        };
        let speeds: Vec<f32> = (1..body.frames()).map(speed).collect();
        let window = limits::END_FRAMES.min(speeds.len());
        self.speed_high = quantile(speeds.iter().copied(), 0.8);
        self.speed_median = quantile(speeds.iter().copied(), 0.5);
        self.speed_start = mean(speeds[..window].iter().copied());
        self.speed_end = mean(speeds[speeds.len() - window..].iter().copied());
        let end = mean(end_frames(body).map(|frame| body.heading[frame]));
        self.turn = (end - start).to_degrees();
        self.turn_either = self.turn.abs();
        self.forward_speed = self.advance / self.seconds;
        self.left_speed = self.sidle / self.seconds;
        let ways = (self.sidle.abs() + self.advance.abs()).max(f32::EPSILON);
        self.sideways_share = self.sidle.abs() / ways;
    }

    fn posture(&mut self, body: &Trajectory) {
        let stances = (0..body.frames()).map(|frame| body.stance(frame));
        let stances: Vec<f32> = stances.collect();
        let pelvis = |frame: usize| body.place(frame, Joint::Pelvis)[1];
        let start = mean(start_frames(body).map(pelvis));
        self.rise = mean(end_frames(body).map(pelvis)) - start;
        self.climb = most((0..body.frames()).map(pelvis)) - start;
        self.stance_start = mean(start_frames(body).map(|frame| stances[frame]));
        self.stance_end = mean(end_frames(body).map(|frame| stances[frame]));
        self.stance_low = least(stances.iter().copied());
        self.stance_high = most(stances.iter().copied());
        self.stance_median = quantile(stances.iter().copied(), 0.5);
        self.squats = dips(&stances) as f32;
        let inclinations = (0..body.frames()).map(|frame| body.inclination(frame));
        let inclinations: Vec<f32> = inclinations.collect();
        self.inclination_start = mean(start_frames(body).map(|frame| inclinations[frame]));
        self.inclination_end = mean(end_frames(body).map(|frame| inclinations[frame]));
        self.inclination_high = most(inclinations.iter().copied());
        self.inclination_median = quantile(inclinations.iter().copied(), 0.5);
        let kneels = |frame: usize| {
            let knee = KNEES.map(|knee| body.height(frame, knee));
            let down = knee[0].min(knee[1]) < limits::KNEE_DOWN;
            down && inclinations[frame] < limits::TRUNK_UP
        };
        self.kneeling = share((0..body.frames()).map(kneels));
        let knees = (0..body.frames()).flat_map(|frame| KNEES.map(|knee| body.height(frame, knee)));
        self.knee_low = least(knees);
    }

    fn hands(&mut self, body: &Trajectory) {
        let frames = 0..body.frames();
        let over = |side: usize, level: [Joint; 2]| {
            move |frame: usize| body.height(frame, WRISTS[side]) - body.height(frame, level[side])
        };
        let lower = |level: [Joint; 2]| {
            move |frame: usize| over(0, level)(frame).min(over(1, level)(frame))
        };
        let head = [Joint::Head; 2];
        self.hand_over_shoulder = SIDES.map(|side| most(frames.clone().map(over(side, SHOULDERS))));
        self.hands_over_shoulders = most(frames.clone().map(lower(SHOULDERS)));
        self.hand_over_head = SIDES.map(|side| most(frames.clone().map(over(side, head))));
        self.hands_over_head = most(frames.clone().map(lower(head)));
        let heights = SIDES.map(|side| {
            let heights = frames.clone().map(|frame| body.height(frame, WRISTS[side]));
            heights.collect::<Vec<f32>>()
        });
        self.hand_low = least(heights.iter().flatten().copied());
        self.hand_dip = most(heights.iter().map(|heights| dip(heights)));
        self.hand_speed = SIDES
            .map(|side| most((1..body.frames()).map(|frame| body.limb_speed(frame, WRISTS[side]))));
        self.hand_to_head = SIDES.map(|side| {
            least(frames.clone().map(|frame| {
                let [hand, head] =
                    [WRISTS[side], Joint::Head].map(|joint| body.place(frame, joint));
                length(difference(hand, head))
            }))
        });
        self.hand_thrust = SIDES.map(|side| {
            let reaches = frames.clone().map(|frame| {
                let [hand, shoulder] = [WRISTS[side], SHOULDERS[side]];
                length(difference(
                    body.place(frame, hand),
                    body.place(frame, shoulder),
                ))
            });
            thrust(&reaches.collect::<Vec<f32>>())
        });
        self.thrust_lead = leads(self.hand_thrust);
    }

    fn legs(&mut self, body: &Trajectory) {
        let frames = 0..body.frames();
        let other = |side: usize| 1 - side;
        let lift = |side: usize, frame: usize| {
            body.height(frame, ANKLES[side]) - body.height(frame, ANKLES[other(side)])
        };
        let reach = |side: usize, frame: usize| {
            let [hip, ankle] = [HIPS[side], ANKLES[side]];
            length(difference(body.place(frame, hip), body.place(frame, ankle)))
        };
        self.one_leg = SIDES.map(|side| {
            let lifted = frames.clone();
            let lifted = lifted.map(|frame| lift(other(side), frame) > limits::FOOT_LIFTED);
            longest(lifted) as f32 / FRAMES_PER_SECOND
        });
        self.kick_height = SIDES.map(|side| {
            let stretched = frames
                .clone()
                .filter(|&frame| reach(side, frame) > limits::LEG_STRETCHED * body.leg);
            most(stretched.map(|frame| lift(side, frame))).max(0.0)
        });
        self.kick_lead = leads(self.kick_height);
        self.foot_speed = SIDES
            .map(|side| most((1..body.frames()).map(|frame| body.limb_speed(frame, ANKLES[side]))));
        let raised = SIDES.map(|side| {
            let levels = frames.clone().map(|frame| {
                let stands = reach(other(side), frame) > limits::LEG_STRETCHED * body.leg;
                match stands {
                    true => body.height(frame, KNEES[side]) - body.height(frame, HIPS[side]),
                    false => -body.leg,
                }
            });
            levels.collect::<Vec<f32>>()
        });
        self.knee_over_hip = SIDES.map(|side| most(raised[side].iter().copied()));
        let apart = |frame: usize| {
            let [x, _, z] = difference(body.place(frame, ANKLES[0]), body.place(frame, ANKLES[1]));
            x.hypot(z)
        };
        self.feet_apart = most(frames.clone().map(apart));
        let stances = frames.clone().map(|frame| body.stance(frame));
        let lowest = stances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let lowest = lowest.map_or(0, |(frame, _)| frame);
        self.feet_apart_low = apart(lowest);
        let ahead = ANKLES.map(|ankle| body.before_pelvis(lowest, ankle)[0]);
        self.foot_ahead = [ahead[0] - ahead[1], ahead[1] - ahead[0]];
        self.knee_bent = SIDES.map(|side| {
            let at = |joint: Joint| body.place(lowest, joint);
            let thigh = difference(at(KNEES[side]), at(HIPS[side]));
            let shank = difference(at(ANKLES[side]), at(KNEES[side]));
            let along: f32 = thigh.iter().zip(shank).map(|(a, b)| a * b).sum();
            let lengths = (length(thigh) * length(shank)).max(f32::EPSILON);
            (along / lengths).clamp(-1.0, 1.0).acos().to_degrees()
        });
        self.knee_bent_lead = leads(self.knee_bent);
        let higher = frames.map(|frame| lift(0, frame));
        let [up, down] = [limits::STEP_HEIGHT, -limits::STEP_HEIGHT];
        let higher: Vec<f32> = higher.collect();
        let lower: Vec<f32> = higher.iter().map(|lift| -lift).collect();
        self.steps = (crossings(&higher, up, down) + crossings(&lower, up, down)) as f32;
    }

    fn flights(&mut self, body: &Trajectory) {
        let frames = 0..body.frames();
        let foot = |frame: usize, side: usize| {
            // An ankle is higher than toes that stand beside it.
            let toes = body.height(frame, TOES[side]);
            toes.min(body.height(frame, ANKLES[side]) - limits::ANKLE_OVER_TOES)
        };
        let lower = frames
            .clone()
            .map(|frame| foot(frame, 0).min(foot(frame, 1)));
        let lower: Vec<f32> = lower.collect();
        let standing = quantile(lower.iter().copied(), limits::FEET_STAND_QUANTILE);
        let lower: Vec<f32> = lower.iter().map(|height| height - standing).collect();
        let pelvis = frames
            .clone()
            .map(|frame| body.height(frame, Joint::Pelvis));
        let pelvis: Vec<f32> = pelvis.collect();
        let usual = quantile(pelvis.iter().copied(), 0.5);
        let flies = |frame: &usize| lower[*frame] > limits::FLIGHT_HEIGHT;
        let runs = runs(frames.clone().map(|frame| flies(&frame)));
        let flights = runs
            .iter()
            .filter(|frames| **frames >= limits::FLIGHT_FRAMES);
        self.flights = flights.count() as f32;
        self.flight = runs.iter().max().copied().unwrap_or(0) as f32 / FRAMES_PER_SECOND;
        self.flight_height = most(lower.iter().copied());
        let rises = frames.filter(flies).map(|frame| pelvis[frame] - usual);
        self.flight_rise = most(rises).max(0.0);
    }

    fn activity(&mut self, body: &Trajectory) {
        let frames = 1..body.frames();
        let speeds = frames.clone().flat_map(|frame| {
            let joints = Joint::ALL.into_iter().skip(1);
            joints.map(move |joint| body.limb_speed(frame, joint))
        });
        self.liveliness = mean(speeds);
        let fastest = frames.map(|frame| {
            let joints = Joint::ALL.into_iter();
            most(joints.map(|joint| body.speed(frame, joint)))
        });
        self.bustle = quantile(fastest, 0.9);
    }
}

/// The first frames, over which a start is averaged.
fn start_frames(body: &Trajectory) -> std::ops::Range<usize> {
    0..limits::EDGE_FRAMES.min(body.frames())
}

/// The last frames, over which an end is averaged.
fn end_frames(body: &Trajectory) -> std::ops::Range<usize> {
    body.frames().saturating_sub(limits::EDGE_FRAMES)..body.frames()
}

/// The mean; 0 of none.
fn mean(values: impl Iterator<Item = f32>) -> f32 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / count.max(1) as f32
}

/// The share that is true; 0 of none.
fn share(values: impl Iterator<Item = bool>) -> f32 {
    mean(values.map(f32::from))
}

/// The greatest value; the least number there is of none.
fn most(values: impl Iterator<Item = f32>) -> f32 {
    values.fold(f32::MIN, f32::max)
}

fn least(values: impl Iterator<Item = f32>) -> f32 {
    values.fold(f32::MAX, f32::min)
}

/// How much larger the value of each side is than that of the other.
fn leads([left, right]: [f32; 2]) -> [f32; 2] {
    [left - right, right - left]
}

/// How many frames every unbroken stretch of true has.
fn runs(values: impl Iterator<Item = bool>) -> Vec<usize> {
    let (mut runs, mut was) = (Vec::new(), false);
    for value in values {
        match (was, value) {
            (false, true) => runs.push(1),
            (true, true) => *runs.last_mut().expect("a stretch has begun") += 1,
            (_, false) => {}
        }
        was = value;
    }
    runs
}

/// How many frames the longest unbroken stretch of true has.
fn longest(values: impl Iterator<Item = bool>) -> usize {
    runs(values).into_iter().max().unwrap_or(0)
}

/// How often values rise above a level, having been below a lower one since the last time.
fn crossings(values: &[f32], up: f32, down: f32) -> usize {
    let (mut count, mut is_up) = (0, false);
    for value in values {
        if !is_up && *value > up {
            (is_up, count) = (true, count + 1);
        }
        is_up &= *value > down;
    }
    count
}

/// How often a stance goes down and comes up again; a motion may begin or end down there.
fn dips(stances: &[f32]) -> usize {
    let depths: Vec<f32> = stances.iter().map(|stance| -stance).collect();
    crossings(&depths, -limits::SQUAT_DOWN, -limits::SQUAT_UP)
}

/// How far values come down to their least, and up again after it: the lesser of both.
fn dip(values: &[f32]) -> f32 {
    let lowest = values.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
    let Some((frame, low)) = lowest else {
        return 0.0;
    };
    let [before, after] = [&values[..=frame], &values[frame..]];
    let [before, after] = [before, after].map(|part| most(part.iter().copied()) - low);
    before.min(after)
}

/// How much values grow at most within the time of a punch.
fn thrust(values: &[f32]) -> f32 {
    let windows = (0..values.len()).map(|frame| {
        let end = (frame + limits::THRUST_FRAMES).min(values.len() - 1);
        most(values[frame..=end].iter().copied()) - values[frame]
    });
    most(windows)
}
