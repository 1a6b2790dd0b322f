//! The camera: projection from metres in the world to pixels in the picture.

use std::f32::consts::FRAC_PI_6;

/// The largest coordinate relative to the target of the camera, in metres. Larger ones are clamped, so that damaged
/// motions give a picture too and no number overflows.
const HORIZON: f32 = 1e4;

/// A camera with orthographic projection, so that a metre has the same size everywhere. It looks from the front left of a
/// body that faces +Z, and down a little.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Camera {
    /// Sine and cosine of the angle about the vertical axis.
    turn: (f32, f32),
    /// Sine and cosine of the angle by which the camera looks down.
    tilt: (f32, f32),
}

/// The projection of a point, in metres relative to the target of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ProjectedPoint {
    /// The distance to the right of the target.
    pub right: f32,
    /// The distance above the target.
    pub up: f32,
    /// The distance towards the camera.
    pub towards: f32,
}

impl Camera {
    /// Creates a camera that looks down by `tilt` radians.
    pub fn new(tilt: f32) -> Camera {
        Camera {
            turn: FRAC_PI_6.sin_cos(),
            tilt: tilt.sin_cos(),
        }
    }

    /// Projects a point while the camera looks at the point `target` of the ground, `[x, z]`.
    pub fn project(&self, [x, y, z]: [f32; 3], target: [f32; 2]) -> ProjectedPoint {
        let clamp = |value: f32| value.clamp(-HORIZON, HORIZON);
        let (x, y, z) = (clamp(x - target[0]), clamp(y), clamp(z - target[1]));
        let (turn_sin, turn_cos) = self.turn;
        let (tilt_sin, tilt_cos) = self.tilt;
        let forward = z * turn_cos - x * turn_sin;
        ProjectedPoint {
            right: x * turn_cos + z * turn_sin,
            up: y * tilt_cos - forward * tilt_sin,
            towards: forward * tilt_cos + y * tilt_sin,
        }
    }

    /// Moves a point of the ground, `[x, z]`, to the right in the picture and towards the camera, both in metres on the
    /// ground.
    pub fn move_target(&self, [x, z]: [f32; 2], right: f32, nearer: f32) -> [f32; 2] {
        let (sin, cos) = self.turn;
        [
            x + right * cos - nearer * sin,
            z + right * sin + nearer * cos,
        ]
    }

    /// Returns the height of a circle on the ground in the picture, relative to its width.
    pub fn foreshortening(&self) -> f32 {
        self.tilt.0
    }
}

/// A camera with its target, and the position and scale of its view in the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraView {
    pub camera: Camera,
    /// The point of the ground that the camera looks at, `[x, z]`.
    pub target: [f32; 2],
    /// The position of this point in the picture, in pixels from the left and from the top.
    pub origin: [f32; 2],
    /// Pixels per metre.
    pub scale: f32,
}

impl CameraView {
    /// Returns the position of a point in the picture in pixels, and its distance towards the camera in metres.
    pub fn project(&self, point: [f32; 3]) -> ([f32; 2], f32) {
        let projected = self.camera.project(point, self.target);
        let [x, y] = self.origin;
        (
            [
                x + projected.right * self.scale,
                y - projected.up * self.scale,
            ],
            projected.towards,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walking_forward_leads_nearer_and_to_the_right() {
        let camera = Camera::new(0.2);
        let [start, end] = [0.0, 1.0].map(|z| camera.project([0.0, 0.0, z], [0.0; 2]));
        assert!(end.right > start.right && end.towards > start.towards && end.up < start.up);
    }

    #[test]
    fn a_moved_target_is_projected_where_it_should_be() {
        let camera = Camera::new(0.0);
        let [x, z] = camera.move_target([3.0, 4.0], 0.5, -0.25);
        let projected = camera.project([x, 0.0, z], [3.0, 4.0]);
        assert!((projected.right - 0.5).abs() < 1e-5 && (projected.towards + 0.25).abs() < 1e-5);
    }

    #[test]
    fn far_away_looks_the_same_if_the_camera_is_there_too() {
        let camera = Camera::new(0.2);
        let here = camera.project([0.25, 1.5, 0.5], [0.0, 0.0]);
        assert_eq!(here, camera.project([100.25, 1.5, -99.5], [100.0, -100.0]));
    }

    #[test]
    fn every_finite_point_is_projected_to_a_finite_one() {
        let camera = Camera::new(0.2);
        let projected = camera.project([f32::MAX, f32::MIN, f32::MAX], [f32::MIN, f32::MAX]);
        assert!(
            projected.right.is_finite()
                && projected.up.is_finite()
                && projected.towards.is_finite()
        );
    }
}
