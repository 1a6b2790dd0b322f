//! Strips: stick figures of motions side by side.

use lamogen_motion::{FRAMES_PER_SECOND, Joint, Motion, TimedCaption};
use svg::Document;
use svg::node::element::{Ellipse, Group, Line, Rectangle};

use crate::camera::{Camera, CameraView};
use crate::captions::{captions_height, draw_captions};
use crate::copyright::{copyright_of, metadata};
use crate::figure::{Extent, stick_figure};
use crate::text::{LINE_HEIGHT, text_block, text_line, wrap};

/// A motion of a picture, with its label.
#[derive(Clone, Copy, Debug)]
pub struct LabelledMotion<'a> {
    /// The label above the motion.
    pub label: &'a str,
    /// The motion to draw.
    pub motion: &'a Motion,
    /// What is said beside the motion, and when, in the order of time. It may be empty.
    pub captions: &'a [TimedCaption],
}

impl<'a> LabelledMotion<'a> {
    /// Creates a motion with a label and without captions.
    pub fn new(label: &'a str, motion: &'a Motion) -> Self {
        LabelledMotion {
            label,
            motion,
            captions: &[],
        }
    }
}

/// Pixels per metre, unless figures are very large.
const SCALE: f32 = 110.0;
/// The least and the largest width of the column of one figure, in metres.
const COLUMN_WIDTH: [f32; 2] = [1.25, 2.0];
/// The least height of a row above the ground, and the largest height of its figures, in metres.
const HEIGHT: [f32; 2] = [1.7, 4.0];
/// The margin around the figures in metres.
const MARGIN: f32 = 0.12;
/// The angle by which the camera looks down, in radians.
const TILT: f32 = 0.12;
/// The radius of the shadow below a figure, in metres.
const SHADOW: f32 = 0.3;

/// The size of the letters of labels, in pixels.
const LABEL: f32 = 17.0;
/// The size of the letters of times, in pixels.
const TIME: f32 = 12.0;
/// The size of the letters of captions, in pixels.
const CAPTION: f32 = 14.0;
/// The most lines of a label.
const LABEL_LINES: usize = 2;
/// The distance of labels from the left edge, in pixels.
pub(crate) const LABEL_LEFT: f32 = 12.0;

/// Draws `poses` frames of every motion, evenly spaced from the first frame to the last one, as an SVG document on white.
///
/// Time runs to the right. Each figure has its own column, so that a walk does not leave the picture, but heights above
/// the ground are kept. All rows have the same scale. The camera looks down a little from the front left.
///
/// If motions have different lengths, each of them is spread over its own length. Labels that are too long for two lines
/// are shortened. Captions are below the times, each as long as its frames; those too narrow for words are a bar alone.
pub fn strip(rows: &[LabelledMotion<'_>], poses: usize) -> String {
    let StripDrawing {
        content,
        width,
        height,
    } = draw_strip(rows, poses, 0.0);
    let page = blank_page(width, height).add(content);
    with_copyright(page, rows).to_string()
}

/// Adds the terms under which the motions may be used to a document.
pub(crate) fn with_copyright(page: Document, rows: &[LabelledMotion<'_>]) -> Document {
    match copyright_of(rows.iter().map(|row| row.motion)) {
        Some(copyright) => page.add(metadata(&copyright)),
        None => page,
    }
}

/// Creates a white SVG document of a size in pixels.
pub(crate) fn blank_page(width: f32, height: f32) -> Document {
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

/// The drawing of a strip, and its size in pixels.
pub(crate) struct StripDrawing {
    pub content: Group,
    pub width: f32,
    pub height: f32,
}

/// Draws the content of a [`strip`] that is at least `min_width` pixels wide.
pub(crate) fn draw_strip(
    rows: &[LabelledMotion<'_>],
    poses: usize,
    min_width: f32,
) -> StripDrawing {
    let poses = poses.max(1);
    let camera = Camera::new(TILT);
    let shown_frames = |row: &LabelledMotion<'_>| evenly_spaced_frames(row.motion.frames(), poses);
    let extent = rows
        .iter()
        .flat_map(|row| shown_frames(row).map(|frame| (row.motion, frame)))
        .map(|(motion, frame)| {
            Extent::of_pose(
                &motion.joints()[frame],
                &camera,
                ground_below_pelvis(motion, frame),
            )
        })
        .fold(Extent::EMPTY, Extent::union);
    let [least, most] = HEIGHT;
    let (top, bottom) = (extent.top.max(least), (-extent.bottom).max(0.0));
    let scale = SCALE * (most / (top + bottom)).min(1.0);
    // Columns are as wide as the widest figure, which is centred by its larger reach to the left or right.
    let reach = extent.right.max(-extent.left);
    let column = (2.0 * reach + MARGIN).clamp(COLUMN_WIDTH[0], COLUMN_WIDTH[1]) * SCALE;
    let column = column.max(min_width / poses as f32);
    let above_ground = (top + MARGIN) * scale;
    let below_ground = (bottom + MARGIN) * scale;

    let width = poses as f32 * column;
    let mut height = 0.0;
    let mut content = Group::new();
    for row in rows {
        let label = wrap(row.label, LABEL, width - 2.0 * LABEL_LEFT, LABEL_LINES);
        let ground = height + 0.6 * LABEL + label.len() as f32 * LABEL * LINE_HEIGHT + above_ground;
        content = content
            .add(text_block(
                &label,
                [LABEL_LEFT, height + 1.4 * LABEL],
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
        let middles = (0..poses).map(|pose| (pose as f32 + 0.5) * column);
        for (frame, middle) in shown_frames(row).zip(middles.clone()) {
            let view = CameraView {
                camera,
                target: ground_below_pelvis(row.motion, frame),
                origin: [middle, ground],
                scale,
            };
            let seconds = frame as f32 / FRAMES_PER_SECOND;
            let time = text_line(&format!("{seconds:.2} s"), [middle, times], TIME, "#6b7280");
            content = content
                .add(time.set("text-anchor", "middle"))
                .add(noon_shadow(&view))
                .add(stick_figure(&row.motion.joints()[frame], &view));
        }
        height = times + 1.2 * TIME;
        if !row.captions.is_empty() {
            // A frame is where a figure of it would be; the first and the last figure are in the middle of their columns.
            let last = (row.motion.frames() - 1).max(1) as f32;
            let place = |frame: f32| match poses {
                1 => width * frame / row.motion.frames() as f32,
                _ => column * (0.5 + frame * (poses - 1) as f32 / last),
            };
            content = content.add(draw_captions(
                (row.captions, row.motion.frames()),
                place,
                height,
                CAPTION,
            ));
            height += captions_height(row.captions, CAPTION);
        }
    }
    StripDrawing {
        content,
        width,
        height,
    }
}

/// Returns `poses` frames, evenly spaced from the first to the last one; a single one is in the middle.
fn evenly_spaced_frames(frames: usize, poses: usize) -> impl Iterator<Item = usize> {
    let last = frames - 1;
    (0..poses).map(move |pose| match poses {
        1 => last / 2,
        poses => (pose * last + (poses - 1) / 2) / (poses - 1),
    })
}

/// Returns the point of the ground below the pelvis, `[x, z]`.
fn ground_below_pelvis(motion: &Motion, frame: usize) -> [f32; 2] {
    let [x, _, z] = motion.position(frame, Joint::Pelvis);
    [x, z]
}

/// Draws a round shadow on the ground below a figure. Its distance from the figure shows the figure's height above the
/// ground.
fn noon_shadow(view: &CameraView) -> Ellipse {
    let [x, y] = view.origin;
    Ellipse::new()
        .set("cx", x)
        .set("cy", y)
        .set("rx", SHADOW * view.scale)
        .set("ry", SHADOW * view.camera.foreshortening() * view.scale)
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
        let rows = [LabelledMotion::new("a <b>", &motion); 2];
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
        let rows = [LabelledMotion::new("", &motion)];
        for poses in [0, 1, 4] {
            assert!(strip(&rows, poses).contains("<path"));
        }
        assert!(strip(&[], 4).contains("<svg"));
    }

    #[test]
    fn a_motion_far_away_takes_no_more_space() {
        let size = |z: f32| {
            let motion = still([0.1, 0.9, z], 30);
            let row = LabelledMotion::new("", &motion);
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
            let row = LabelledMotion::new("", &motion);
            size(&strip(&[row], 3)).1
        };
        assert!(jump(3.0) > jump(1.5) + 1.2 * SCALE);
        // A damaged motion is drawn small, and the picture does not become very large.
        assert!(jump(1e6) < 6.0 * SCALE && jump(f32::MAX) < 6.0 * SCALE);
    }

    #[test]
    fn the_same_motions_give_the_same_picture() {
        let motion = still([0.0, 1.0, 0.0], 2);
        let row = LabelledMotion::new("a", &motion);
        assert_eq!(strip(&[row; 2], 3), strip(&[row; 2], 3));
    }

    #[test]
    fn captions_stand_below_the_figures_of_their_frames() {
        let motion = still([0.0, 1.0, 0.0], 41);
        let caption = TimedCaption::new;
        let captions = [caption("stands", 0..20), caption("stands on", 20..41)];
        let with = strip(
            &[LabelledMotion {
                captions: &captions,
                ..LabelledMotion::new("", &motion)
            }],
            5,
        );
        let without = strip(&[LabelledMotion::new("", &motion)], 5);
        let ((width, height), before) = (size(&with), size(&without));
        assert!(width == before.0 && height > before.1 + 20.0);
        // The second begins below the third of five figures, which is frame 20.
        let (bar, _) = with.split_once("stands on").unwrap();
        let (_, bar) = bar.rsplit_once(" x1=\"").unwrap();
        let left: f32 = bar.split('"').next().unwrap().parse().unwrap();
        assert!((left - width / 2.0).abs() < 1.0, "{left} {width}");
    }

    #[test]
    fn long_labels_take_two_lines_and_no_more() {
        let motion = still([0.0, 1.0, 0.0], 2);
        let height = |label: &str| {
            let row = LabelledMotion::new(label, &motion);
            size(&strip(&[row], 3)).1
        };
        let words = |count| "jump ".repeat(count);
        assert!(height(&words(20)) > height(&words(2)));
        assert_eq!(height(&words(20)), height(&words(100)));
    }
}
