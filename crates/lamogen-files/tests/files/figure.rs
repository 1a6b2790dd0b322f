//! A synthetic figure for BVH files in the style of other programs, with known joint positions.
//!
//! It stands in a T-pose, bends its left elbow and its right knee, turns and walks away.

// Not every test uses all functions of this module.
#![allow(dead_code)]

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

use glam::{DQuat, DVec3};

/// Returns the position of a named point of the body in the T-pose, in metres. Points of the right side mirror those of
/// the left side.
fn t_pose_position(name: &str) -> DVec3 {
    let [x, y, z] = match name {
        "ground" => [0.0, 0.0, 0.0],
        "pelvis" => [0.0, 0.93, 0.0],
        "spine1" => [0.0, 1.06, -0.01],
        "belly" => [0.0, 1.09, 0.0],
        "spine2" => [0.0, 1.2, 0.0],
        "spine3" => [0.0, 1.255, 0.005],
        "chest" => [0.0, 1.3, 0.0],
        "neck" => [0.0, 1.47, -0.02],
        "throat" => [0.0, 1.52, 0.0],
        "head" => [0.0, 1.56, 0.03],
        "crown" => [0.0, 1.72, 0.02],
        "left_hip" => [0.08, 0.86, 0.0],
        "left_knee" => [0.1, 0.47, 0.01],
        "left_ankle" => [0.1, 0.05, -0.02],
        "left_foot" => [0.11, 0.0, 0.11],
        "left_toe" => [0.115, 0.0, 0.19],
        "left_collar" => [0.075, 1.37, -0.01],
        "left_shoulder" => [0.19, 1.42, -0.02],
        "left_elbow" => [0.45, 1.42, -0.03],
        "left_wrist" => [0.71, 1.42, -0.03],
        "left_fingers" => [0.88, 1.42, -0.03],
        right => {
            let left = right.replacen("right_", "left_", 1);
            assert_ne!(right, left, "no such place");
            return t_pose_position(&left) * DVec3::new(-1.0, 1.0, 1.0);
        }
    };
    DVec3::new(x, y, z)
}

/// Returns the angle in radians by which the figure has turned at a time.
fn heading(seconds: f64) -> f64 {
    0.6 * seconds
}

/// Returns the angle in radians by which the elbow and the knee are bent at a time.
fn bend(seconds: f64) -> f64 {
    1.1 * seconds
}

/// Returns the offset in metres by which the figure has walked at a time.
fn walk_offset(seconds: f64) -> DVec3 {
    DVec3::new(0.4, 0.05, 1.2) * seconds
}

/// Returns the position of a named point of the body at a time, in metres, Y up.
pub fn position_at(name: &str, seconds: f64) -> DVec3 {
    let about = |joint: &str, point: DVec3| {
        t_pose_position(joint)
            + DQuat::from_rotation_x(bend(seconds)) * (point - t_pose_position(joint))
    };
    let mut point = t_pose_position(name);
    if name == "left_wrist" {
        let elbow = t_pose_position("left_elbow");
        point = elbow + DQuat::from_rotation_y(-bend(seconds)) * (point - elbow);
    } else if ["right_ankle", "right_foot"].contains(&name) {
        point = about("right_knee", point);
    }
    let pelvis = t_pose_position("pelvis");
    pelvis + walk_offset(seconds) + DQuat::from_rotation_y(heading(seconds)) * (point - pelvis)
}

/// The directions of the axes of the file and of its rest pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stance {
    /// Y up.
    YUp,
    /// Z up.
    ZUp,
    /// Y up, but in the rest pose the body lies along X.
    Lying,
    /// Z up, but in the rest pose the body stands along Y.
    RestYUp,
}

impl Stance {
    /// Returns the rotation from the rest pose with Y up to the offsets of the file.
    fn rest(self) -> DQuat {
        match self {
            Stance::YUp | Stance::RestYUp => DQuat::IDENTITY,
            Stance::ZUp => DQuat::from_rotation_x(FRAC_PI_2),
            Stance::Lying => DQuat::from_rotation_z(-FRAC_PI_2),
        }
    }

    /// Returns the rotation from the world with Y up to the world of the file.
    fn world(self) -> DQuat {
        match self {
            Stance::YUp | Stance::Lying => DQuat::IDENTITY,
            Stance::ZUp | Stance::RestYUp => DQuat::from_rotation_x(FRAC_PI_2),
        }
    }
}

/// The options of a BVH file of the figure.
pub struct Figure<'a> {
    /// The hierarchy, one line `point name` for each joint, with children indented by one more space. Each joint of the
    /// left side stands for both sides; `%` is the word for the side. A line without a name is an end site.
    pub tree: &'a str,
    /// The words for left and right.
    pub sides: [&'a str; 2],
    /// The length of a unit in metres.
    pub unit: f64,
    pub stance: Stance,
    pub frames_per_second: f64,
    pub frames: usize,
}

struct Node {
    place: String,
    name: String,
    parent: Option<usize>,
}

impl Figure<'_> {
    /// Returns the text of the file.
    pub fn text(&self) -> String {
        let nodes = self.nodes();
        let mut text = String::from("HIERARCHY\n");
        let mut order = Vec::new();
        self.hierarchy(&nodes, 0, &mut text, &mut order);
        let rate = self.frames_per_second;
        writeln!(
            text,
            "MOTION\nFrames: {}\nFrame Time: {:.7}",
            self.frames,
            1.0 / rate
        )
        .unwrap();
        for frame in 0..self.frames {
            let row = order
                .iter()
                .map(|&node| self.channel_values(&nodes, node, frame as f64 / rate));
            text.push_str(&row.collect::<Vec<_>>().join(" "));
            text.push('\n');
        }
        text
    }

    fn nodes(&self) -> Vec<Node> {
        let mut nodes: Vec<Node> = Vec::new();
        // The left and the right joint at every depth; both are the same joint for the middle of the body.
        let mut branch: Vec<[usize; 2]> = Vec::new();
        for line in self.tree.lines().filter(|line| !line.trim().is_empty()) {
            let depth = line.len() - line.trim_start().len();
            let (place, name) = line.trim().split_once(' ').unwrap_or((line.trim(), ""));
            branch.truncate(depth);
            let mut pair = [0; 2];
            let sides = if place.starts_with("left_") { 2 } else { 1 };
            for side in 0..sides {
                pair[side] = nodes.len();
                nodes.push(Node {
                    place: match side {
                        0 => place.to_owned(),
                        _ => place.replacen("left_", "right_", 1),
                    },
                    name: name.replace('%', self.sides[side]),
                    parent: branch.last().map(|above| above[side]),
                });
            }
            if sides == 1 {
                pair[1] = pair[0];
            }
            branch.push(pair);
        }
        nodes
    }

    fn hierarchy(&self, nodes: &[Node], node: usize, text: &mut String, order: &mut Vec<usize>) {
        let Node {
            place: here,
            name,
            parent,
        } = &nodes[node];
        let above = parent.map_or(DVec3::ZERO, |parent| t_pose_position(&nodes[parent].place));
        let offset = self.stance.rest() * (t_pose_position(here) - above) / self.unit;
        let offset = format!("OFFSET {:.6} {:.6} {:.6}", offset.x, offset.y, offset.z);
        if name.is_empty() {
            writeln!(text, "End Site\n{{\n{offset}\n}}").unwrap();
            return;
        }
        order.push(node);
        let (keyword, channels) = match parent {
            None => (
                "ROOT",
                "6 Xposition Yposition Zposition Xrotation Yrotation Zrotation",
            ),
            Some(_) => ("JOINT", "3 Zrotation Xrotation Yrotation"),
        };
        writeln!(text, "{keyword} {name}\n{{\n{offset}\nCHANNELS {channels}").unwrap();
        for child in 0..nodes.len() {
            if nodes[child].parent == Some(node) {
                self.hierarchy(nodes, child, text, order);
            }
        }
        text.push_str("}\n");
    }

    /// Returns the channel values of a joint at a time.
    fn channel_values(&self, nodes: &[Node], node: usize, seconds: f64) -> String {
        let place_name = &*nodes[node].place;
        let (rest, world) = (self.stance.rest(), self.stance.world());
        let local = match place_name {
            "left_elbow" => DQuat::from_rotation_y(-bend(seconds)),
            "right_knee" => DQuat::from_rotation_x(bend(seconds)),
            _ => DQuat::IDENTITY,
        };
        let turn = rest * local * rest.inverse();
        if nodes[node].parent.is_some() {
            let (z, x, y) = turn.to_euler(glam::EulerRot::ZXY);
            let degrees = [z, x, y].map(|angle| format!("{:.6}", angle.to_degrees()));
            return degrees.join(" ");
        }
        // The figure turns about its pelvis, which is not always the root.
        let heading = DQuat::from_rotation_y(heading(seconds));
        let pelvis = t_pose_position("pelvis");
        let root = pelvis + walk_offset(seconds) + heading * (t_pose_position(place_name) - pelvis);
        let root = world * root / self.unit;
        let turn = world * heading * rest.inverse();
        let (x, y, z) = turn.to_euler(glam::EulerRot::XYZ);
        let degrees = [x, y, z].map(f64::to_degrees);
        let numbers = root.to_array().into_iter().chain(degrees);
        let numbers: Vec<String> = numbers.map(|number| format!("{number:.6}")).collect();
        numbers.join(" ")
    }
}
