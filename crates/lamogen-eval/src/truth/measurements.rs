//! The measurements of a motion, which all checks use.

use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion};
use serde::Serialize;

use super::limits;
use super::trajectory::{Trajectory, difference, length, quantile};

/// The measurements of one motion that checks compare with limits. They are computed from joint positions. Lengths are
/// in metres, times in seconds, angles in degrees; pairs are for the left and the right side.
///
/// *Forward* and *left* are directions of the body itself, by which way hips and shoulders face. The *floor* is
/// estimated for each motion: the level of its lowest joints. A *stance* is the height of the pelvis as a share of a
/// standing body's.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Measurements {
    /// The length of the motion, s.
    pub seconds: f32,
    /// The distance from start to end in the direction that the body faces at the start, m.
    pub net_forward: f32,
    /// The distance from start to end to the left of the direction that the body faces at the start, m.
    pub net_left: f32,
    /// The sum of all steps forward less those backward, each in the direction that the body faces at the time, m.
    pub advance: f32,
    /// The sum of all steps to the left less those to the right, each by the direction that the body faces at the time,
    /// m.
    pub sidle: f32,
    /// The mean speed forward, `advance` divided by `seconds`, m/s.
    pub forward_speed: f32,
    /// The mean speed to the left, `sidle` divided by `seconds`, m/s.
    pub left_speed: f32,
    /// `|sidle|` as a share of `|sidle| + |advance|`, 0 to 1.
    pub sideways_share: f32,
    /// The length of the pelvis's path along the ground, m.
    pub path: f32,
    /// The greatest distance of the pelvis from its start, along the ground, m.
    pub spread: f32,
    /// The speed along the ground that four fifths of the motion are slower than, m/s.
    pub speed_high: f32,
    /// The median speed along the ground, m/s.
    pub speed_median: f32,
    /// The mean speed along the ground in the first half second, m/s.
    pub speed_start: f32,
    /// The mean speed along the ground in the last half second, m/s.
    pub speed_end: f32,
    /// The change of heading from start to end, degrees; positive to the left.
    pub turn: f32,
    /// The amount of the change of heading from start to end, to either side, degrees.
    pub turn_either: f32,
    /// The height of the pelvis at the end less that at the start, m.
    pub rise: f32,
    /// The greatest height of the pelvis less that at the start, m.
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
    /// The number of times that the pelvis goes down and comes up again.
    pub squats: f32,
    /// The inclination of the trunk at the start, degrees: 0 upright, 90 lying.
    pub inclination_start: f32,
    /// The inclination of the trunk at the end, degrees.
    pub inclination_end: f32,
    /// The greatest inclination of the trunk, degrees.
    pub inclination_high: f32,
    /// The median inclination of the trunk, degrees.
    pub inclination_median: f32,
    /// The greatest height of each hand over its shoulder, m; negative if it is always below.
    pub hand_over_shoulder: [f32; 2],
    /// The greatest height of both hands at once over their shoulders, that of the lower hand, m.
    pub hands_over_shoulders: f32,
    /// The greatest height of each hand over the head, m.
    pub hand_over_head: [f32; 2],
    /// The greatest height of both hands at once over the head, that of the lower hand, m.
    pub hands_over_head: f32,
    /// The least height of a hand over the floor, that of the lower hand, m.
    pub hand_low: f32,
    /// The distance that a hand comes down to its lowest point, or comes up again after it, whichever is less, m. The
    /// larger value of both hands counts.
    pub hand_dip: f32,
    /// The greatest speed of each hand relative to the pelvis, m/s.
    pub hand_speed: [f32; 2],
    /// The least distance of each hand from the head, m.
    pub hand_to_head: [f32; 2],
    /// The greatest growth of the distance between each hand and its shoulder within a short time, m.
    pub hand_thrust: [f32; 2],
    /// The `hand_thrust` of each hand less that of the other hand, m.
    pub thrust_lead: [f32; 2],
    /// The greatest height of each foot over the other while its leg is stretched, m.
    pub kick_height: [f32; 2],
    /// The `kick_height` of each foot less that of the other foot, m.
    pub kick_lead: [f32; 2],
    /// The longest time that the body stands on each leg, with the other foot lifted, s.
    pub one_leg: [f32; 2],
    /// The greatest speed of each foot relative to the pelvis, m/s.
    pub foot_speed: [f32; 2],
    /// The greatest height of each knee over its hip while the other leg is stretched, m; negative if it is always below.
    pub knee_over_hip: [f32; 2],
    /// The distance of each ankle in front of the other at the time when the pelvis is lowest, m.
    pub foot_ahead: [f32; 2],
    /// The angle by which each knee is bent at the time when the pelvis is lowest, degrees; 0 is a straight leg.
    pub knee_bent: [f32; 2],
    /// The `knee_bent` of each knee less that of the other knee, degrees.
    pub knee_bent_lead: [f32; 2],
    /// The greatest distance of the ankles along the ground, m.
    pub feet_apart: f32,
    /// The distance of the ankles along the ground at the time when the pelvis is lowest, m.
    pub feet_apart_low: f32,
    /// The number of times that both feet leave the floor.
    pub flights: f32,
    /// The longest time that both feet are off the floor, s.
    pub flight: f32,
    /// The greatest height of the lower foot over its height when it stands, m.
    pub flight_height: f32,
    /// The greatest height of the pelvis while both feet are off the floor, less its median height, m.
    pub flight_rise: f32,
    /// The least height of a knee over the floor, m.
    pub knee_low: f32,
    /// The share of the motion in which a knee is on the floor and the trunk is up, 0 to 1.
    pub kneeling: f32,
    /// The number of times that a foot is lifted above the other one.
    pub steps: f32,
    /// The mean speed of all joints relative to the pelvis, m/s.
    pub liveliness: f32,
    /// The speed of the fastest joint, its 90 % quantile over frames, m/s.
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

    /// Measures how the body travels and turns.
    fn travel(&mut self, body: &Trajectory) {
        let last = body.frames() - 1;
        let from_start = |frame: usize| {
            let ([x, z], [start_x, start_z]) = (body.pelvis[frame], body.pelvis[0]);
            [x - start_x, z - start_z]
        };
        let start = mean(start_frames(body).map(|frame| body.heading[frame]));
        [self.net_forward, self.net_left] = Trajectory::to_body_axes(start, from_start(last));
        for frame in 1..body.frames() {
            let step = body.step(frame);
            let [forward, left] = Trajectory::to_body_axes(body.heading[frame], step);
            self.advance += forward;
            self.sidle += left;
            self.path += step[0].hypot(step[1]);
        }
        let spreads = (0..body.frames()).map(|frame| {
            let [x, z] = from_start(frame);
            x.hypot(z)
        });
        self.spread = largest(spreads);
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
        let total = (self.sidle.abs() + self.advance.abs()).max(f32::EPSILON);
        self.sideways_share = self.sidle.abs() / total;
    }

    /// Measures the heights of pelvis and knees, and the inclination of the trunk.
    fn posture(&mut self, body: &Trajectory) {
        let stances = (0..body.frames()).map(|frame| body.stance(frame));
        let stances: Vec<f32> = stances.collect();
        let pelvis = |frame: usize| body.position(frame, Joint::Pelvis)[1];
        let start = mean(start_frames(body).map(pelvis));
        self.rise = mean(end_frames(body).map(pelvis)) - start;
        self.climb = largest((0..body.frames()).map(pelvis)) - start;
        self.stance_start = mean(start_frames(body).map(|frame| stances[frame]));
        self.stance_end = mean(end_frames(body).map(|frame| stances[frame]));
        self.stance_low = smallest(stances.iter().copied());
        self.stance_high = largest(stances.iter().copied());
        self.stance_median = quantile(stances.iter().copied(), 0.5);
        self.squats = count_squats(&stances) as f32;
        let inclinations = (0..body.frames()).map(|frame| body.inclination(frame));
        let inclinations: Vec<f32> = inclinations.collect();
        self.inclination_start = mean(start_frames(body).map(|frame| inclinations[frame]));
        self.inclination_end = mean(end_frames(body).map(|frame| inclinations[frame]));
        self.inclination_high = largest(inclinations.iter().copied());
        self.inclination_median = quantile(inclinations.iter().copied(), 0.5);
        let kneels = |frame: usize| {
            let knee = KNEES.map(|knee| body.height(frame, knee));
            let down = knee[0].min(knee[1]) < limits::KNEE_DOWN;
            down && inclinations[frame] < limits::TRUNK_UP
        };
        self.kneeling = share((0..body.frames()).map(kneels));
        let knees = (0..body.frames()).flat_map(|frame| KNEES.map(|knee| body.height(frame, knee)));
        self.knee_low = smallest(knees);
    }

    /// Measures the hands.
    fn hands(&mut self, body: &Trajectory) {
        let frames = 0..body.frames();
        let over = |side: usize, level: [Joint; 2]| {
            move |frame: usize| body.height(frame, WRISTS[side]) - body.height(frame, level[side])
        };
        let lower = |level: [Joint; 2]| {
            move |frame: usize| over(0, level)(frame).min(over(1, level)(frame))
        };
        let head = [Joint::Head; 2];
        self.hand_over_shoulder =
            SIDES.map(|side| largest(frames.clone().map(over(side, SHOULDERS))));
        self.hands_over_shoulders = largest(frames.clone().map(lower(SHOULDERS)));
        self.hand_over_head = SIDES.map(|side| largest(frames.clone().map(over(side, head))));
        self.hands_over_head = largest(frames.clone().map(lower(head)));
        let heights = SIDES.map(|side| {
            let heights = frames.clone().map(|frame| body.height(frame, WRISTS[side]));
            heights.collect::<Vec<f32>>()
        });
        self.hand_low = smallest(heights.iter().flatten().copied());
        self.hand_dip = largest(heights.iter().map(|heights| dip_depth(heights)));
        self.hand_speed = SIDES.map(|side| {
            largest((1..body.frames()).map(|frame| body.limb_speed(frame, WRISTS[side])))
        });
        self.hand_to_head = SIDES.map(|side| {
            smallest(frames.clone().map(|frame| {
                let [hand, head] =
                    [WRISTS[side], Joint::Head].map(|joint| body.position(frame, joint));
                length(difference(hand, head))
            }))
        });
        self.hand_thrust = SIDES.map(|side| {
            let reaches = frames.clone().map(|frame| {
                let [hand, shoulder] = [WRISTS[side], SHOULDERS[side]];
                length(difference(
                    body.position(frame, hand),
                    body.position(frame, shoulder),
                ))
            });
            largest_growth(&reaches.collect::<Vec<f32>>())
        });
        self.thrust_lead = differences(self.hand_thrust);
    }

    /// Measures feet and knees.
    fn legs(&mut self, body: &Trajectory) {
        let frames = 0..body.frames();
        let other = |side: usize| 1 - side;
        let lift = |side: usize, frame: usize| {
            body.height(frame, ANKLES[side]) - body.height(frame, ANKLES[other(side)])
        };
        let reach = |side: usize, frame: usize| {
            let [hip, ankle] = [HIPS[side], ANKLES[side]];
            length(difference(
                body.position(frame, hip),
                body.position(frame, ankle),
            ))
        };
        self.one_leg = SIDES.map(|side| {
            let lifted = frames.clone();
            let lifted = lifted.map(|frame| lift(other(side), frame) > limits::FOOT_LIFTED);
            longest_run(lifted) as f32 / FRAMES_PER_SECOND
        });
        self.kick_height = SIDES.map(|side| {
            let stretched = frames
                .clone()
                .filter(|&frame| reach(side, frame) > limits::LEG_STRETCHED * body.leg);
            largest(stretched.map(|frame| lift(side, frame))).max(0.0)
        });
        self.kick_lead = differences(self.kick_height);
        self.foot_speed = SIDES.map(|side| {
            largest((1..body.frames()).map(|frame| body.limb_speed(frame, ANKLES[side])))
        });
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
        self.knee_over_hip = SIDES.map(|side| largest(raised[side].iter().copied()));
        let apart = |frame: usize| {
            let [x, _, z] = difference(
                body.position(frame, ANKLES[0]),
                body.position(frame, ANKLES[1]),
            );
            x.hypot(z)
        };
        self.feet_apart = largest(frames.clone().map(apart));
        let stances = frames.clone().map(|frame| body.stance(frame));
        let lowest = stances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let lowest = lowest.map_or(0, |(frame, _)| frame);
        self.feet_apart_low = apart(lowest);
        let ahead = ANKLES.map(|ankle| body.offset_from_pelvis(lowest, ankle)[0]);
        self.foot_ahead = [ahead[0] - ahead[1], ahead[1] - ahead[0]];
        self.knee_bent = SIDES.map(|side| {
            let at = |joint: Joint| body.position(lowest, joint);
            let thigh = difference(at(KNEES[side]), at(HIPS[side]));
            let shank = difference(at(ANKLES[side]), at(KNEES[side]));
            let along: f32 = thigh.iter().zip(shank).map(|(a, b)| a * b).sum();
            let lengths = (length(thigh) * length(shank)).max(f32::EPSILON);
            (along / lengths).clamp(-1.0, 1.0).acos().to_degrees()
        });
        self.knee_bent_lead = differences(self.knee_bent);
        let higher = frames.map(|frame| lift(0, frame));
        let [up, down] = [limits::STEP_HEIGHT, -limits::STEP_HEIGHT];
        let higher: Vec<f32> = higher.collect();
        let lower: Vec<f32> = higher.iter().map(|lift| -lift).collect();
        self.steps = (count_rises(&higher, up, down) + count_rises(&lower, up, down)) as f32;
    }

    /// Measures when and how high both feet leave the floor.
    fn flights(&mut self, body: &Trajectory) {
        let frames = 0..body.frames();
        let foot = |frame: usize, side: usize| {
            // When a foot is on the floor, its ankle is higher than its toes.
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
        let median_height = quantile(pelvis.iter().copied(), 0.5);
        let is_airborne = |frame: &usize| lower[*frame] > limits::FLIGHT_HEIGHT;
        let runs = run_lengths(frames.clone().map(|frame| is_airborne(&frame)));
        let flights = runs
            .iter()
            .filter(|frames| **frames >= limits::FLIGHT_FRAMES);
        self.flights = flights.count() as f32;
        self.flight = runs.iter().max().copied().unwrap_or(0) as f32 / FRAMES_PER_SECOND;
        self.flight_height = largest(lower.iter().copied());
        let rises = frames
            .filter(is_airborne)
            .map(|frame| pelvis[frame] - median_height);
        self.flight_rise = largest(rises).max(0.0);
    }

    /// Measures how fast the joints move.
    fn activity(&mut self, body: &Trajectory) {
        let frames = 1..body.frames();
        let speeds = frames.clone().flat_map(|frame| {
            let joints = Joint::ALL.into_iter().skip(1);
            joints.map(move |joint| body.limb_speed(frame, joint))
        });
        self.liveliness = mean(speeds);
        let fastest = frames.map(|frame| {
            let joints = Joint::ALL.into_iter();
            largest(joints.map(|joint| body.speed(frame, joint)))
        });
        self.bustle = quantile(fastest, 0.9);
    }
}

/// Returns the first frames, over which quantities at the start are averaged.
fn start_frames(body: &Trajectory) -> std::ops::Range<usize> {
    0..limits::EDGE_FRAMES.min(body.frames())
}

/// Returns the last frames, over which quantities at the end are averaged.
fn end_frames(body: &Trajectory) -> std::ops::Range<usize> {
    body.frames().saturating_sub(limits::EDGE_FRAMES)..body.frames()
}

/// Returns the mean; 0 if there are no values.
fn mean(values: impl Iterator<Item = f32>) -> f32 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / count.max(1) as f32
}

/// Returns the share of values that are true; 0 if there are no values.
fn share(values: impl Iterator<Item = bool>) -> f32 {
    mean(values.map(f32::from))
}

/// Returns the largest value; `f32::MIN` if there are no values.
fn largest(values: impl Iterator<Item = f32>) -> f32 {
    values.fold(f32::MIN, f32::max)
}

/// Returns the smallest value; `f32::MAX` if there are no values.
fn smallest(values: impl Iterator<Item = f32>) -> f32 {
    values.fold(f32::MAX, f32::min)
}

/// Returns the value of each side less that of the other side.
fn differences([left, right]: [f32; 2]) -> [f32; 2] {
    [left - right, right - left]
}

/// Returns the length of every run of consecutive true values.
fn run_lengths(values: impl Iterator<Item = bool>) -> Vec<usize> {
    let (mut runs, mut previous) = (Vec::new(), false);
    for value in values {
        match (previous, value) {
            (false, true) => runs.push(1),
            (true, true) => *runs.last_mut().expect("a run has begun") += 1,
            (_, false) => {}
        }
        previous = value;
    }
    runs
}

/// Returns the length of the longest run of consecutive true values.
fn longest_run(values: impl Iterator<Item = bool>) -> usize {
    run_lengths(values).into_iter().max().unwrap_or(0)
}

/// Counts how often values rise above the level `up`. A rise counts only if the values have been at or below the lower
/// level `down` since the last one.
fn count_rises(values: &[f32], up: f32, down: f32) -> usize {
    let (mut count, mut is_up) = (0, false);
    for value in values {
        if !is_up && *value > up {
            (is_up, count) = (true, count + 1);
        }
        is_up &= *value > down;
    }
    count
}

/// Counts how often a stance goes down and comes up again. A motion may also begin or end low.
fn count_squats(stances: &[f32]) -> usize {
    let depths: Vec<f32> = stances.iter().map(|stance| -stance).collect();
    count_rises(&depths, -limits::SQUAT_DOWN, -limits::SQUAT_UP)
}

/// Returns how far values come down to their minimum, or come up again after it, whichever is less.
fn dip_depth(values: &[f32]) -> f32 {
    let lowest = values.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
    let Some((frame, low)) = lowest else {
        return 0.0;
    };
    let parts = [&values[..=frame], &values[frame..]];
    let [fall, rise] = parts.map(|part| largest(part.iter().copied()) - low);
    fall.min(rise)
}

/// Returns how much values grow at most within the time of a punch.
fn largest_growth(values: &[f32]) -> f32 {
    let windows = (0..values.len()).map(|frame| {
        let end = (frame + limits::THRUST_FRAMES).min(values.len() - 1);
        largest(values[frame..=end].iter().copied()) - values[frame]
    });
    largest(windows)
}
