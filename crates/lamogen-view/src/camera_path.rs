//! The path of the camera that follows a motion.

use lamogen_laban::GaussianKernel;
use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion};

/// The distance of the pelvis from the target of the camera beyond which the camera follows, in metres.
const DEAD_ZONE: f32 = 0.3;
/// The standard deviation of the Gaussian that smooths the path of the camera, in seconds.
const SMOOTHING: f32 = 0.4;

/// Returns the point of the ground, `[x, z]`, that the camera looks at in every frame. It stands still for a jump or a
/// wave of a hand, and follows a walk smoothly.
pub(crate) fn camera_path(motion: &Motion) -> Vec<[f32; 2]> {
    smooth(&follow_pelvis(motion))
}

/// Returns a path that stays still while the pelvis is in the dead zone around it, and otherwise follows the pelvis at the
/// radius of the dead zone.
fn follow_pelvis(motion: &Motion) -> Vec<[f32; 2]> {
    let pelvis = |frame: usize| {
        let [x, _, z] = motion.position(frame, Joint::Pelvis);
        [x, z]
    };
    let mut at = pelvis(0);
    (0..motion.frames())
        .map(|frame| {
            let [x, z] = pelvis(frame);
            let (dx, dz) = (x - at[0], z - at[1]);
            let distance = dx.hypot(dz);
            // A distance that is not finite is ignored.
            if distance.is_finite() && distance > DEAD_ZONE {
                let step = (distance - DEAD_ZONE) / distance;
                at = [at[0] + dx * step, at[1] + dz * step];
            }
            at
        })
        .collect()
}

/// Smooths a path with a Gaussian over time. Before its start and after its end the path stands still.
fn smooth(path: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let deviation = SMOOTHING * FRAMES_PER_SECOND;
    let reach = (3.0 * deviation) as usize;
    let window = GaussianKernel::new(2 * reach + 1, deviation.powi(2));
    let kernel = window.expect("an odd size and a variance above 0").kernel();
    let sample = |frame: usize, offset: usize| {
        path[(frame + offset).clamp(reach, path.len() - 1 + reach) - reach]
    };
    (0..path.len())
        .map(|frame| {
            let weights = kernel.iter().enumerate();
            weights.fold([0.0; 2], |mean, (offset, weight)| {
                let at = sample(frame, offset);
                std::array::from_fn(|axis| mean[axis] + at[axis] * weight)
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::JOINTS;

    fn path(points: impl Iterator<Item = [f32; 2]>) -> Vec<[f32; 2]> {
        let poses = points.map(|[x, z]| [[x, 1.0, z]; JOINTS]).collect();
        camera_path(&Motion::from_joints(poses).unwrap())
    }

    #[test]
    fn small_movements_do_not_move_the_camera() {
        let sway = (0..60).map(|t| [0.25 * (t as f32 * 0.5).sin(), 0.0]);
        let path = path(sway);
        assert!(path.iter().all(|at| at[0].hypot(at[1]) < 1e-6), "{path:?}");
    }

    #[test]
    fn a_walk_is_followed_closely_and_smoothly() {
        let path = path((0..120).map(|t| [0.0, 0.05 * t as f32]));
        for (frame, at) in path.iter().enumerate() {
            assert!((at[1] - 0.05 * frame as f32).abs() < 0.7, "{frame}: {at:?}");
        }
        let steps: Vec<f32> = path
            .windows(2)
            .map(|pair| pair[1][1] - pair[0][1])
            .collect();
        assert!(steps.iter().all(|&step| (0.0..0.051).contains(&step)));
        let jolts = steps.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(jolts.fold(0.0, f32::max) < 0.005);
    }

    #[test]
    fn a_camera_far_away_stays_there() {
        let path = path(std::iter::repeat_n([-20.0, 30.0], 10));
        assert!(
            path.iter()
                .all(|at| (at[0] + 20.0).abs() < 1e-3 && (at[1] - 30.0).abs() < 1e-3)
        );
    }
}
