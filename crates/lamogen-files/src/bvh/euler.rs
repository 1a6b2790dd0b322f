//! Conversion of rotations to three Euler angles without jumps from frame to frame.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat};

/// The cosine of the second angle below which the first and the third angle turn about the same axis (gimbal lock).
const POLE: f64 = 1e-7;

/// Computes the intrinsic Euler angles about Z, X and Y of a rotation `Rz · Rx · Ry`, in radians.
///
/// Of all equivalent triples of angles, the one nearest to `before`, the triple of the previous frame, is returned.
pub(super) fn zxy_angles(rotation: DQuat, before: [f64; 3]) -> [f64; 3] {
    let matrix = DMat3::from_quat(rotation);
    let [column_x, column_y, column_z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let cosine = column_y.x.hypot(column_y.y);
    let x = column_y.z.atan2(cosine);
    if cosine < POLE {
        // Only z ± y is determined: each of the two angles takes half of its change.
        let sign = x.signum();
        let sum = (sign * column_z.x).atan2(column_x.x);
        let change =
            nearest_equivalent(sum, before[0] + sign * before[2]) - before[0] - sign * before[2];
        let x = [x, PI - x].map(|x| nearest_equivalent(x, before[1]));
        let x = if distance(x[0], before[1]) <= distance(x[1], before[1]) {
            x[0]
        } else {
            x[1]
        };
        return [before[0] + change / 2.0, x, before[2] + sign * change / 2.0];
    }
    let z = (-column_y.x).atan2(column_y.y);
    let y = (-column_x.z).atan2(column_z.z);
    let candidates = [[z, x, y], [z + PI, PI - x, y + PI]]
        .map(|triple| std::array::from_fn(|axis| nearest_equivalent(triple[axis], before[axis])));
    let total_change = |triple: &[f64; 3]| -> f64 {
        let pairs = triple.iter().zip(before);
        pairs.map(|(angle, before)| (angle - before).abs()).sum()
    };
    let [first, second] = candidates;
    if total_change(&first) <= total_change(&second) {
        first
    } else {
        second
    }
}

/// Adds the number of full turns to an angle that brings it nearest to another angle.
fn nearest_equivalent(angle: f64, to: f64) -> f64 {
    angle + ((to - angle) / TAU).round() * TAU
}

fn distance(a: f64, b: f64) -> f64 {
    (a - b).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rotation_from([z, x, y]: [f64; 3]) -> DQuat {
        DQuat::from_rotation_z(z) * DQuat::from_rotation_x(x) * DQuat::from_rotation_y(y)
    }

    #[test]
    fn the_angles_make_up_the_rotation_also_at_the_poles() {
        let quarter = PI / 2.0;
        for step in 0..2000 {
            let wave = |speed: f64| 3.0 * (f64::from(step) * speed).sin();
            let mut angles = [wave(0.31), wave(0.17), wave(0.57)];
            if step % 4 == 0 {
                angles[1] = if step % 8 == 0 { quarter } else { -quarter };
            }
            let before = [wave(1.3), wave(2.1), wave(0.7)];
            let rotation = rotation_from(angles);
            let again = rotation_from(zxy_angles(rotation, before));
            assert!(
                rotation.dot(again).abs() > 1.0 - 1e-12,
                "{angles:?} {again}"
            );
        }
    }

    #[test]
    fn a_spin_through_both_poles_has_no_jump() {
        // Somersaults: the second angle continues past a quarter turn, and the other two do not flip.
        let mut before = [0.0; 3];
        for step in 1..=720 {
            let angle = f64::from(step).to_radians() * 2.0;
            let angles = zxy_angles(rotation_from([0.3, angle, -0.2]), before);
            for (angle, before) in angles.into_iter().zip(before) {
                assert!((angle - before).abs() < 0.4, "step {step}: {angles:?}");
            }
            before = angles;
        }
        assert!((before[1] - 4.0 * TAU).abs() < 1e-6, "{before:?}");
    }

    #[test]
    fn a_turn_about_the_vertical_continues_past_half_a_turn() {
        let mut before = [0.0; 3];
        for step in 1..=100 {
            before = zxy_angles(rotation_from([0.0, 0.0, f64::from(step) * 0.1]), before);
        }
        assert!((before[2] - 10.0).abs() < 1e-9, "{before:?}");
    }
}
