//! One pose as a stick figure.

use std::f32::consts::TAU;
use std::fmt::Write;

use lamogen_motion::JOINTS;
use lamogen_motion::Joint::{self, *};
use svg::node::element::{Circle, Group, Path};

use crate::camera::{Camera, View};

/// Joints along a line, and half the thickness there in metres.
type Line = &'static [(Joint, f32)];

/// What is painted at once, in one colour.
struct Part {
    colour: &'static str,
    lines: &'static [Line],
}

/// Number of parts.
pub(crate) const PARTS: usize = 5;

/// Their colours. The right side is warm, the left cold.
pub(crate) const COLOURS: [&str; PARTS] = ["#c2410c", "#0369a1", "#374151", "#ea580c", "#0284c7"];

/// Right leg, left leg, trunk with the head, right arm, left arm.
const BODY: [Part; PARTS] = [
    Part {
        colour: COLOURS[0],
        lines: &[&[
            (RightHip, 0.066),
            (RightKnee, 0.05),
            (RightAnkle, 0.036),
            (RightFoot, 0.032),
        ]],
    },
    Part {
        colour: COLOURS[1],
        lines: &[&[
            (LeftHip, 0.066),
            (LeftKnee, 0.05),
            (LeftAnkle, 0.036),
            (LeftFoot, 0.032),
        ]],
    },
    Part {
        colour: COLOURS[2],
        lines: &[
            &[
                (Pelvis, 0.075),
                (Spine1, 0.075),
                (Spine2, 0.075),
                (Spine3, 0.07),
                (Neck, 0.04),
                (Head, 0.04),
            ],
            &[(RightHip, 0.066), (LeftHip, 0.066)],
            // The sides; what lies between them is the chest.
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
    Part {
        colour: COLOURS[3],
        lines: &[&[
            (RightShoulder, 0.046),
            (RightElbow, 0.036),
            (RightWrist, 0.032),
        ]],
    },
    Part {
        colour: COLOURS[4],
        lines: &[&[
            (LeftShoulder, 0.046),
            (LeftElbow, 0.036),
            (LeftWrist, 0.032),
        ]],
    },
];
const TRUNK: &Part = &BODY[2];
const CHEST: [Joint; 3] = [Spine1, LeftShoulder, RightShoulder];
const THICKEST: f32 = 0.09;

/// Radius of the head, and how far its middle lies beyond the joint, in metres: the joint is where
/// head and neck meet.
const HEAD: f32 = 0.105;
const HEAD_BEYOND_JOINT: f32 = 0.08;

/// Pixels of white around limbs, which sets those in front off those behind.
const OUTLINE: f32 = 1.5;

/// What a pose takes of the picture, in metres from where the camera is aimed, thickness included.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extent {
    /// Furthest to the left (negative) and to the right.
    pub left: f32,
    pub right: f32,
    /// Lowest (negative below the ground in the middle) and highest.
    pub bottom: f32,
    pub top: f32,
}

impl Extent {
    /// The extent of nothing.
    pub const NONE: Extent = Extent {
        left: f32::INFINITY,
        right: f32::NEG_INFINITY,
        bottom: f32::INFINITY,
        top: f32::NEG_INFINITY,
    };

    /// The extent of one pose.
    pub fn of(pose: &[[f32; 3]; JOINTS], camera: &Camera, middle: [f32; 2]) -> Extent {
        let limbs = pose.iter().map(|&point| (point, THICKEST));
        let points = limbs.chain([(head(pose), HEAD)]);
        points.fold(Extent::NONE, |extent, (point, radius)| {
            let seen = camera.see(point, middle);
            extent.and(Extent {
                left: seen.right - radius,
                right: seen.right + radius,
                bottom: seen.up - radius,
                top: seen.up + radius,
            })
        })
    }

    /// The extent of both.
    pub fn and(self, other: Extent) -> Extent {
        Extent {
            left: self.left.min(other.left),
            right: self.right.max(other.right),
            bottom: self.bottom.min(other.bottom),
            top: self.top.max(other.top),
        }
    }
}

/// Draws a pose: a trunk and limbs with thickness, far ones behind near ones.
pub(crate) fn figure(pose: &[[f32; 3]; JOINTS], view: &View) -> Group {
    let nearness = |part: &Part| {
        let joints = part.lines.concat();
        let each = joints.iter().map(|(j, _)| view.place(pose[j.index()]).1);
        each.sum::<f32>() / joints.len() as f32
    };
    let mut parts: Vec<(f32, &Part)> = BODY.iter().map(|part| (nearness(part), part)).collect();
    parts.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let at = |joint: Joint| view.place(pose[joint.index()]).0;
    let mut group = Group::new()
        .set("stroke", "white")
        .set("stroke-width", 2.0 * OUTLINE)
        .set("paint-order", "stroke");
    for (_, part) in parts {
        let mut path = outline(part, at, view.scale);
        if part.colour == TRUNK.colour {
            triangle(&mut path, CHEST.map(at));
        }
        group = group.add(Path::new().set("d", path).set("fill", part.colour));
        if part.colour == TRUNK.colour {
            let [x, y] = view.place(head(pose)).0;
            group = group.add(
                Circle::new()
                    .set("cx", format!("{x:.1}"))
                    .set("cy", format!("{y:.1}"))
                    .set("r", format!("{:.1}", HEAD * view.scale))
                    .set("fill", part.colour),
            );
        }
    }
    group
}

/// Draws what a pose hides of the ground from a light straight above.
pub(crate) fn shadow(pose: &[[f32; 3]; JOINTS], view: &View, colour: &str) -> Path {
    let flatness = view.camera.flatness();
    // Drawn as seen from above, then flattened with the ground.
    let upright = |[x, _, z]: [f32; 3]| {
        let [x, y] = view.place([x, 0.0, z]).0;
        [x, y / flatness]
    };
    let mut path = String::new();
    for part in &BODY {
        path += &outline(part, |joint| upright(pose[joint.index()]), view.scale);
    }
    let middle = upright(head(pose));
    let radius = HEAD * view.scale;
    capsule(&mut path, (middle, radius), (middle, radius));
    Path::new()
        .set("d", path)
        .set("fill", colour)
        .set("transform", format!("scale(1 {flatness})"))
}

/// The outline of a part's lines, `scale` pixels a metre thick.
fn outline(part: &Part, at: impl Fn(Joint) -> [f32; 2], scale: f32) -> String {
    let bones = part.lines.iter().flat_map(|line| line.windows(2));
    bones.fold(String::new(), |mut path, bone| {
        let [a, b] = [bone[0], bone[1]].map(|(joint, radius)| (at(joint), radius * scale));
        capsule(&mut path, a, b);
        path
    })
}

/// The middle of the head.
fn head(pose: &[[f32; 3]; JOINTS]) -> [f32; 3] {
    let [neck, head] = [Neck, Head].map(|joint| pose[joint.index()]);
    let along: [f32; 3] = std::array::from_fn(|axis| head[axis] - neck[axis]);
    let length = along.iter().map(|x| x * x).sum::<f32>().sqrt();
    if !(1e-6..1e6).contains(&length) {
        return head;
    }
    std::array::from_fn(|axis| head[axis] + along[axis] / length * HEAD_BEYOND_JOINT)
}

/// Appends the outline of two circles and what lies between their common tangents. All outlines
/// turn the same way, so that their union is filled where they overlap.
fn capsule(path: &mut String, (a, a_radius): ([f32; 2], f32), (b, b_radius): ([f32; 2], f32)) {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy);
    let written = if length <= (a_radius - b_radius).abs() + 0.05 {
        // One circle hides the other.
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
        // The tangents touch both circles at this angle from the line between the middles.
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

/// Appends a triangle that turns as capsules do.
fn triangle(path: &mut String, [a, b, c]: [[f32; 2]; 3]) {
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

    fn view() -> View {
        View {
            camera: Camera::new(0.2),
            middle: [0.0; 2],
            origin: [100.0, 200.0],
            scale: 100.0,
        }
    }

    /// The order in which the colours are painted.
    fn order(pose: &[[f32; 3]; JOINTS]) -> Vec<usize> {
        let svg = figure(pose, &view()).to_string();
        let mut order: Vec<usize> = (0..COLOURS.len()).collect();
        order.sort_by_key(|&part| svg.find(COLOURS[part]).expect("every part is drawn"));
        order
    }

    #[test]
    fn the_nearer_arm_is_painted_later() {
        let (right, left) = (3, 4);
        for (near, far) in [(right, left), (left, right)] {
            let mut pose = [[0.0, 1.0, 0.0]; JOINTS];
            for (joint, _) in BODY[near].lines[0] {
                pose[joint.index()][2] = 0.5;
            }
            let order = order(&pose);
            let position = |part| order.iter().position(|&p| p == part).unwrap();
            assert!(position(near) > position(far), "{order:?}");
        }
    }

    #[test]
    fn the_head_lies_beyond_its_joint_and_within_the_extent() {
        let mut pose = [[0.0, 1.0, 0.0]; JOINTS];
        pose[Neck.index()][1] = 1.4;
        pose[Head.index()][1] = 1.5;
        assert_eq!(head(&pose), [0.0, 1.5 + HEAD_BEYOND_JOINT, 0.0]);
        let camera = Camera::new(0.0);
        let extent = Extent::of(&pose, &camera, [0.0; 2]);
        assert!((extent.top - (1.5 + HEAD_BEYOND_JOINT + HEAD)).abs() < 1e-6);
        assert!((extent.bottom - (1.0 - THICKEST)).abs() < 1e-6);
    }

    #[test]
    fn every_joint_is_part_of_the_body() {
        let drawn = BODY.iter().flat_map(|part| part.lines.concat());
        let drawn: Vec<Joint> = drawn.map(|(joint, _)| joint).collect();
        for joint in Joint::ALL {
            assert!(drawn.contains(&joint), "{}", joint.name());
        }
    }

    #[test]
    fn bones_without_length_are_drawn_as_circles() {
        let pose = [[0.0; 3]; JOINTS];
        let svg = figure(&pose, &view()).to_string() + &shadow(&pose, &view(), "#ddd").to_string();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }

    #[test]
    fn limbs_of_any_direction_turn_the_same_way() {
        // Twice the area within a polygon of the four corners; its sign is the turn.
        for step in 0..12 {
            let (sin, cos) = (step as f32 * TAU / 12.0).sin_cos();
            let mut path = String::new();
            capsule(
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
