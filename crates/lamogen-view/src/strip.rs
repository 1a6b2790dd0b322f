//! Stick figures of a motion, side by side.

use std::f32::consts::FRAC_PI_6;

use lamogen_motion::{CHAINS, FRAMES_PER_SECOND, Joint, Motion};
use svg::Document;
use svg::node::element::{Circle, Line, Polyline, Rectangle, Text};

use crate::printable;

/// One line of a strip.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// What stands before it.
    pub label: &'a str,
    /// The motion it shows.
    pub motion: &'a Motion,
}

/// Pixels a metre.
const SCALE: f32 = 110.0;
/// Width of a figure's place, in metres.
const PLACE: f32 = 1.25;
/// Room above and below the figures, in metres.
const MARGIN: f32 = 0.18;
/// Pixels for the label above and the times below each row.
const LABEL: f32 = 30.0;
const TIMES: f32 = 22.0;

/// Colours of the five chains: right leg, left leg, spine, right arm, left arm. The right side is
/// warm, the left cold.
const COLOURS: [&str; CHAINS.len()] = ["#c2410c", "#0369a1", "#374151", "#ea580c", "#0284c7"];

/// Draws `poses` moments of every motion, evenly spread from its first frame to its last, as an SVG
/// document. Time runs to the right; each figure stands in its own place, so that a walk does not
/// leave the picture, but heights are true. All rows share one scale. The camera looks down a little
/// from the motion's front left.
///
/// Of rows of different lengths each is spread over its own length.
pub fn strip(rows: &[Row<'_>], poses: usize) -> String {
    let poses = poses.max(1);
    let pelvis = Joint::Pelvis.index();
    let points = rows.iter().flat_map(|row| row.motion.joints());
    let points = points.flat_map(|pose| pose.map(|point| (point, pose[pelvis])));
    let top = points
        .map(|(point, root)| project(point, root)[1])
        .fold(1.6, f32::max)
        + MARGIN;
    let height = LABEL + (top + MARGIN) * SCALE + TIMES;
    let width = poses as f32 * PLACE * SCALE;
    let total = rows.len() as f32 * height;
    let mut document = Document::new()
        .set("viewBox", (0, 0, width.ceil() as i32, total.ceil() as i32))
        .set("width", width.ceil())
        .set("height", total.ceil())
        .set("font-family", "sans-serif")
        .add(
            Rectangle::new()
                .set("width", "100%")
                .set("height", "100%")
                .set("fill", "white"),
        );
    for (index, row) in rows.iter().enumerate() {
        let above = index as f32 * height;
        let ground = above + LABEL + top * SCALE;
        document = document
            .add(
                Line::new()
                    .set("x1", 0)
                    .set("x2", width)
                    .set("y1", ground)
                    .set("y2", ground)
                    .set("stroke", "#d1d5db"),
            )
            .add(label(row.label, 12.0, above + 22.0, 17.0, "#111827"));
        for pose in 0..poses {
            let last = row.motion.frames() - 1;
            let frame = match poses {
                1 => last / 2,
                poses => (pose * last + (poses - 1) / 2) / (poses - 1),
            };
            let middle = (pose as f32 + 0.5) * PLACE * SCALE;
            let seconds = frame as f32 / FRAMES_PER_SECOND;
            document = figure(document, row.motion, frame, [middle, ground]).add(label(
                &format!("{seconds:.2} s"),
                middle - 18.0,
                ground + MARGIN * SCALE + 14.0,
                12.0,
                "#6b7280",
            ));
        }
    }
    document.to_string()
}

/// One pose, its pelvis above `[x, y]` on the ground.
fn figure(mut document: Document, motion: &Motion, frame: usize, [x, y]: [f32; 2]) -> Document {
    let root = motion.position(frame, Joint::Pelvis);
    let place = |joint: Joint| {
        let [right, up] = project(motion.position(frame, joint), root);
        [x + right * SCALE, y - up * SCALE]
    };
    for (chain, colour) in CHAINS.iter().zip(COLOURS) {
        let points: Vec<String> = chain
            .iter()
            .map(|&joint| {
                let [x, y] = place(joint);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        document = document.add(
            Polyline::new()
                .set("points", points.join(" "))
                .set("fill", "none")
                .set("stroke", colour)
                .set("stroke-width", 4)
                .set("stroke-linecap", "round")
                .set("stroke-linejoin", "round"),
        );
    }
    let [x, y] = place(Joint::Head);
    document.add(
        Circle::new()
            .set("cx", format!("{x:.1}"))
            .set("cy", format!("{y:.1}"))
            .set("r", 0.09 * SCALE)
            .set("fill", COLOURS[2]),
    )
}

/// A point in metres on the picture's plane, right and up, seen from the front left. The ground
/// below `root` is the origin.
fn project([x, y, z]: [f32; 3], root: [f32; 3]) -> [f32; 2] {
    let (x, z) = (x - root[0], z - root[2]);
    let (turn_sin, turn_cos) = FRAC_PI_6.sin_cos();
    let (tilt_sin, tilt_cos) = 0.12f32.sin_cos();
    let (right, towards) = (x * turn_cos + z * turn_sin, z * turn_cos - x * turn_sin);
    [right, y * tilt_cos - towards * tilt_sin]
}

fn label(text: &str, x: f32, y: f32, size: f32, colour: &str) -> Text {
    Text::new(printable(text))
        .set("x", x)
        .set("y", y)
        .set("font-size", size)
        .set("fill", colour)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamogen_motion::JOINTS;

    #[test]
    fn every_pose_has_five_chains_and_a_head() {
        let motion = Motion::from_joints(vec![[[0.1, 0.9, 0.2]; JOINTS]; 30]).unwrap();
        let rows = [Row {
            label: "a <b>",
            motion: &motion,
        }; 2];
        let svg = strip(&rows, 7);
        assert_eq!(svg.matches("<polyline").count(), 2 * 7 * 5);
        assert_eq!(svg.matches("<circle").count(), 2 * 7);
        assert!(
            svg.contains("1.45 s") && svg.contains("a &lt;b&gt;"),
            "{svg}"
        );
    }

    #[test]
    fn one_frame_and_one_pose_are_enough() {
        let motion = Motion::from_joints(vec![[[0.0; 3]; JOINTS]]).unwrap();
        let rows = [Row {
            label: "",
            motion: &motion,
        }];
        assert!(strip(&rows, 1).contains("<polyline"));
        assert!(strip(&rows, 0).contains("<polyline"));
        assert!(strip(&rows, 4).contains("<polyline"));
    }

    #[test]
    fn a_motion_far_away_takes_no_more_room() {
        let size = |z: f32| {
            let motion = Motion::from_joints(vec![[[0.1, 0.9, z]; JOINTS]; 30]).unwrap();
            let label = "";
            let svg = strip(
                &[Row {
                    label,
                    motion: &motion,
                }],
                3,
            );
            svg.split("height=\"")
                .nth(1)
                .unwrap()
                .split('"')
                .next()
                .unwrap()
                .to_owned()
        };
        assert_eq!(size(0.0), size(-10.0));
    }
}
