//! From metres to pixels.

use std::f32::consts::FRAC_PI_6;

/// What is further from the middle of the picture than this, in metres, is drawn there: broken
/// motions then give a picture too, and no number in it overflows.
const HORIZON: f32 = 1e4;

/// A camera without perspective, so that a metre is a metre everywhere. It looks from the front
/// left of a motion's first pose, and down a little.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Camera {
    turn: (f32, f32),
    tilt: (f32, f32),
}

/// A point as the camera sees it, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// To the right of the middle.
    pub right: f32,
    /// Above the ground in the middle.
    pub up: f32,
    /// Nearer to the camera than the middle.
    pub towards: f32,
}

impl Camera {
    /// A camera that looks down by `tilt` radians.
    pub fn new(tilt: f32) -> Camera {
        Camera {
            turn: FRAC_PI_6.sin_cos(),
            tilt: tilt.sin_cos(),
        }
    }

    /// How a point looks while the camera is aimed at the point `middle` of the ground, `[x, z]`.
    pub fn see(&self, [x, y, z]: [f32; 3], middle: [f32; 2]) -> Seen {
        let near = |value: f32| value.clamp(-HORIZON, HORIZON);
        let (x, y, z) = (near(x - middle[0]), near(y), near(z - middle[1]));
        let (turn_sin, turn_cos) = self.turn;
        let (tilt_sin, tilt_cos) = self.tilt;
        let forward = z * turn_cos - x * turn_sin;
        Seen {
            right: x * turn_cos + z * turn_sin,
            up: y * tilt_cos - forward * tilt_sin,
            towards: forward * tilt_cos + y * tilt_sin,
        }
    }

    /// The point of the ground that is so many metres to the right of the point `middle`, and
    /// nearer.
    pub fn beside(&self, [x, z]: [f32; 2], right: f32, nearer: f32) -> [f32; 2] {
        let (sin, cos) = self.turn;
        [
            x + right * cos - nearer * sin,
            z + right * sin + nearer * cos,
        ]
    }

    /// How high a circle on the ground looks beside its width.
    pub fn flatness(&self) -> f32 {
        self.tilt.0
    }
}

/// A camera in front of a place of the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    /// How it looks.
    pub camera: Camera,
    /// The point of the ground that it is aimed at, `[x, z]`.
    pub middle: [f32; 2],
    /// Where that point is drawn, in pixels from the left and from the top.
    pub origin: [f32; 2],
    /// Pixels a metre.
    pub scale: f32,
}

impl View {
    /// Where a point is drawn, and how near it is, in metres.
    pub fn place(&self, point: [f32; 3]) -> ([f32; 2], f32) {
        let seen = self.camera.see(point, self.middle);
        let [x, y] = self.origin;
        (
            [x + seen.right * self.scale, y - seen.up * self.scale],
            seen.towards,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_walks_forward_comes_nearer_and_to_the_right() {
        let camera = Camera::new(0.2);
        let [start, end] = [0.0, 1.0].map(|z| camera.see([0.0, 0.0, z], [0.0; 2]));
        assert!(end.right > start.right && end.towards > start.towards && end.up < start.up);
    }

    #[test]
    fn beside_is_where_it_looks_to_be() {
        let camera = Camera::new(0.0);
        let [x, z] = camera.beside([3.0, 4.0], 0.5, -0.25);
        let seen = camera.see([x, 0.0, z], [3.0, 4.0]);
        assert!((seen.right - 0.5).abs() < 1e-5 && (seen.towards + 0.25).abs() < 1e-5);
    }

    #[test]
    fn far_away_looks_the_same_if_the_camera_is_there_too() {
        let camera = Camera::new(0.2);
        let here = camera.see([0.25, 1.5, 0.5], [0.0, 0.0]);
        assert_eq!(here, camera.see([100.25, 1.5, -99.5], [100.0, -100.0]));
    }

    #[test]
    fn every_finite_number_is_seen_at_a_finite_place() {
        let camera = Camera::new(0.2);
        let seen = camera.see([f32::MAX, f32::MIN, f32::MAX], [f32::MIN, f32::MAX]);
        assert!(seen.right.is_finite() && seen.up.is_finite() && seen.towards.is_finite());
    }
}
