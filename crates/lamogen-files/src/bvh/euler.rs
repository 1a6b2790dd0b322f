//! Conversion of rotations to three Euler angles without jumps from frame to frame.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat};

/// The cosine of the second angle below which the first and the third angle turn about the same axis (gimbal lock).
const POLE: f64 = 1e-7;

/// Computes the intrinsic Euler angles about Z, X and Y of a rotation `Rz · Rx · Ry`, in radians.
///
/// Of all equivalent triples of angles, the one nearest to `before`, the triple of the previous frame, is returned.
pub(super) fn zxy_angles(rotation: DQuat, before: [f64; 3]) -> [f64; 3] {
    euler_angles([2, 0, 1], rotation, before)
}

/// Computes the intrinsic Euler angles of a rotation about three different axes in the given order, in radians.
///
/// Of all equivalent triples of angles, the one nearest to `before`, the triple of the previous frame, is returned.
///
/// # Panics
///
/// If an axis is not 0, 1 or 2.
pub(super) fn euler_angles(axes: [usize; 3], rotation: DQuat, before: [f64; 3]) -> [f64; 3] {
    let [first, second, third] = axes;
    // With axes in the other direction around, all angles have the other sign.
    let sign = match (first + 1) % 3 == second {
        true => 1.0,
        false => -1.0,
    };
    let matrix = DMat3::from_quat(rotation);
    let at = |row: usize, column: usize| matrix.col(column)[row];
    let cyclic = cyclic_angles(
        |row, column| at([first, second, third][row], [first, second, third][column]),
        before.map(|angle| sign * angle),
    );
    cyclic.map(|angle| sign * angle)
}

/// Computes Euler angles as [`euler_angles`], for axes of which each is followed by the next one of X, Y, Z, X. `at` gives the
/// entries of the rotation's matrix, with rows and columns in the order of the axes.
fn cyclic_angles(at: impl Fn(usize, usize) -> f64, before: [f64; 3]) -> [f64; 3] {
    let cosine = at(0, 1).hypot(at(0, 0));
    let second = at(0, 2).atan2(cosine);
    if cosine < POLE {
        // Only first ± third is determined: each of the two angles takes half of its change.
        let sign = second.signum();
        let sum = (sign * at(1, 0)).atan2(at(1, 1));
        let change =
            nearest_equivalent(sum, before[0] + sign * before[2]) - before[0] - sign * before[2];
        let second = [second, PI - second].map(|angle| nearest_equivalent(angle, before[1]));
        let second = if distance(second[0], before[1]) <= distance(second[1], before[1]) {
            second[0]
        } else {
            second[1]
        };
        return [
            before[0] + change / 2.0,
            second,
            before[2] + sign * change / 2.0,
        ];
    }
    let first = (-at(1, 2)).atan2(at(2, 2));
    let third = (-at(0, 1)).atan2(at(0, 0));
    let candidates = [
        [first, second, third],
        [first + PI, PI - second, third + PI],
    ]
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
    use glam::DVec3;

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
    fn the_angles_about_any_three_axes_make_up_the_rotation() {
        let turn = |axis: usize, angle| DQuat::from_axis_angle(DVec3::AXES[axis], angle);
        for axes in [
            [0, 1, 2],
            [0, 2, 1],
            [1, 0, 2],
            [1, 2, 0],
            [2, 0, 1],
            [2, 1, 0],
        ] {
            let mut before = [0.0; 3];
            for step in 1..500 {
                let wave = |speed: f64| (f64::from(step) * 0.02 * speed).sin();
                let angles = [3.0 * wave(0.9), 1.5 * wave(1.3), 3.0 * wave(0.7)];
                let product = |angles: [f64; 3]| {
                    turn(axes[0], angles[0]) * turn(axes[1], angles[1]) * turn(axes[2], angles[2])
                };
                let rotation = product(angles);
                let found = euler_angles(axes, rotation, before);
                assert!(rotation.dot(product(found)).abs() > 1.0 - 1e-12);
                for (found, angle) in found.into_iter().zip(angles) {
                    assert!((found - angle).abs() < 1e-6, "{axes:?} {step}");
                }
                before = found;
            }
            for second in [PI / 2.0, -PI / 2.0] {
                let rotation = turn(axes[0], 0.4) * turn(axes[1], second) * turn(axes[2], 0.3);
                let found = euler_angles(axes, rotation, [0.3, 1.0, 0.2]);
                let again =
                    turn(axes[0], found[0]) * turn(axes[1], found[1]) * turn(axes[2], found[2]);
                assert!(rotation.dot(again).abs() > 1.0 - 1e-12, "{axes:?}");
            }
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
