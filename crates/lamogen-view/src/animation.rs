//! Motions side by side that move: the layout of an animation and its frames as SVG documents.

use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Motion, TimedCaption};
use svg::node::element::{Ellipse, Group};

use crate::camera::{Camera, CameraView};
use crate::camera_path::camera_path;
use crate::captions::CAPTION_LINES;
use crate::copyright::copyright_of;
use crate::figure::{Extent, shadow, stick_figure};
use crate::ground::ground_grid;
use crate::strip::{LabelledMotion, blank_page};
use crate::text::{LINE_HEIGHT, text_block, text_line, wrap};

/// The default width of each motion, in pixels.
const DEFAULT_WIDTH: u32 = 320;
/// The least width of each motion, in pixels.
const MIN_WIDTH: u32 = 80;
/// The largest width of all motions together, in pixels.
const MAX_WIDTH: u32 = 4096;
/// The angle by which the camera looks down, in radians.
const TILT: f32 = 0.24;
/// The least visible size of the world, in metres: its width, and its height above the ground.
const MIN_VISIBLE: [f32; 2] = [2.0, 1.9];
/// The largest height of a motion's panel, relative to the panel's width.
const MAX_ASPECT: f32 = 1.6;
/// The margin around the movement, in metres.
const MARGIN: f32 = 0.1;
/// The size of the letters of labels: relative to the width of a panel, and the largest size in pixels.
const LABEL: (f32, f32) = (0.05, 16.0);
/// The size of the letters of times: relative to the width of a panel, and the largest size in pixels.
const TIME: (f32, f32) = (0.04, 12.0);
/// The most lines of a label.
const LABEL_LINES: usize = 3;

/// The panel of one motion, and the path of its camera.
struct MotionPanel<'a> {
    row: LabelledMotion<'a>,
    /// The point of the ground that the camera looks at in every frame, `[x, z]`.
    targets: Vec<[f32; 2]>,
    /// The position of this point in the picture, in pixels.
    origin: [f32; 2],
}

impl MotionPanel<'_> {
    /// Returns the frame of the motion that is shown at a frame of the animation: the last one after the motion's end.
    fn motion_frame(&self, frame: usize) -> usize {
        frame.min(self.row.motion.frames() - 1)
    }
}

/// The error of an animation that cannot be drawn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AnimationError {
    /// There is no motion.
    #[error("expected at least one motion to animate, found none")]
    Empty,
    /// The width is out of range.
    #[error(
        "expected a width of {least} to {MAX_WIDTH} pixels for {motions} motions, found {width}"
    )]
    #[allow(missing_docs)]
    Width {
        least: u32,
        motions: usize,
        width: u32,
    },
}

/// Motions side by side, 20 frames per second. A motion that is shorter than the longest one stays in its last pose.
///
/// All motions have the same scale and are viewed from the front left. The camera stands still for movements in place and
/// follows a walk, over a ground with squares of half a metre. Below it stands the caption of the moment, if the motion has
/// captions.
///
/// The frames are SVG documents, to be drawn in pixels by `lamogen-raster` or another renderer: each is the
/// [backdrop](Animation::backdrop) and on top of it what [moves](Animation::frame).
pub struct Animation<'a> {
    panels: Vec<MotionPanel<'a>>,
    /// The lines of the label of each panel.
    labels: Vec<Vec<String>>,
    /// The lines of the captions of each panel.
    captions: Vec<Vec<Vec<String>>>,
    camera: Camera,
    /// The width of one panel in pixels.
    panel_width: f32,
    /// The height of the picture in pixels.
    height: f32,
    /// Pixels per metre.
    scale: f32,
    /// The radius of the ground in metres.
    radius: f32,
}

impl<'a> Animation<'a> {
    /// Computes the layout of motions that are `width` pixels wide together. By default it is 320 pixels for each motion, but
    /// at most 4096 in all. The height follows from the width and from the movements.
    ///
    /// # Errors
    ///
    /// If there is no motion, or the width is less than 80 pixels for each motion or more than 4096.
    pub fn new(
        rows: &[LabelledMotion<'a>],
        width: Option<u32>,
    ) -> Result<Animation<'a>, AnimationError> {
        if rows.is_empty() {
            return Err(AnimationError::Empty);
        }
        let motions = rows.len();
        let count = u32::try_from(motions).unwrap_or(u32::MAX);
        let least = count.saturating_mul(MIN_WIDTH);
        let default = count.saturating_mul(DEFAULT_WIDTH).min(MAX_WIDTH);
        let width = width.unwrap_or(default);
        if width < least || width > MAX_WIDTH {
            return Err(AnimationError::Width {
                least,
                motions,
                width,
            });
        }
        let panel_width = width as f32 / motions as f32;

        let camera = Camera::new(TILT);
        let targets = rows
            .iter()
            .map(|row| centred_camera_path(row.motion, &camera));
        let targets: Vec<_> = targets.collect();
        let poses = |index: usize| rows[index].motion.joints().iter().zip(&targets[index]);
        let poses = (0..motions).flat_map(poses);
        let extents = poses
            .clone()
            .map(|(pose, target)| Extent::of_pose(pose, &camera, *target));
        let extent = extents.fold(Extent::EMPTY, Extent::union);
        // The ground must be large enough for all shadows.
        let largest_distance = |(pose, target): (&[[f32; 3]; JOINTS], &[f32; 2])| {
            let distance = |[x, _, z]: [f32; 3]| (x - target[0]).hypot(z - target[1]);
            pose.iter().copied().map(distance).fold(0.0, f32::max)
        };
        let radius = poses
            .map(largest_distance)
            .fold(MIN_VISIBLE[0] / 2.0, f32::max)
            .min(1e4);
        let visible_width = (2.0 * radius).max(extent.right - extent.left) + 2.0 * MARGIN;
        let bottom = (radius * camera.foreshortening()).max(-extent.bottom) + MARGIN;
        let visible_height = extent.top.max(MIN_VISIBLE[1]) + MARGIN + bottom;
        let scale = (panel_width / visible_width).min(panel_width * MAX_ASPECT / visible_height);

        let label = font_size(LABEL, panel_width);
        let labels = rows.iter();
        let labels: Vec<_> = labels
            .map(|row| wrap(row.label, label, panel_width - 2.0 * label, LABEL_LINES))
            .collect();
        let lines = labels.iter().map(Vec::len).max().unwrap_or(0);
        let above = 0.6 * label + lines as f32 * label * LINE_HEIGHT;
        let ground = above + (visible_height - bottom) * scale;
        let captions: Vec<Vec<Vec<String>>> = { rows.iter() }
            .map(|row| {
                let texts = row.captions.iter().map(|caption| &caption.text);
                texts
                    .map(|text| wrap(text, label, panel_width - 2.0 * label, CAPTION_LINES))
                    .collect()
            })
            .collect();
        let caption_lines = captions.iter().flatten().map(Vec::len).max().unwrap_or(0);
        let below = caption_lines as f32 * label * LINE_HEIGHT;
        let panels = rows.iter().zip(targets).enumerate();
        let panels = panels.map(|(index, (row, targets))| MotionPanel {
            row: *row,
            targets,
            origin: [(index as f32 + 0.5) * panel_width, ground],
        });
        Ok(Animation {
            panels: panels.collect(),
            labels,
            captions,
            camera,
            panel_width,
            height: ground + bottom * scale + below + 2.0 * font_size(TIME, panel_width),
            scale,
            radius,
        })
    }

    /// Returns the number of frames, which is that of the longest motion.
    pub fn frames(&self) -> usize {
        let frames = self.panels.iter().map(|panel| panel.row.motion.frames());
        frames.max().unwrap_or(0)
    }

    /// Returns the terms under which the motions may be used, if there are any.
    pub fn copyright(&self) -> Option<String> {
        copyright_of(self.panels.iter().map(|panel| panel.row.motion))
    }

    /// Draws the parts that are the same in every frame as an SVG document.
    pub fn backdrop(&self) -> String {
        let label = font_size(LABEL, self.panel_width);
        let labels = self.labels.iter().enumerate();
        let labels = labels.fold(Group::new(), |group, (index, lines)| {
            let left = index as f32 * self.panel_width + label;
            group.add(text_block(lines, [left, 1.5 * label], label, "#111827"))
        });
        let width = (self.panel_width * self.panels.len() as f32).round();
        let page = blank_page(width, self.height);
        let page = self.panels.iter().fold(page, |page, panel| {
            let [x, y] = panel.origin;
            page.add(
                Ellipse::new()
                    .set("cx", x)
                    .set("cy", y)
                    .set("rx", self.radius * self.scale)
                    .set(
                        "ry",
                        self.radius * self.camera.foreshortening() * self.scale,
                    )
                    .set("fill", "#f3f4f6"),
            )
        });
        page.add(labels).to_string()
    }

    /// Draws the parts of a frame that are on top of the backdrop as an SVG document. After the last frame, motions stay in
    /// their last pose.
    pub fn frame(&self, frame: usize) -> String {
        let size = font_size(TIME, self.panel_width);
        let width = self.panel_width * self.panels.len() as f32;
        let document = svg::Document::new()
            .set("width", width)
            .set("height", self.height)
            .set("font-family", "sans-serif");
        let panels = self.panels.iter().enumerate();
        let document = panels.fold(document, |document, (index, panel)| {
            let motion_frame = panel.motion_frame(frame);
            let pose = &panel.row.motion.joints()[motion_frame];
            let view = CameraView {
                camera: self.camera,
                target: panel.targets[motion_frame],
                origin: panel.origin,
                scale: self.scale,
            };
            let seconds = motion_frame as f32 / FRAMES_PER_SECOND;
            let position = [
                (index as f32 + 0.5) * self.panel_width,
                self.height - 0.8 * size,
            ];
            let time = text_line(&format!("{seconds:.2} s"), position, size, "#6b7280");
            let label = font_size(LABEL, self.panel_width);
            let lines = match TimedCaption::position(panel.row.captions, motion_frame) {
                Some(caption) => &self.captions[index][caption][..],
                None => &[],
            };
            // The last line stands above the time.
            let lines_below = lines.len().saturating_sub(1) as f32;
            let first = position[1] - 1.2 * size - lines_below * label * LINE_HEIGHT;
            let caption = text_block(lines, [position[0], first], label, "#111827");
            document
                .add(ground_grid(&view, self.radius))
                .add(shadow(pose, &view, "#d1d5db"))
                .add(stick_figure(pose, &view))
                .add(caption.set("text-anchor", "middle"))
                .add(time.set("text-anchor", "middle"))
        });
        document.to_string()
    }
}

/// Returns the point of the ground that the camera looks at in every frame. The camera follows the motion, and the whole
/// motion is centred in the picture.
fn centred_camera_path(motion: &Motion, camera: &Camera) -> Vec<[f32; 2]> {
    let targets = camera_path(motion);
    let poses = motion.joints().iter().zip(&targets);
    let projected =
        poses.flat_map(|(pose, target)| pose.map(|[x, _, z]| camera.project([x, 0.0, z], *target)));
    let (mut least, mut most) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for point in projected {
        let point = [point.right, -point.up / camera.foreshortening()];
        for axis in 0..2 {
            least[axis] = least[axis].min(point[axis]);
            most[axis] = most[axis].max(point[axis]);
        }
    }
    let [right, nearer] = [0, 1].map(|axis| (least[axis] + most[axis]) / 2.0);
    targets
        .iter()
        .map(|target| camera.move_target(*target, right, nearer))
        .collect()
}

/// Returns the size of letters in a panel of a width.
fn font_size((relative, largest): (f32, f32), panel_width: f32) -> f32 {
    (relative * panel_width).min(largest)
}
