//! Keyframe curves and their interpolation.

use glam::{DQuat, DVec3};
use gltf_json::animation::Interpolation;

/// The value of a keyframe: a translation or scale, or a rotation.
pub(super) trait KeyframeValue: Copy + PartialEq {
    /// Interpolates between two values; `part` is from 0 to 1. Rotations take the shortest arc.
    fn interpolate(self, other: Self, part: f64) -> Self;
    /// Computes the sum of values times weights. The sum of rotations is normalised.
    fn weighted_sum(values: [(Self, f64); 4]) -> Self;
}

impl KeyframeValue for DVec3 {
    fn interpolate(self, other: DVec3, part: f64) -> DVec3 {
        self.lerp(other, part)
    }

    fn weighted_sum(values: [(DVec3, f64); 4]) -> DVec3 {
        values
            .into_iter()
            .map(|(value, weight)| value * weight)
            .sum()
    }
}

impl KeyframeValue for DQuat {
    fn interpolate(self, other: DQuat, part: f64) -> DQuat {
        self.slerp(other, part)
    }

    fn weighted_sum(values: [(DQuat, f64); 4]) -> DQuat {
        let values = values.map(|(value, weight)| value * weight);
        let sum = values
            .into_iter()
            .fold(DQuat::from_array([0.0; 4]), |sum, value| sum + value);
        match sum.length_squared() > 0.0 {
            true => sum.normalize(),
            false => DQuat::IDENTITY,
        }
    }
}

/// A curve of keyframes with an interpolation between them.
pub(super) struct KeyframeCurve<T> {
    /// The times of the keyframes in seconds, ascending; at least one.
    pub(super) times: Vec<f64>,
    /// One value per keyframe; for a cubic spline three: incoming tangent, value, outgoing tangent.
    pub(super) values: Vec<T>,
    pub(super) interpolation: Interpolation,
}

impl<T: KeyframeValue> KeyframeCurve<T> {
    /// Returns the value at a time. Before the first keyframe it is the value of the first one, and after the last keyframe
    /// that of the last one. At less than `tolerance` seconds from a keyframe it is the value of that keyframe.
    pub(super) fn value_at(&self, seconds: f64, tolerance: f64) -> T {
        let last = self.times.len() - 1;
        let key = self
            .times
            .partition_point(|&time| time <= seconds + tolerance)
            .saturating_sub(1);
        if key == last || seconds <= self.times[key] + tolerance {
            return self.keyframe_value(key);
        }
        let length = self.times[key + 1] - self.times[key];
        let part = (seconds - self.times[key]) / length;
        match self.interpolation {
            Interpolation::Step => self.keyframe_value(key),
            Interpolation::Linear => self
                .keyframe_value(key)
                .interpolate(self.keyframe_value(key + 1), part),
            Interpolation::CubicSpline => {
                // glTF 2.0, appendix C, "Cubic spline interpolation".
                let (squared, cubed) = (part * part, part * part * part);
                T::weighted_sum([
                    (self.keyframe_value(key), 2.0 * cubed - 3.0 * squared + 1.0),
                    (
                        self.values[3 * key + 2],
                        length * (cubed - 2.0 * squared + part),
                    ),
                    (self.keyframe_value(key + 1), 3.0 * squared - 2.0 * cubed),
                    (self.values[3 * (key + 1)], length * (cubed - squared)),
                ])
            }
        }
    }

    /// Returns the value at a keyframe.
    pub(super) fn keyframe_value(&self, key: usize) -> T {
        match self.interpolation {
            Interpolation::CubicSpline => self.values[3 * key + 1],
            _ => self.values[key],
        }
    }

    /// Returns the values at all keyframes.
    pub(super) fn keyframe_values(&self) -> impl Iterator<Item = T> + '_ {
        (0..self.times.len()).map(|key| self.keyframe_value(key))
    }

    /// Returns whether the value never changes: all keyframes are equal, and they are not those of a spline.
    pub(super) fn is_constant(&self) -> bool {
        self.times.len() == 1
            || (self.interpolation != Interpolation::CubicSpline
                && self
                    .keyframe_values()
                    .all(|value| value == self.keyframe_value(0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(interpolation: Interpolation, values: &[f64]) -> KeyframeCurve<DVec3> {
        KeyframeCurve {
            times: vec![1.0, 2.0, 4.0],
            values: values.iter().map(|&x| DVec3::splat(x)).collect(),
            interpolation,
        }
    }

    #[test]
    fn steps_hold_and_lines_rise() {
        let step = curve(Interpolation::Step, &[5.0, 7.0, 9.0]);
        let line = curve(Interpolation::Linear, &[5.0, 7.0, 9.0]);
        for (seconds, held, risen) in [
            (0.0, 5.0, 5.0),
            (1.5, 5.0, 6.0),
            (2.0, 7.0, 7.0),
            (3.0, 7.0, 8.0),
            (9.0, 9.0, 9.0),
        ] {
            assert_eq!(step.value_at(seconds, 0.0).x, held, "{seconds}");
            assert_eq!(line.value_at(seconds, 0.0).x, risen, "{seconds}");
        }
        assert_eq!(step.value_at(1.999, 0.01).x, 7.0);
    }

    #[test]
    fn splines_follow_their_tangents() {
        // x = t²: slopes 2, 4, 8.
        let spline = curve(
            Interpolation::CubicSpline,
            &[0.0, 1.0, 2.0, 4.0, 4.0, 4.0, 8.0, 16.0, 0.0],
        );
        for seconds in [1.0, 1.3, 2.0, 2.5, 3.9, 4.0] {
            let x = spline.value_at(seconds, 0.0).x;
            assert!((x - seconds * seconds).abs() < 1e-12, "{seconds}: {x}");
        }
    }

    #[test]
    fn rotations_take_the_shortest_arc() {
        let values = vec![DQuat::from_rotation_y(0.2), -DQuat::from_rotation_y(0.4)];
        let turn = KeyframeCurve {
            times: vec![0.0, 1.0],
            values,
            interpolation: Interpolation::Linear,
        };
        let half = turn.value_at(0.5, 0.0);
        assert!(half.angle_between(DQuat::from_rotation_y(0.3)) < 1e-7);
    }
}
