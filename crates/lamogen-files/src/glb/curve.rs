//! What an animation's sampler says between its keyframes.

use glam::{DQuat, DVec3};
use gltf_json::animation::Interpolation;

/// What keyframes hold: translations and scales, or rotations.
pub(super) trait Value: Copy + PartialEq {
    fn linear(self, other: Self, part: f64) -> Self;
    /// The sum of values times weights, made a value again.
    fn weighted(values: [(Self, f64); 4]) -> Self;
}

impl Value for DVec3 {
    fn linear(self, other: DVec3, part: f64) -> DVec3 {
        self.lerp(other, part)
    }

    fn weighted(values: [(DVec3, f64); 4]) -> DVec3 {
        values
            .into_iter()
            .map(|(value, weight)| value * weight)
            .sum()
    }
}

impl Value for DQuat {
    fn linear(self, other: DQuat, part: f64) -> DQuat {
        self.slerp(other, part)
    }

    fn weighted(values: [(DQuat, f64); 4]) -> DQuat {
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

/// Keyframes and what lies between them.
pub(super) struct Curve<T> {
    /// Seconds, ascending, at least one.
    pub(super) times: Vec<f64>,
    /// One a time; of a cubic spline three: incoming tangent, value, outgoing tangent.
    pub(super) values: Vec<T>,
    pub(super) interpolation: Interpolation,
}

impl<T: Value> Curve<T> {
    /// The value after some seconds; before the first and after the last keyframe theirs. Keyframes nearer than
    /// `tolerance` seconds count as met.
    pub(super) fn at(&self, seconds: f64, tolerance: f64) -> T {
        let last = self.times.len() - 1;
        let key = self
            .times
            .partition_point(|&time| time <= seconds + tolerance)
            .saturating_sub(1);
        if key == last || seconds <= self.times[key] + tolerance {
            return self.key(key);
        }
        let length = self.times[key + 1] - self.times[key];
        let part = (seconds - self.times[key]) / length;
        match self.interpolation {
            Interpolation::Step => self.key(key),
            Interpolation::Linear => self.key(key).linear(self.key(key + 1), part),
            Interpolation::CubicSpline => {
                // glTF 2.0, appendix C, "Cubic spline interpolation".
                let (squared, cubed) = (part * part, part * part * part);
                T::weighted([
                    (self.key(key), 2.0 * cubed - 3.0 * squared + 1.0),
                    (
                        self.values[3 * key + 2],
                        length * (cubed - 2.0 * squared + part),
                    ),
                    (self.key(key + 1), 3.0 * squared - 2.0 * cubed),
                    (self.values[3 * (key + 1)], length * (cubed - squared)),
                ])
            }
        }
    }

    /// The value at a keyframe.
    pub(super) fn key(&self, key: usize) -> T {
        match self.interpolation {
            Interpolation::CubicSpline => self.values[3 * key + 1],
            _ => self.values[key],
        }
    }

    /// The values at all keyframes.
    pub(super) fn keys(&self) -> impl Iterator<Item = T> + '_ {
        (0..self.times.len()).map(|key| self.key(key))
    }

    /// Whether every keyframe holds the same value, and nothing bends between them.
    pub(super) fn is_constant(&self) -> bool {
        let keys = self.times.len();
        keys == 1
            || (self.interpolation != Interpolation::CubicSpline
                && self.keys().all(|value| value == self.key(0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(interpolation: Interpolation, values: &[f64]) -> Curve<DVec3> {
        Curve {
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
            assert_eq!(step.at(seconds, 0.0).x, held, "{seconds}");
            assert_eq!(line.at(seconds, 0.0).x, risen, "{seconds}");
        }
        assert_eq!(step.at(1.999, 0.01).x, 7.0);
    }

    #[test]
    fn splines_follow_their_tangents() {
        // x = t²: slopes 2, 4, 8.
        let spline = curve(
            Interpolation::CubicSpline,
            &[0.0, 1.0, 2.0, 4.0, 4.0, 4.0, 8.0, 16.0, 0.0],
        );
        for seconds in [1.0, 1.3, 2.0, 2.5, 3.9, 4.0] {
            let x = spline.at(seconds, 0.0).x;
            assert!((x - seconds * seconds).abs() < 1e-12, "{seconds}: {x}");
        }
    }

    #[test]
    fn rotations_take_the_short_way() {
        let values = vec![DQuat::from_rotation_y(0.2), -DQuat::from_rotation_y(0.4)];
        let turn = Curve {
            times: vec![0.0, 1.0],
            values,
            interpolation: Interpolation::Linear,
        };
        let half = turn.at(0.5, 0.0);
        assert!(half.angle_between(DQuat::from_rotation_y(0.3)) < 1e-7);
    }
}
