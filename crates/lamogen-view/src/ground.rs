//! The grid on the ground below an animated figure.

use std::fmt::Write;

use svg::node::element::Path;

use crate::camera::CameraView;

/// The side of a square of the grid, in metres.
const SQUARE: f32 = 0.5;
/// The most squares from the middle of the ground to its edge. On a very large ground the squares are larger.
const MAX_SQUARES: f32 = 20.0;

/// Draws the lines of the grid within a circle of `radius` metres around the target of the camera. The lines are fixed in
/// the world, so they move through the picture when the camera moves.
pub(crate) fn ground_grid(view: &CameraView, radius: f32) -> Path {
    let mut path = String::new();
    let square = SQUARE * (radius / SQUARE / MAX_SQUARES).max(1.0).ceil();
    // Lines run along z at x = k · square, and along x at z = k · square.
    for axis in [0, 1] {
        let middle = view.target[axis];
        let first = ((middle - radius) / square).ceil();
        let count = (2.0 * radius / square) as usize + 1;
        for index in 0..count {
            let at = (first + index as f32) * square;
            // Half the length of the line within the circle.
            let half = (radius.powi(2) - (at - middle).powi(2)).max(0.0).sqrt();
            let [start, end] = [-half, half].map(|along| {
                let along = view.target[1 - axis] + along;
                let [x, z] = if axis == 0 { [at, along] } else { [along, at] };
                view.project([x, 0.0, z]).0
            });
            if half > 0.0 {
                write!(
                    path,
                    "M{:.1} {:.1}L{:.1} {:.1}",
                    start[0], start[1], end[0], end[1]
                )
                .expect("writing to a string does not fail");
            }
        }
    }
    Path::new()
        .set("d", path)
        .set("stroke", "#dadde3")
        .set("fill", "none")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    fn lines(x: f32, radius: f32) -> String {
        let view = CameraView {
            camera: Camera::new(0.3),
            target: [x, 0.0],
            origin: [0.0, 0.0],
            scale: 100.0,
        };
        ground_grid(&view, radius).to_string()
    }

    #[test]
    fn the_grid_moves_with_the_camera_and_repeats_after_a_square() {
        assert_ne!(lines(0.0, 1.2), lines(0.25, 1.2));
        assert_eq!(lines(0.0, 1.2), lines(SQUARE, 1.2));
    }

    #[test]
    fn a_huge_ground_has_no_more_lines() {
        let count = |radius| lines(0.0, radius).matches('M').count();
        assert!(count(1.0) < count(5.0) && count(9000.0) <= 2 * (2 * MAX_SQUARES as usize + 1));
    }
}
