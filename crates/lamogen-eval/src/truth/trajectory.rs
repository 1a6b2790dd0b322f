//! The trajectory of a motion: quantities of every frame, some of them relative to the body or smoothed.

use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion};

use super::limits;

/// A point or a vector in metres: y is up, and x is to the left of a body that faces z.
pub(super) type Point = [f32; 3];

/// A motion with its smoothed path and heading, the height of its floor, and the length of its legs.
pub(super) struct Trajectory<'a> {
    motion: &'a Motion,
    /// The position of the pelvis along the ground, smoothed, `[frames]` of x and z in metres.
    pub pelvis: Vec<[f32; 2]>,
    /// The heading in radians, `[frames]`: 0 along z, positive to the left, without jumps of whole turns.
    pub heading: Vec<f32>,
    /// The height of the floor in metres.
    pub floor: f32,
    /// The length of a straight leg from hip to ankle, the mean of both legs, in metres.
    pub leg: f32,
}

impl<'a> Trajectory<'a> {
    /// Computes the trajectory of a motion.
    pub fn of(motion: &'a Motion) -> Trajectory<'a> {
        let poses = motion.joints();
        let position = |frame: usize, joint: Joint| poses[frame][joint.index()];
        let frames = 0..motion.frames();
        let lowest = frames.clone().map(|frame| {
            let heights = poses[frame].iter().map(|joint| joint[1]);
            heights.fold(f32::INFINITY, f32::min)
        });
        let across = frames.clone().map(|frame| {
            let hips = difference(
                position(frame, Joint::LeftHip),
                position(frame, Joint::RightHip),
            );
            let [left, right] = [Joint::LeftShoulder, Joint::RightShoulder];
            let shoulders = difference(position(frame, left), position(frame, right));
            [hips[0] + shoulders[0], hips[2] + shoulders[2]]
        });
        let across: Vec<[f32; 2]> = across.collect();
        let pelvis = frames.clone().map(|frame| {
            let [x, _, z] = position(frame, Joint::Pelvis);
            [x, z]
        });
        let pelvis: Vec<[f32; 2]> = pelvis.collect();
        let bone = |from: Joint, to: Joint| {
            let lengths = frames.clone();
            let lengths =
                lengths.map(|frame| length(difference(position(frame, from), position(frame, to))));
            quantile(lengths, 0.5)
        };
        let left = bone(Joint::LeftHip, Joint::LeftKnee) + bone(Joint::LeftKnee, Joint::LeftAnkle);
        let right =
            bone(Joint::RightHip, Joint::RightKnee) + bone(Joint::RightKnee, Joint::RightAnkle);
        Trajectory {
            pelvis: smooth(&pelvis),
            heading: unwrap_headings(&smooth(&across)),
            floor: quantile(lowest, limits::FLOOR_QUANTILE),
            leg: (left + right) / 2.0,
            motion,
        }
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> usize {
        self.motion.frames()
    }

    /// Returns the position of a joint at a frame, in metres.
    pub fn position(&self, frame: usize, joint: Joint) -> Point {
        self.motion.position(frame, joint)
    }

    /// Returns the height of a joint over the floor, in metres.
    pub fn height(&self, frame: usize, joint: Joint) -> f32 {
        self.position(frame, joint)[1] - self.floor
    }

    /// Returns the height of the pelvis as a share of a standing body's.
    pub fn stance(&self, frame: usize) -> f32 {
        self.height(frame, Joint::Pelvis) / (self.leg * limits::STANDING_PELVIS)
    }

    /// Returns the angle of the trunk, from pelvis to neck, to the vertical, in degrees: 0 upright, 90 lying, 180 upside
    /// down.
    pub fn inclination(&self, frame: usize) -> f32 {
        let trunk = difference(
            self.position(frame, Joint::Neck),
            self.position(frame, Joint::Pelvis),
        );
        let across = trunk[0].hypot(trunk[2]);
        across.atan2(trunk[1]).to_degrees()
    }

    /// Converts a vector along the ground to the axes of a body with a heading: forward and to the left.
    pub fn to_body_axes(heading: f32, [x, z]: [f32; 2]) -> [f32; 2] {
        let (sine, cosine) = heading.sin_cos();
        [x * sine + z * cosine, x * cosine - z * sine]
    }

    /// Returns the step of the pelvis along the ground from the previous frame to `frame`, which is at least 1, in metres.
    pub fn step(&self, frame: usize) -> [f32; 2] {
        let ([x, z], [before_x, before_z]) = (self.pelvis[frame], self.pelvis[frame - 1]);
        [x - before_x, z - before_z]
    }

    /// Returns the speed of a joint relative to the pelvis from the previous frame to `frame`, which is at least 1, in
    /// metres per second.
    pub fn limb_speed(&self, frame: usize, joint: Joint) -> f32 {
        let relative = |frame| {
            difference(
                self.position(frame, joint),
                self.position(frame, Joint::Pelvis),
            )
        };
        length(difference(relative(frame), relative(frame - 1))) * FRAMES_PER_SECOND
    }

    /// Returns the speed of a joint in the world from the previous frame to `frame`, which is at least 1, in metres per
    /// second.
    pub fn speed(&self, frame: usize, joint: Joint) -> f32 {
        length(difference(
            self.position(frame, joint),
            self.position(frame - 1, joint),
        )) * FRAMES_PER_SECOND
    }

    /// Returns the distances of a joint in front of the pelvis and to the left of the pelvis at a frame, in metres.
    pub fn offset_from_pelvis(&self, frame: usize, joint: Joint) -> [f32; 2] {
        let [x, _, z] = difference(
            self.position(frame, joint),
            self.position(frame, Joint::Pelvis),
        );
        Trajectory::to_body_axes(self.heading[frame], [x, z])
    }
}

pub(super) fn difference(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

pub(super) fn length(vector: Point) -> f32 {
    vector.iter().map(|x| x * x).sum::<f32>().sqrt()
}

/// Returns the value below which a share of the values lies; 0 if there are no values.
pub(super) fn quantile(values: impl Iterator<Item = f32>, share: f32) -> f32 {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    match values.len() {
        0 => 0.0,
        count => values[((count - 1) as f32 * share).round() as usize],
    }
}

/// Returns the mean over a window around each frame. The window is narrower at the ends.
fn smooth(values: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let mean = |frame: usize| {
        // Both sides of the window are equally long, so that steady travel is not changed.
        let reach = limits::SMOOTHING_FRAMES;
        let reach = reach.min(frame).min(values.len() - 1 - frame);
        let window = &values[frame - reach..=frame + reach];
        let sum = |axis: usize| window.iter().map(|value| value[axis]).sum::<f32>();
        [0, 1].map(|axis| sum(axis) / window.len() as f32)
    };
    (0..values.len()).map(mean).collect()
}

/// Returns the headings of a body from the directions of its left side, without jumps of whole turns.
fn unwrap_headings(lefts: &[[f32; 2]]) -> Vec<f32> {
    let mut heading = 0.0_f32;
    let headings = lefts.iter().enumerate().map(|(frame, [x, z])| {
        // The left of a body that faces z is x.
        let angle = (-z).atan2(*x);
        let turn = angle - heading;
        let whole_turn = std::f32::consts::TAU;
        heading = match frame {
            0 => angle,
            _ => heading + turn - whole_turn * (turn / whole_turn).round(),
        };
        heading
    });
    headings.collect()
}
