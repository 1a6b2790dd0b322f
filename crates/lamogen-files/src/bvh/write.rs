//! Writing rotations as BVH text.

use std::fmt::Write;

use glam::{DQuat, DVec3};
use lamogen_motion::{JOINTS, Joint, Keyframes};

use super::euler::zxy_angles;
use crate::units::Unit;

/// Options for writing a BVH.
#[derive(Clone, Debug, PartialEq)]
pub struct BvhOptions {
    /// The unit of lengths in the file. The default is centimetres, which most programs expect.
    pub unit: Unit,
    /// The names of the joints.
    pub names: BvhNames,
}

impl Default for BvhOptions {
    fn default() -> Self {
        BvhOptions {
            unit: Unit::Centimetre,
            names: BvhNames::HumanMl3d,
        }
    }
}

/// The naming scheme of the joints in a BVH that lamogen writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum BvhNames {
    /// The names of [`Joint::name`]: `pelvis`, `left_hip`, …
    #[default]
    HumanMl3d,
    /// The names of Mixamo's characters without their prefix: `Hips`, `LeftUpLeg`, … Retargeting tools know these
    /// names.
    Mixamo,
}

impl BvhNames {
    /// Returns the name of a joint.
    pub fn name(self, joint: Joint) -> &'static str {
        use Joint::*;
        match self {
            BvhNames::HumanMl3d => joint.name(),
            BvhNames::Mixamo => match joint {
                Pelvis => "Hips",
                LeftHip => "LeftUpLeg",
                RightHip => "RightUpLeg",
                Spine1 => "Spine",
                LeftKnee => "LeftLeg",
                RightKnee => "RightLeg",
                Spine2 => "Spine1",
                LeftAnkle => "LeftFoot",
                RightAnkle => "RightFoot",
                Spine3 => "Spine2",
                LeftFoot => "LeftToeBase",
                RightFoot => "RightToeBase",
                Neck => "Neck",
                LeftCollar => "LeftShoulder",
                RightCollar => "RightShoulder",
                Head => "Head",
                LeftShoulder => "LeftArm",
                RightShoulder => "RightArm",
                LeftElbow => "LeftForeArm",
                RightElbow => "RightForeArm",
                LeftWrist => "LeftHand",
                RightWrist => "RightHand",
            },
        }
    }
}

/// Formats a motion as the text of a BVH file, at the frame rate of the keyframes.
///
/// The axes are right-handed with Y up. Without any rotation, the body stands in a T-pose that faces +Z, with its left
/// arm along +X. The root has six channels: `Xposition Yposition Zposition`, which replace its `OFFSET` of 0, and three
/// rotations. Every other joint has three rotations. Rotations are in degrees, in the order
/// `Zrotation Xrotation Yrotation`: the rotation is `Rz · Rx · Ry`. Angles continue past 180° and do not jump, so that
/// programs can interpolate between frames.
///
/// If the root of the keyframes travels, the file has a joint `root` above the pelvis, and both have six channels.
pub fn text(keyframes: &Keyframes, options: &BvhOptions) -> String {
    let rotations = &keyframes.rotations;
    let rest = rotations.rest();
    SkeletonAnimation {
        offsets: Joint::ALL.map(|joint| rest.offset(joint)),
        tips: rest.tips(),
        root: rotations.root(),
        root_path: keyframes.root_path.as_deref(),
        local: rotations.local(),
        frames_per_second: rotations.frames_per_second(),
    }
    .text(options)
}

/// The channels of the root, and of the pelvis below a root.
const ROOT_CHANNELS: &str = "6 Xposition Yposition Zposition Zrotation Xrotation Yrotation";

/// The skeleton and the animation that a BVH text is made from.
struct SkeletonAnimation<'a> {
    offsets: [[f32; 3]; JOINTS],
    tips: [(Joint, [f32; 3]); 5],
    /// The positions of the pelvis.
    root: &'a [[f32; 3]],
    /// The positions of the root above the pelvis, if there is one.
    root_path: Option<&'a [[f32; 3]]>,
    local: &'a [[[f32; 4]; JOINTS]],
    frames_per_second: f32,
}

impl SkeletonAnimation<'_> {
    /// Formats the whole file.
    fn text(&self, options: &BvhOptions) -> String {
        let scale = 1.0 / options.unit.metres();
        let mut text = String::from("HIERARCHY\n");
        let mut order = Vec::with_capacity(JOINTS);
        let depth = usize::from(self.root_path.is_some());
        if depth > 0 {
            text.push_str("ROOT root\n{\n\tOFFSET 0.000000 0.000000 0.000000\n");
            let _ = writeln!(text, "\tCHANNELS {ROOT_CHANNELS}");
        }
        self.write_hierarchy(
            Joint::Pelvis,
            depth,
            scale,
            options.names,
            &mut text,
            &mut order,
        );
        if depth > 0 {
            text.push_str("}\n");
        }
        text.push_str("MOTION\n");
        // Writing to a String cannot fail.
        let _ = writeln!(text, "Frames: {}", self.root.len());
        let seconds = 1.0 / f64::from(self.frames_per_second);
        let _ = writeln!(text, "Frame Time: {seconds}");
        let mut angles = [[0.0; 3]; JOINTS];
        for (frame, (root, local)) in self.root.iter().zip(self.local).enumerate() {
            if let Some(path) = self.root_path {
                text.push_str(&format_triple(to_vector(path[frame]) * scale));
                text.push(' ');
                text.push_str(&format_triple(DVec3::ZERO));
                text.push(' ');
            }
            text.push_str(&format_triple(to_vector(*root) * scale));
            for &joint in &order {
                let j = joint.index();
                let rotation = DQuat::from_array(local[j].map(f64::from)).normalize();
                angles[j] = zxy_angles(rotation, angles[j]);
                text.push(' ');
                text.push_str(&format_triple(angles[j].map(f64::to_degrees).into()));
            }
            text.push('\n');
        }
        text
    }

    /// Appends a joint and all joints below it to `text`, and their order in the file, which is also the order of the
    /// channels, to `order`.
    fn write_hierarchy(
        &self,
        joint: Joint,
        depth: usize,
        scale: f64,
        names: BvhNames,
        text: &mut String,
        order: &mut Vec<Joint>,
    ) {
        order.push(joint);
        let indent = "\t".repeat(depth);
        let (keyword, offset, channels) = match joint.parent() {
            None if depth == 0 => ("ROOT", DVec3::ZERO, ROOT_CHANNELS),
            None => ("JOINT", DVec3::ZERO, ROOT_CHANNELS),
            Some(_) => (
                "JOINT",
                to_vector(self.offsets[joint.index()]) * scale,
                "3 Zrotation Xrotation Yrotation",
            ),
        };
        let _ = write!(
            text,
            "{indent}{keyword} {name}\n{indent}{{\n{indent}\tOFFSET {offset}\n{indent}\tCHANNELS {channels}\n",
            name = names.name(joint),
            offset = format_triple(offset),
        );
        for child in Joint::ALL {
            if child.parent() == Some(joint) {
                self.write_hierarchy(child, depth + 1, scale, names, text, order);
            }
        }
        for (_, tip) in self.tips.iter().filter(|(at, _)| *at == joint) {
            let _ = write!(
                text,
                "{indent}\tEnd Site\n{indent}\t{{\n{indent}\t\tOFFSET {offset}\n{indent}\t}}\n",
                offset = format_triple(to_vector(*tip) * scale),
            );
        }
        let _ = writeln!(text, "{indent}}}");
    }
}

fn to_vector(point: [f32; 3]) -> DVec3 {
    DVec3::from(point.map(f64::from))
}

/// Formats three numbers with six decimals and never writes minus zero. An error of a millionth of a degree is not
/// visible, even at the end of a chain of joints.
fn format_triple(values: DVec3) -> String {
    let [x, y, z] = values
        .to_array()
        .map(|value| if value.abs() < 5e-7 { 0.0 } else { value });
    format!("{x:.6} {y:.6} {z:.6}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::read::parse;
    use std::path::Path;

    /// Returns a rotation of every joint at every frame, made from sines, so that joints reach all orientations.
    fn rotations(frames: usize) -> Vec<[[f32; 4]; JOINTS]> {
        let frame = |frame: usize| {
            std::array::from_fn(|joint| {
                let wave = |speed: f64| 4.0 * (frame as f64 * speed + joint as f64 * 1.7).sin();
                let turn = DQuat::from_rotation_y(wave(0.11))
                    * DQuat::from_rotation_x(wave(0.07))
                    * DQuat::from_rotation_z(wave(0.05));
                turn.to_array().map(|x| x as f32)
            })
        };
        (0..frames).map(frame).collect()
    }

    /// Returns an animation of a body with bones in all directions.
    fn animation<'a>(
        root: &'a [[f32; 3]],
        local: &'a [[[f32; 4]; JOINTS]],
    ) -> SkeletonAnimation<'a> {
        SkeletonAnimation {
            offsets: Joint::ALL.map(|joint| {
                let j = joint.index() as f32;
                [0.3 * j.sin(), 0.2 * (1.3 * j).cos(), 0.1 * (2.1 * j).sin()]
            }),
            tips: [
                (Joint::Head, [0.0, 0.1, 0.0]),
                (Joint::LeftWrist, [0.1, 0.0, 0.0]),
                (Joint::RightWrist, [-0.1, 0.0, 0.0]),
                (Joint::LeftFoot, [0.0, 0.0, 0.05]),
                (Joint::RightFoot, [0.0, 0.0, 0.05]),
            ],
            root,
            root_path: None,
            local,
            frames_per_second: 20.0,
        }
    }

    /// Computes the positions of the joints by the definition of local rotations.
    fn joints(body: &SkeletonAnimation<'_>, frame: usize) -> [DVec3; JOINTS] {
        let mut places = [(DVec3::ZERO, DQuat::IDENTITY); JOINTS];
        for joint in Joint::ALL {
            let j = joint.index();
            let turn = DQuat::from_array(body.local[frame][j].map(f64::from)).normalize();
            places[j] = match joint.parent() {
                None => (to_vector(body.root[frame]), turn),
                Some(parent) => {
                    let (place, above) = places[parent.index()];
                    (place + above * to_vector(body.offsets[j]), above * turn)
                }
            };
        }
        places.map(|(place, _)| place)
    }

    #[test]
    fn written_motions_read_back_within_a_hundredth_of_a_millimetre() {
        let local = rotations(300);
        let root: Vec<[f32; 3]> = (0..300)
            .map(|frame| [frame as f32 * 0.01, 0.9, -3.0])
            .collect();
        let body = animation(&root, &local);
        for (unit, names) in [
            (Unit::Centimetre, BvhNames::HumanMl3d),
            (Unit::Metre, BvhNames::Mixamo),
        ] {
            let text = body.text(&BvhOptions { unit, names });
            let bvh = parse(&text, Path::new("own.bvh")).unwrap();
            assert_eq!(bvh.clip.frames, 300);
            assert_eq!(bvh.clip.nodes.len(), JOINTS + 5);
            for frame in 0..300 {
                let found = bvh.clip.positions(frame as f64 * 0.05);
                let expected = joints(&body, frame);
                for joint in Joint::ALL {
                    let name = names.name(joint);
                    let mut nodes = bvh.clip.nodes.iter();
                    let node = nodes.position(|node| node.name == name).unwrap();
                    let distance = (found[node] * unit.metres()).distance(expected[joint.index()]);
                    assert!(distance < 1e-5, "{name} at {frame}: {distance} m");
                }
            }
        }
    }

    #[test]
    fn angles_of_a_smooth_motion_never_jump() {
        let local = rotations(2000);
        let root = vec![[0.0; 3]; 2000];
        let text = animation(&root, &local).text(&BvhOptions::default());
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip_while(|line| !line.starts_with("Frame Time"))
            .skip(1)
            .map(|line| line.split(' ').map(|x| x.parse().unwrap()).collect())
            .collect();
        let jumps = rows
            .windows(2)
            .flat_map(|pair| pair[0].iter().zip(&pair[1]))
            .filter(|(a, b)| (*a - *b).abs() > 181.0);
        assert_eq!(jumps.count(), 0);
    }

    #[test]
    fn the_text_is_a_plain_bvh() {
        let local = [[[0.0, 0.0, 0.0, 1.0]; JOINTS]];
        let root = [[0.0, 0.5, -1e-9]];
        let mut body = animation(&root, &local);
        let text = body.text(&BvhOptions::default());
        assert!(
            text.starts_with(
                "HIERARCHY\nROOT pelvis\n{\n\tOFFSET 0.000000 0.000000 0.000000\n\
                 \tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
                 \tJOINT left_hip\n\t{\n\t\tOFFSET "
            ),
            "{text}"
        );
        assert_eq!(text.matches("End Site").count(), 5);
        assert_eq!(text.matches('{').count(), text.matches('}').count());
        assert!(text.contains("MOTION\nFrames: 1\nFrame Time: 0.05\n0.000000 50.000000 0.000000 "));
        let row = text.lines().last().unwrap();
        assert_eq!(row.split(' ').count(), 3 + 3 * JOINTS);
        body.frames_per_second = 30.0;
        let text = body.text(&BvhOptions::default());
        assert!(text.contains("Frame Time: 0.03333333333333333\n"));
    }
}
