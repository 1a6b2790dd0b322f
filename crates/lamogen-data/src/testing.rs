//! Motions for tests.

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Returns the poses of a body that walks and turns while every limb swings independently.
pub(crate) fn walk(seed: u64, frames: usize) -> Vec<[[f32; 3]; JOINTS]> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let swings: Vec<(DVec3, f64, f64)> = (0..JOINTS)
        .map(|_| {
            let axis = DVec3::from_array(std::array::from_fn(|_| random.random_range(-0.5..0.5)));
            let speed = random.random_range(0.05..0.2);
            (axis, speed, random.random_range(0.0..6.0))
        })
        .collect();
    let turning = random.random_range(0.01..0.02);
    (0..frames)
        .map(|frame| {
            let time = frame as f64;
            let mut places = [DVec3::ZERO; JOINTS];
            let mut turns = [DQuat::IDENTITY; JOINTS];
            for joint in Joint::ALL {
                let (axis, speed, phase) = swings[joint.index()];
                let swing = DQuat::from_scaled_axis(axis * (time * speed + phase).sin());
                let j = joint.index();
                (places[j], turns[j]) = match joint.parent() {
                    None => {
                        let heading = DQuat::from_rotation_y(turning * time);
                        let place = DVec3::new((turning * time).sin(), 1.0, 0.02 * time);
                        (place, heading * swing)
                    }
                    Some(parent) => {
                        let p = parent.index();
                        (places[p] + turns[p] * bone(joint), turns[p] * swing)
                    }
                };
            }
            places.map(|place| place.as_vec3().to_array())
        })
        .collect()
}

/// Returns the offset of a joint from its parent in a T-pose, in metres.
fn bone(joint: Joint) -> DVec3 {
    use Joint::*;
    match joint {
        Pelvis => DVec3::ZERO,
        LeftHip => DVec3::new(0.07, -0.09, 0.0),
        RightHip => DVec3::new(-0.07, -0.09, 0.0),
        LeftKnee | RightKnee | LeftAnkle | RightAnkle => DVec3::new(0.0, -0.4, 0.0),
        LeftFoot | RightFoot => DVec3::new(0.0, -0.06, 0.12),
        Spine1 | Spine2 | Spine3 | Head => DVec3::new(0.0, 0.12, 0.0),
        Neck => DVec3::new(0.0, 0.2, 0.0),
        LeftCollar => DVec3::new(0.08, 0.1, 0.0),
        RightCollar => DVec3::new(-0.08, 0.1, 0.0),
        LeftShoulder => DVec3::new(0.1, 0.03, 0.0),
        RightShoulder => DVec3::new(-0.1, 0.03, 0.0),
        LeftElbow | LeftWrist => DVec3::new(0.26, 0.0, 0.0),
        RightElbow | RightWrist => DVec3::new(-0.26, 0.0, 0.0),
    }
}
