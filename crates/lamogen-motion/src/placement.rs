//! Where on the ground a body is, and which way it faces.

use glam::{DQuat, DVec3};

use crate::encode::facing;
use crate::precise::{points, vector};
use crate::rotations::Rotations;
use crate::skeleton::JOINTS;

/// The place of a body on the ground and the direction that it faces, taken from hips and shoulders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The point of the ground below the pelvis.
    place: DVec3,
    /// The turn about the vertical from +Z to the direction that the body faces, in radians.
    heading: f64,
}

impl Placement {
    /// The placement at the origin, facing +Z.
    pub const ORIGIN: Placement = Placement {
        place: DVec3::ZERO,
        heading: 0.0,
    };

    /// Returns the placement of a pose, whose joint positions are in metres.
    pub fn of(pose: &[[f32; 3]; JOINTS]) -> Placement {
        let pose = points(pose);
        let facing = facing(&pose);
        Placement {
            place: pose[0] * DVec3::new(1.0, 0.0, 1.0),
            heading: facing.x.atan2(facing.z),
        }
    }

    /// Returns the direction that the body faces: the turn about the vertical from +Z, in radians, positive to the left.
    pub fn heading(&self) -> f64 {
        self.heading
    }

    /// Returns the movement of the ground that takes a body from this placement to another.
    pub fn to(&self, other: &Placement) -> GroundMove {
        let turn = DQuat::from_rotation_y(other.heading - self.heading);
        GroundMove {
            turn,
            shift: other.place - turn * self.place,
        }
    }
}

/// A turn about the vertical and a shift along the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundMove {
    turn: DQuat,
    shift: DVec3,
}

impl GroundMove {
    /// Returns a moved point.
    pub fn of_point(&self, point: [f32; 3]) -> [f32; 3] {
        (self.turn * vector(point) + self.shift)
            .as_vec3()
            .to_array()
    }

    /// Returns the rotations of the moved body.
    pub fn of_rotations(&self, rotations: &Rotations) -> Rotations {
        let root = rotations.root().iter();
        let root = root.map(|place| {
            (self.turn * vector(*place) + self.shift)
                .as_vec3()
                .to_array()
        });
        let local = rotations.local().iter().map(|pose| {
            let mut pose = *pose;
            let turn = self.turn * DQuat::from_array(pose[0].map(f64::from));
            pose[0] = turn.to_array().map(|x| x as f32);
            pose
        });
        Rotations::new(
            rotations.rest().clone(),
            root.collect(),
            local.collect(),
            rotations.frames_per_second(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::FRAMES_PER_SECOND;
    use crate::rotations::RestPose;

    fn standing(place: [f32; 3], heading: f32) -> Rotations {
        let mut pose = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
        pose[0] = [0.0, (heading / 2.0).sin(), 0.0, (heading / 2.0).cos()];
        Rotations::new(
            RestPose::humanml3d(),
            vec![place; 2],
            vec![pose; 2],
            FRAMES_PER_SECOND,
        )
    }

    #[test]
    fn a_body_is_moved_to_the_placement_of_another() {
        let body = standing([1.0, 0.9, 2.0], 0.4);
        let other = standing([-3.0, 0.9, 0.5], 3.0);
        let placement = |rotations: &Rotations| Placement::of(&rotations.joints()[0]);
        let moved = placement(&body).to(&placement(&other)).of_rotations(&body);
        let pairs = moved.joints()[1].into_iter().zip(other.joints()[1]);
        for (found, expected) in pairs {
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-5, "{found} {expected}");
            }
        }
    }
}
