//! A motion as checks look at it: seen from its own body, smoothed where steps and strides would disturb.

use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion};

use super::limits;

/// A point or a direction: x to the left of a body that faces z, y up, in metres.
pub(super) type Point = [f32; 3];

/// A motion with what is derived frame by frame: which way the body faces, how fast it travels, where its floor is.
pub(super) struct Trajectory<'a> {
    motion: &'a Motion,
    /// The pelvis along the ground, smoothed, `[frames]` of x and z in metres.
    pub pelvis: Vec<[f32; 2]>,
    /// The heading, unwrapped, in radians, `[frames]`: 0 along z, growing to the left.
    pub heading: Vec<f32>,
    /// The height of the floor in metres.
    pub floor: f32,
    /// The length of a straight leg from hip to ankle, the mean of both, in metres.
    pub leg: f32,
}

impl<'a> Trajectory<'a> {
    pub fn of(motion: &'a Motion) -> Trajectory<'a> {
        let poses = motion.joints();
        let place = |frame: usize, joint: Joint| poses[frame][joint.index()];
        let frames = 0..motion.frames();
        let lowest = frames.clone().map(|frame| {
            let heights = poses[frame].iter().map(|joint| joint[1]);
            heights.fold(f32::INFINITY, f32::min)
        });
        let across = frames.clone().map(|frame| {
            let hips = difference(place(frame, Joint::LeftHip), place(frame, Joint::RightHip));
            let [left, right] = [Joint::LeftShoulder, Joint::RightShoulder];
            let shoulders = difference(place(frame, left), place(frame, right));
            [hips[0] + shoulders[0], hips[2] + shoulders[2]]
        });
        let across: Vec<[f32; 2]> = across.collect();
        let pelvis = frames.clone().map(|frame| {
            let [x, _, z] = place(frame, Joint::Pelvis);
            [x, z]
        });
        let pelvis: Vec<[f32; 2]> = pelvis.collect();
        let bone = |from: Joint, to: Joint| {
            let lengths = frames.clone();
            let lengths =
                lengths.map(|frame| length(difference(place(frame, from), place(frame, to))));
            quantile(lengths, 0.5)
        };
        let left = bone(Joint::LeftHip, Joint::LeftKnee) + bone(Joint::LeftKnee, Joint::LeftAnkle);
        let right =
            bone(Joint::RightHip, Joint::RightKnee) + bone(Joint::RightKnee, Joint::RightAnkle);
        Trajectory {
            pelvis: smoothed(&pelvis),
            heading: unwrapped(&smoothed(&across)),
            floor: quantile(lowest, limits::FLOOR_QUANTILE),
            leg: (left + right) / 2.0,
            motion,
        }
    }

    pub fn frames(&self) -> usize {
        self.motion.frames()
    }

    /// Where a joint is at a frame, in metres.
    pub fn place(&self, frame: usize, joint: Joint) -> Point {
        self.motion.position(frame, joint)
    }

    /// The height of a joint over the floor, in metres.
    pub fn height(&self, frame: usize, joint: Joint) -> f32 {
        self.place(frame, joint)[1] - self.floor
    }

    /// The height of the pelvis as a share of that of a standing body.
    pub fn stance(&self, frame: usize) -> f32 {
        self.height(frame, Joint::Pelvis) / (self.leg * limits::STANDING_PELVIS)
    }

    /// How far the trunk, from pelvis to neck, is inclined from the vertical, in degrees: 0 upright, 90 lying, up to 180 upside
    /// down.
    pub fn inclination(&self, frame: usize) -> f32 {
        let trunk = difference(
            self.place(frame, Joint::Neck),
            self.place(frame, Joint::Pelvis),
        );
        let across = trunk[0].hypot(trunk[2]);
        across.atan2(trunk[1]).to_degrees()
    }

    /// A direction along the ground as seen by a body of that heading: how far it goes forward, and to the left.
    pub fn seen_from(heading: f32, [x, z]: [f32; 2]) -> [f32; 2] {
        let (sine, cosine) = heading.sin_cos();
        [x * sine + z * cosine, x * cosine - z * sine]
    }

    /// The step of the pelvis along the ground that ends at a frame from 1 on, in metres.
    pub fn step(&self, frame: usize) -> [f32; 2] {
        let ([x, z], [before_x, before_z]) = (self.pelvis[frame], self.pelvis[frame - 1]);
        [x - before_x, z - before_z]
    }

    /// How fast a joint moves relative to the pelvis between a frame from 1 on and the one before, in metres a second.
    pub fn limb_speed(&self, frame: usize, joint: Joint) -> f32 {
        let relative =
            |frame| difference(self.place(frame, joint), self.place(frame, Joint::Pelvis));
        length(difference(relative(frame), relative(frame - 1))) * FRAMES_PER_SECOND
    }

    /// How fast a joint moves in the world between a frame from 1 on and the one before, in metres a second.
    pub fn speed(&self, frame: usize, joint: Joint) -> f32 {
        length(difference(
            self.place(frame, joint),
            self.place(frame - 1, joint),
        )) * FRAMES_PER_SECOND
    }

    /// How far a joint is in front of the pelvis and to the left of it at a frame, in metres.
    pub fn before_pelvis(&self, frame: usize, joint: Joint) -> [f32; 2] {
        let [x, _, z] = difference(self.place(frame, joint), self.place(frame, Joint::Pelvis));
        Trajectory::seen_from(self.heading[frame], [x, z])
    }
}

pub(super) fn difference(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

pub(super) fn length(vector: Point) -> f32 {
    vector.iter().map(|x| x * x).sum::<f32>().sqrt()
}

/// The value below which a share of the values lies; 0 of none.
pub(super) fn quantile(values: impl Iterator<Item = f32>, share: f32) -> f32 {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    match values.len() {
        0 => 0.0,
        count => values[((count - 1) as f32 * share).round() as usize],
    }
}

/// The mean over a window around each frame, which is narrower at the ends.
fn smoothed(values: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let reach = limits::SMOOTHING_FRAMES;
    let mean = |frame: usize| {
        // As far to one side as to the other, so that steady travel stays what it is.
        let reach = reach.min(frame).min(values.len() - 1 - frame);
        let window = &values[frame - reach..=frame + reach];
        let sum = |axis: usize| window.iter().map(|value| value[axis]).sum::<f32>();
        [0, 1].map(|axis| sum(axis) / window.len() as f32)
    };
    (0..values.len()).map(mean).collect()
}

/// Headings of bodies whose left is there, without jumps of a whole turn.
fn unwrapped(lefts: &[[f32; 2]]) -> Vec<f32> {
    let mut heading = 0.0_f32;
    let headings = lefts.iter().enumerate().map(|(frame, [x, z])| {
        // The left of a body that faces z is x.
        let angle = (-z).atan2(*x);
        let turn = angle - heading;
        let whole = std::f32::consts::TAU;
        heading = match frame {
            0 => angle,
            _ => heading + turn - whole * (turn / whole).round(),
        };
        heading
    });
    headings.collect()
}
