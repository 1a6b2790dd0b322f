//! A pose drawn as a stick figure.

use std::f32::consts::TAU;
use std::fmt::Write;

use lamogen_motion::JOINTS;
use lamogen_motion::Joint::{self, *};
use svg::node::element::{Circle, Group, Path};

use crate::camera::{Camera, CameraView};

/// A chain of joints, with the radius of the limb at each joint in metres.
type JointChain = &'static [(Joint, f32)];

/// A part of the body that is painted in one colour.
struct BodyPart {
    colour: &'static str,
    chains: &'static [JointChain],
}

/// The number of body parts.
pub(crate) const PARTS: usize = 5;

/// The colours of the parts of a figure's body: right leg, left leg, trunk with head, right arm, left arm. The right side has
/// warm colours, the left side cold ones.
pub const COLOURS: [&str; PARTS] = ["#c2410c", "#0369a1", "#374151", "#ea580c", "#0284c7"];

/// The body parts: right leg, left leg, trunk with head, right arm, left arm.
const BODY: [BodyPart; PARTS] = [
    BodyPart {
        colour: COLOURS[0],
        chains: &[&[
            (RightHip, 0.066),
            (RightKnee, 0.05),
            (RightAnkle, 0.036),
            (RightFoot, 0.032),
        ]],
    },
    BodyPart {
        colour: COLOURS[1],
        chains: &[&[
            (LeftHip, 0.066),
            (LeftKnee, 0.05),
            (LeftAnkle, 0.036),
            (LeftFoot, 0.032),
        ]],
    },
    BodyPart {
        colour: COLOURS[2],
        chains: &[
            &[
                (Pelvis, 0.075),
                (Spine1, 0.075),
                (Spine2, 0.075),
                (Spine3, 0.07),
                (Neck, 0.04),
                (Head, 0.04),
            ],
            &[(RightHip, 0.066), (LeftHip, 0.066)],
            // The right and the left side of the trunk. The chest is between them.
            &[
                (Neck, 0.04),
                (RightCollar, 0.042),
                (RightShoulder, 0.042),
                (Spine1, 0.09),
                (RightHip, 0.066),
            ],
            &[
                (Neck, 0.04),
                (LeftCollar, 0.042),
                (LeftShoulder, 0.042),
                (Spine1, 0.09),
                (LeftHip, 0.066),
            ],
        ],
    },
    BodyPart {
        colour: COLOURS[3],
        chains: &[&[
            (RightShoulder, 0.046),
            (RightElbow, 0.036),
            (RightWrist, 0.032),
        ]],
    },
    BodyPart {
        colour: COLOURS[4],
        chains: &[&[
            (LeftShoulder, 0.046),
            (LeftElbow, 0.036),
            (LeftWrist, 0.032),
        ]],
    },
];
const TRUNK: &BodyPart = &BODY[2];
/// The corners of the triangle that fills the chest.
const CHEST: [Joint; 3] = [Spine1, LeftShoulder, RightShoulder];
/// The largest radius of a limb, in metres.
const MAX_RADIUS: f32 = 0.09;

/// The radius of the head in metres.
const HEAD_RADIUS: f32 = 0.105;
/// The distance in metres from the joint of the head, which is between head and neck, to the centre of the head.
const HEAD_BEYOND_JOINT: f32 = 0.08;

/// The width in pixels of the white outline that separates limbs from those behind them.
const OUTLINE: f32 = 1.5;

/// The extent of poses in the picture including the thickness of limbs, in metres from the target of the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extent {
    /// The leftmost coordinate, which is negative left of the target.
    pub left: f32,
    /// The rightmost coordinate.
    pub right: f32,
    /// The lowest coordinate, which is negative below the target.
    pub bottom: f32,
    /// The highest coordinate.
    pub top: f32,
}

impl Extent {
    /// The extent without any point.
    pub const EMPTY: Extent = Extent {
        left: f32::INFINITY,
        right: f32::NEG_INFINITY,
        bottom: f32::INFINITY,
        top: f32::NEG_INFINITY,
    };

    /// Returns the extent of one pose while the camera looks at `target`.
    pub fn of_pose(pose: &[[f32; 3]; JOINTS], camera: &Camera, target: [f32; 2]) -> Extent {
        let limbs = pose.iter().map(|&point| (point, MAX_RADIUS));
        let points = limbs.chain([(head_centre(pose), HEAD_RADIUS)]);
        points.fold(Extent::EMPTY, |extent, (point, radius)| {
            let projected = camera.project(point, target);
            extent.union(Extent {
                left: projected.right - radius,
                right: projected.right + radius,
                bottom: projected.up - radius,
                top: projected.up + radius,
            })
        })
    }

    /// Returns the smallest extent that contains both.
    pub fn union(self, other: Extent) -> Extent {
        Extent {
            left: self.left.min(other.left),
            right: self.right.max(other.right),
            bottom: self.bottom.min(other.bottom),
            top: self.top.max(other.top),
        }
    }
}

/// Draws a pose as a trunk and limbs with thickness. Far parts are behind near ones.
pub(crate) fn stick_figure(pose: &[[f32; 3]; JOINTS], view: &CameraView) -> Group {
    let nearness = |part: &BodyPart| {
        let joints = part.chains.concat();
        let distances = joints
            .iter()
            .map(|(joint, _)| view.project(pose[joint.index()]).1);
        distances.sum::<f32>() / joints.len() as f32
    };
    let mut parts: Vec<(f32, &BodyPart)> = BODY.iter().map(|part| (nearness(part), part)).collect();
    parts.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let position = |joint: Joint| view.project(pose[joint.index()]).0;
    let mut group = Group::new()
        .set("stroke", "white")
        .set("stroke-width", 2.0 * OUTLINE)
        .set("paint-order", "stroke");
    for (_, part) in parts {
        let mut path = part_outline(part, position, view.scale);
        if part.colour == TRUNK.colour {
            push_triangle(&mut path, CHEST.map(position));
        }
        group = group.add(Path::new().set("d", path).set("fill", part.colour));
        if part.colour == TRUNK.colour {
            let [x, y] = view.project(head_centre(pose)).0;
            group = group.add(
                Circle::new()
                    .set("cx", format!("{x:.1}"))
                    .set("cy", format!("{y:.1}"))
                    .set("r", format!("{:.1}", HEAD_RADIUS * view.scale))
                    .set("fill", part.colour),
            );
        }
    }
    group
}

/// Draws the shadow of a pose on the ground under a light straight above.
pub(crate) fn shadow(pose: &[[f32; 3]; JOINTS], view: &CameraView, colour: &str) -> Path {
    let foreshortening = view.camera.foreshortening();
    // The shadow is drawn as seen from above and then foreshortened like the ground.
    let from_above = |[x, _, z]: [f32; 3]| {
        let [x, y] = view.project([x, 0.0, z]).0;
        [x, y / foreshortening]
    };
    let mut path = String::new();
    for part in &BODY {
        path += &part_outline(part, |joint| from_above(pose[joint.index()]), view.scale);
    }
    let centre = from_above(head_centre(pose));
    let radius = HEAD_RADIUS * view.scale;
    push_capsule(&mut path, (centre, radius), (centre, radius));
    Path::new()
        .set("d", path)
        .set("fill", colour)
        .set("transform", format!("scale(1 {foreshortening})"))
}

/// Returns the outline of a body part as path data. `position` gives the position of each joint in pixels; `scale` is in
/// pixels per metre.
fn part_outline(part: &BodyPart, position: impl Fn(Joint) -> [f32; 2], scale: f32) -> String {
    let bones = part.chains.iter().flat_map(|chain| chain.windows(2));
    bones.fold(String::new(), |mut path, bone| {
        let [a, b] = [bone[0], bone[1]].map(|(joint, radius)| (position(joint), radius * scale));
        push_capsule(&mut path, a, b);
        path
    })
}

/// Returns the centre of the head.
fn head_centre(pose: &[[f32; 3]; JOINTS]) -> [f32; 3] {
    let [neck, head] = [Neck, Head].map(|joint| pose[joint.index()]);
    let along: [f32; 3] = std::array::from_fn(|axis| head[axis] - neck[axis]);
    let length = along.iter().map(|x| x * x).sum::<f32>().sqrt();
    if !(1e-6..1e6).contains(&length) {
        return head;
    }
    std::array::from_fn(|axis| head[axis] + along[axis] / length * HEAD_BEYOND_JOINT)
}

/// Appends the outline of two circles and the area between their common tangents. All outlines have the same orientation,
/// so that overlapping ones are filled as their union.
fn push_capsule(path: &mut String, (a, a_radius): ([f32; 2], f32), (b, b_radius): ([f32; 2], f32)) {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy);
    let written = if length <= (a_radius - b_radius).abs() + 0.05 {
        // One circle contains the other.
        let ([x, y], r) = match a_radius > b_radius {
            true => (a, a_radius),
            false => (b, b_radius),
        };
        write!(
            path,
            "M{:.1} {y:.1}a{r:.1} {r:.1} 0 0 1 {d:.1} 0a{r:.1} {r:.1} 0 0 1 -{d:.1} 0z",
            x - r,
            d = 2.0 * r
        )
    } else {
        // The tangents touch both circles at this angle from the line between the centres.
        let angle = ((a_radius - b_radius) / length).acos();
        let direction = dy.atan2(dx);
        let at = |[x, y]: [f32; 2], radius: f32, angle: f32| {
            let (sin, cos) = (direction + angle).sin_cos();
            (x + radius * cos, y + radius * sin)
        };
        let (first, second) = (at(a, a_radius, angle), at(a, a_radius, -angle));
        let (third, fourth) = (at(b, b_radius, -angle), at(b, b_radius, angle));
        let large = u8::from(angle < TAU / 4.0);
        write!(
            path,
            "M{:.1} {:.1}A{a_radius:.1} {a_radius:.1} 0 {large} 1 {:.1} {:.1}\
             L{:.1} {:.1}A{b_radius:.1} {b_radius:.1} 0 {} 1 {:.1} {:.1}z",
            first.0,
            first.1,
            second.0,
            second.1,
            third.0,
            third.1,
            1 - large,
            fourth.0,
            fourth.1,
        )
    };
    written.expect("writing to a string does not fail");
}

/// Appends a triangle with the same orientation as capsules.
fn push_triangle(path: &mut String, [a, b, c]: [[f32; 2]; 3]) {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let [b, c] = if area < 0.0 { [c, b] } else { [b, c] };
    write!(
        path,
        "M{:.1} {:.1}L{:.1} {:.1}L{:.1} {:.1}z",
        a[0], a[1], b[0], b[1], c[0], c[1]
    )
    .expect("writing to a string does not fail");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> CameraView {
        CameraView {
            camera: Camera::new(0.2),
            target: [0.0; 2],
            origin: [100.0, 200.0],
            scale: 100.0,
        }
    }

    /// Returns the body parts in the order in which they are painted.
    fn painting_order(pose: &[[f32; 3]; JOINTS]) -> Vec<usize> {
        let svg = stick_figure(pose, &view()).to_string();
        let mut order: Vec<usize> = (0..COLOURS.len()).collect();
        order.sort_by_key(|&part| svg.find(COLOURS[part]).expect("every part is drawn"));
        order
    }

    #[test]
    fn the_nearer_arm_is_painted_later() {
        let (right, left) = (3, 4);
        for (near, far) in [(right, left), (left, right)] {
            let mut pose = [[0.0, 1.0, 0.0]; JOINTS];
            for (joint, _) in BODY[near].chains[0] {
                pose[joint.index()][2] = 0.5;
            }
            let order = painting_order(&pose);
            let position = |part| order.iter().position(|&p| p == part).unwrap();
            assert!(position(near) > position(far), "{order:?}");
        }
    }

    #[test]
    fn the_head_lies_beyond_its_joint_and_within_the_extent() {
        let mut pose = [[0.0, 1.0, 0.0]; JOINTS];
        pose[Neck.index()][1] = 1.4;
        pose[Head.index()][1] = 1.5;
        assert_eq!(head_centre(&pose), [0.0, 1.5 + HEAD_BEYOND_JOINT, 0.0]);
        let camera = Camera::new(0.0);
        let extent = Extent::of_pose(&pose, &camera, [0.0; 2]);
        assert!((extent.top - (1.5 + HEAD_BEYOND_JOINT + HEAD_RADIUS)).abs() < 1e-6);
        assert!((extent.bottom - (1.0 - MAX_RADIUS)).abs() < 1e-6);
    }

    #[test]
    fn every_joint_is_part_of_the_body() {
        let drawn = BODY.iter().flat_map(|part| part.chains.concat());
        let drawn: Vec<Joint> = drawn.map(|(joint, _)| joint).collect();
        for joint in Joint::ALL {
            assert!(drawn.contains(&joint), "{}", joint.name());
        }
    }

    #[test]
    fn bones_without_length_are_drawn_as_circles() {
        let pose = [[0.0; 3]; JOINTS];
        let svg =
            stick_figure(&pose, &view()).to_string() + &shadow(&pose, &view(), "#ddd").to_string();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }

    #[test]
    fn outlines_of_all_directions_have_the_same_orientation() {
        // Twice the signed area of the polygon of the four corners; its sign is the orientation.
        for step in 0..12 {
            let (sin, cos) = (step as f32 * TAU / 12.0).sin_cos();
            let mut path = String::new();
            push_capsule(
                &mut path,
                ([50.0, 50.0], 6.0),
                ([50.0 + 30.0 * cos, 50.0 + 30.0 * sin], 4.0),
            );
            let numbers: Vec<f32> = path
                .split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))
                .filter_map(|number| number.parse().ok())
                .collect();
            let corners: Vec<_> = [0, 7, 9, 16].map(|i| (numbers[i], numbers[i + 1])).into();
            let area: f32 = (0..4)
                .map(|i| (corners[i], corners[(i + 1) % 4]))
                .map(|(a, b)| a.0 * b.1 - a.1 * b.0)
                .sum();
            assert!(area > 0.0, "{path}");
        }
    }
}
