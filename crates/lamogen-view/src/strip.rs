//! Stick figures of a motion, side by side.

use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion};
use svg::Document;
use svg::node::element::{Ellipse, Group, Line, Rectangle};

use crate::camera::{Camera, View};
use crate::figure::{Extent, figure};
use crate::text::{LINE, block, line, wrapped};

/// One motion of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// What stands above it.
    pub label: &'a str,
    /// The motion it shows.
    pub motion: &'a Motion,
}

/// Pixels a metre, unless figures are huge.
const SCALE: f32 = 110.0;
/// Least and most width of a figure's place, in metres.
const PLACE: [f32; 2] = [1.25, 2.0];
/// Least height of a row above the ground, and most height of its figures, in metres.
const HEIGHT: [f32; 2] = [1.7, 4.0];
/// Room around the figures, in metres.
const MARGIN: f32 = 0.12;
/// How far the camera looks down, in radians.
const TILT: f32 = 0.12;
/// Radius of the shadow below a figure, in metres.
const SHADOW: f32 = 0.3;

/// Letters of labels and of times, in pixels.
const LABEL: f32 = 17.0;
const TIME: f32 = 12.0;
/// Most lines of a label.
const LABEL_LINES: usize = 2;
/// Pixels left of the labels.
pub(crate) const LEFT: f32 = 12.0;

/// Draws `poses` moments of every motion, evenly spread from its first frame to its last, as an SVG
/// document on white. Time runs to the right; each figure stands in its own place, so that a walk
/// does not leave the picture, but heights are true. All rows share one scale. The camera looks
/// down a little from the motion's front left.
///
/// Of rows of different lengths each is spread over its own length. Labels that are too long for
/// two lines are shortened.
pub fn strip(rows: &[Row<'_>], poses: usize) -> String {
    let Drawing {
        content,
        width,
        height,
    } = draw(rows, poses, 0.0);
    page(width, height).add(content).to_string()
}

/// A white page of that many pixels.
pub(crate) fn page(width: f32, height: f32) -> Document {
    let [width, height] = [width, height].map(|side| side.ceil().max(1.0));
    Document::new()
        .set("viewBox", (0, 0, width, height))
        .set("width", width)
        .set("height", height)
        .set("font-family", "sans-serif")
        .add(
            Rectangle::new()
                .set("width", "100%")
                .set("height", "100%")
                .set("fill", "white"),
        )
}

/// Something drawn, and how many pixels it takes.
pub(crate) struct Drawing {
    pub content: Group,
    pub width: f32,
    pub height: f32,
}

/// What [`strip`] draws, at least so many pixels wide.
pub(crate) fn draw(rows: &[Row<'_>], poses: usize, least_width: f32) -> Drawing {
    let poses = poses.max(1);
    let camera = Camera::new(TILT);
    let shown = |row: &Row<'_>| moments(row.motion.frames(), poses);
    let extent = rows
        .iter()
        .flat_map(|row| shown(row).map(|frame| (row.motion, frame)))
        .map(|(motion, frame)| Extent::of(&motion.joints()[frame], &camera, below(motion, frame)))
        .fold(Extent::NONE, Extent::and);
    let [least, most] = HEIGHT;
    let (top, bottom) = (extent.top.max(least), (-extent.bottom).max(0.0));
    let scale = SCALE * (most / (top + bottom)).min(1.0);
    // Places are as wide as the widest figure, and figures reach to both sides.
    let reach = extent.right.max(-extent.left);
    let place = (2.0 * reach + MARGIN).clamp(PLACE[0], PLACE[1]) * SCALE;
    let place = place.max(least_width / poses as f32);
    let above_ground = (top + MARGIN) * scale;
    let below_ground = (bottom + MARGIN) * scale;

    let width = poses as f32 * place;
    let mut height = 0.0;
    let mut content = Group::new();
    for row in rows {
        let label = wrapped(row.label, LABEL, width - 2.0 * LEFT, LABEL_LINES);
        let ground = height + 0.6 * LABEL + label.len() as f32 * LABEL * LINE + above_ground;
        content = content
            .add(block(
                &label,
                [LEFT, height + 1.4 * LABEL],
                LABEL,
                "#111827",
            ))
            .add(
                Line::new()
                    .set("x1", 0)
                    .set("x2", width)
                    .set("y1", ground)
                    .set("y2", ground)
                    .set("stroke", "#d1d5db"),
            );
        let times = ground + below_ground + TIME;
        let middles = (0..poses).map(|pose| (pose as f32 + 0.5) * place);
        for (frame, middle) in shown(row).zip(middles.clone()) {
            let view = View {
                camera,
                middle: below(row.motion, frame),
                origin: [middle, ground],
                scale,
            };
            let seconds = frame as f32 / FRAMES_PER_SECOND;
            let time = line(&format!("{seconds:.2} s"), [middle, times], TIME, "#6b7280");
            content = content
                .add(time.set("text-anchor", "middle"))
                .add(blot(&view))
                .add(figure(&row.motion.joints()[frame], &view));
        }
        height = times + 1.2 * TIME;
    }
    Drawing {
        content,
        width,
        height,
    }
}

/// The frames that are shown of so many.
fn moments(frames: usize, poses: usize) -> impl Iterator<Item = usize> {
    let last = frames - 1;
    (0..poses).map(move |pose| match poses {
        1 => last / 2,
        poses => (pose * last + (poses - 1) / 2) / (poses - 1),
    })
}

/// The point of the ground below the pelvis.
fn below(motion: &Motion, frame: usize) -> [f32; 2] {
    let [x, _, z] = motion.position(frame, Joint::Pelvis);
    [x, z]
}

/// The shadow of a figure at noon, which shows how high above the ground it is.
fn blot(view: &View) -> Ellipse {
    let [x, y] = view.origin;
    Ellipse::new()
        .set("cx", x)
        .set("cy", y)
        .set("rx", SHADOW * view.scale)
        .set("ry", SHADOW * view.camera.flatness() * view.scale)
        .set("fill", "#e5e7eb")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::PARTS;
    use lamogen_motion::JOINTS;

    fn still(position: [f32; 3], frames: usize) -> Motion {
        Motion::from_joints(vec![[position; JOINTS]; frames]).unwrap()
    }

    fn size(svg: &str) -> (f32, f32) {
        let number = |name: &str| {
            let (_, after) = svg.split_once(&format!(" {name}=\"")).unwrap();
            after.split('"').next().unwrap().parse().unwrap()
        };
        (number("width"), number("height"))
    }

    #[test]
    fn every_pose_has_its_parts_a_head_and_a_time() {
        let motion = still([0.1, 0.9, 0.2], 30);
        let rows = [Row {
            label: "a <b>",
            motion: &motion,
        }; 2];
        let svg = strip(&rows, 7);
        assert_eq!(svg.matches("<path").count(), 2 * 7 * PARTS);
        assert_eq!(svg.matches("<circle").count(), 2 * 7);
        assert_eq!(svg.matches(" s\n").count(), 2 * 7, "{svg}");
        assert!(
            svg.contains("1.45 s") && svg.contains("a &lt;b&gt;"),
            "{svg}"
        );
    }

    #[test]
    fn one_frame_and_one_pose_are_enough() {
        let motion = still([0.0; 3], 1);
        let rows = [Row {
            label: "",
            motion: &motion,
        }];
        for poses in [0, 1, 4] {
            assert!(strip(&rows, poses).contains("<path"));
        }
        assert!(strip(&[], 4).contains("<svg"));
    }

    #[test]
    fn a_motion_far_away_takes_no_more_room() {
        let size = |z: f32| {
            let motion = still([0.1, 0.9, z], 30);
            let row = Row {
                label: "",
                motion: &motion,
            };
            size(&strip(&[row], 3))
        };
        assert_eq!(size(0.0), size(-10.0));
    }

    #[test]
    fn the_highest_joint_of_a_shown_pose_lies_within_its_row() {
        let jump = |height: f32| {
            let mut joints = vec![[[0.0, 1.0, 0.0]; JOINTS]; 3];
            joints[1][Joint::LeftWrist.index()][1] = height;
            let motion = Motion::from_joints(joints).unwrap();
            let row = Row {
                label: "",
                motion: &motion,
            };
            size(&strip(&[row], 3)).1
        };
        assert!(jump(3.0) > jump(1.5) + 1.2 * SCALE);
        // A broken motion is drawn small instead of in a picture without end.
        assert!(jump(1e6) < 6.0 * SCALE && jump(f32::MAX) < 6.0 * SCALE);
    }

    #[test]
    fn the_same_motions_give_the_same_picture() {
        let motion = still([0.0, 1.0, 0.0], 2);
        let row = Row {
            label: "a",
            motion: &motion,
        };
        assert_eq!(strip(&[row; 2], 3), strip(&[row; 2], 3));
    }

    #[test]
    fn long_labels_take_two_lines_and_no_more() {
        let motion = still([0.0, 1.0, 0.0], 2);
        let height = |label: &str| {
            let row = Row {
                label,
                motion: &motion,
            };
            size(&strip(&[row], 3)).1
        };
        let words = |count| "jump ".repeat(count);
        assert!(height(&words(20)) > height(&words(2)));
        assert_eq!(height(&words(20)), height(&words(100)));
    }
}
