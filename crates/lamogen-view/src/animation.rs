//! Motions side by side as an animated GIF.

use std::borrow::Cow;

use gif::{DisposalMethod, Encoder, Frame, Repeat};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Motion};
use resvg::tiny_skia::Pixmap;
use svg::node::element::{Ellipse, Group};

use crate::camera::{Camera, View};
use crate::figure::{Extent, figure, shadow};
use crate::follow::follow;
use crate::fonts::Missing;
use crate::ground::grid;
use crate::palette::Palette;
use crate::raster::{RasterError, render, render_onto};
use crate::strip::{Row, page};
use crate::text::{LINE, block, line, wrapped};

/// How an animation is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GifOptions {
    /// Width in pixels of all motions together; if there is none, 320 for each motion. The height
    /// follows from it and from the movements.
    pub width: Option<u32>,
}

/// An animation that cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GifError {
    /// Nothing to show.
    #[error("expected at least one motion to animate, found none")]
    Empty,
    /// A width that makes no sense.
    #[error(
        "expected a width of {least} to {MOST_WIDTH} pixels for {motions} motions, found {width}"
    )]
    #[allow(missing_docs)]
    Width {
        least: u32,
        motions: usize,
        width: u32,
    },
    /// A frame that cannot be drawn.
    #[error("frame {frame}: {error}")]
    #[allow(missing_docs)]
    Frame { frame: usize, error: RasterError },
    /// The encoder's own words.
    #[error("the animation could not be encoded as GIF: {0}")]
    Encoding(#[from] gif::EncodingError),
}

/// Pixels for each motion: usual, and least.
const WIDTH: u32 = 320;
const LEAST_WIDTH: u32 = 80;
/// Most pixels of all motions together.
const MOST_WIDTH: u32 = 4096;
/// Hundredths of a second that a frame is shown.
const DELAY: u16 = (100.0 / FRAMES_PER_SECOND) as u16;
/// How far the camera looks down, in radians.
const TILT: f32 = 0.24;
/// Least that is seen of the world, in metres: width, and height above the ground.
const LEAST_SEEN: [f32; 2] = [2.0, 1.9];
/// Most height of a motion's place beside its width.
const TALLEST: f32 = 1.6;
/// Room around the movement, in metres.
const MARGIN: f32 = 0.1;
/// Letters of labels and times beside a place's width, and at most, in pixels.
const LABEL: (f32, f32) = (0.05, 16.0);
const TIME: (f32, f32) = (0.04, 12.0);
/// Most lines of a label.
const LABEL_LINES: usize = 3;

/// Draws motions side by side as an animated GIF that runs at true speed, 20 frames a second, and
/// begins again at its end. A motion that is shorter than the longest stays in its last pose.
///
/// All motions are seen in one scale from the front left. The camera stands still for movements in
/// place and goes along with a walk, over a ground of squares of half a metre. `progress` is told
/// after every frame how many are done, and of how many. The same motions give the same bytes.
///
/// # Errors
///
/// If there is no motion, or the width is less than 80 pixels for each motion or more than 4096.
pub fn gif(
    rows: &[Row<'_>],
    options: &GifOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<u8>, GifError> {
    let scene = Scene::new(rows, options)?;
    let failed = |frame| move |error| GifError::Frame { frame, error };
    let backdrop = render(&scene.backdrop(), 1.0, Missing::FromSystem).map_err(failed(0))?;
    let (width, height) = (backdrop.width() as u16, backdrop.height() as u16);

    let mut palette = Palette::new();
    let mut encoder = Encoder::new(Vec::new(), width, height, palette.bytes())?;
    encoder.set_repeat(Repeat::Infinite)?;
    let frames = rows
        .iter()
        .map(|row| row.motion.frames())
        .max()
        .unwrap_or(0);
    let mut before = Vec::new();
    for frame in 0..frames {
        let mut pixels = backdrop.clone();
        render_onto(&mut pixels, &scene.frame(frame)).map_err(failed(frame))?;
        let now = indices(&pixels, &mut palette);
        encoder.write_frame(&change(&before, &now, width))?;
        before = now;
        progress(frame + 1, frames);
    }
    Ok(encoder.into_inner()?)
}

/// The palette's index of every pixel.
fn indices(pixels: &Pixmap, palette: &mut Palette) -> Vec<u8> {
    let colours = pixels.pixels().iter();
    colours
        .map(|pixel| palette.index([pixel.red(), pixel.green(), pixel.blue()]))
        .collect()
}

/// The smallest rectangle that holds all that has changed; what has not changed in it is
/// transparent. Before the first frame there is nothing, and all of it is new.
fn change(before: &[u8], now: &[u8], width: u16) -> Frame<'static> {
    let columns = usize::from(width);
    let changed = |at: &usize| before.get(*at) != Some(&now[*at]);
    let (mut left, mut right, mut top, mut bottom) = (columns, 0, usize::MAX, 0);
    for at in (0..now.len()).filter(changed) {
        let (row, column) = (at / columns, at % columns);
        (left, right) = (left.min(column), right.max(column));
        (top, bottom) = (top.min(row), row);
    }
    if top == usize::MAX {
        // A frame needs a pixel, changed or not.
        (left, right, top, bottom) = (0, 0, 0, 0);
    }
    let rectangle = (top..=bottom).flat_map(|row| (left..=right).map(move |x| row * columns + x));
    let buffer: Vec<u8> = rectangle
        .map(|at| match changed(&at) {
            true => now[at],
            false => Palette::TRANSPARENT,
        })
        .collect();
    Frame {
        delay: DELAY,
        dispose: DisposalMethod::Keep,
        transparent: Some(Palette::TRANSPARENT),
        left: left as u16,
        top: top as u16,
        width: (right - left + 1) as u16,
        height: (bottom - top + 1) as u16,
        buffer: Cow::Owned(buffer),
        ..Frame::default()
    }
}

/// One motion and how it is seen.
struct Actor<'a> {
    row: Row<'a>,
    /// Where the camera is aimed at every frame, `[x, z]`.
    aims: Vec<[f32; 2]>,
    /// Where that is drawn.
    origin: [f32; 2],
}

impl Actor<'_> {
    /// The frame shown of this motion: the last, once it is over.
    fn shown(&self, frame: usize) -> usize {
        frame.min(self.row.motion.frames() - 1)
    }
}

/// The whole animation before it is drawn.
struct Scene<'a> {
    actors: Vec<Actor<'a>>,
    labels: Vec<Vec<String>>,
    camera: Camera,
    /// Pixels of a motion's place, and of all.
    place: f32,
    height: f32,
    /// Pixels a metre.
    scale: f32,
    /// Radius of the ground in metres.
    radius: f32,
}

impl<'a> Scene<'a> {
    fn new(rows: &[Row<'a>], options: &GifOptions) -> Result<Scene<'a>, GifError> {
        if rows.is_empty() {
            return Err(GifError::Empty);
        }
        let motions = rows.len();
        let count = u32::try_from(motions).unwrap_or(u32::MAX);
        let least = count.saturating_mul(LEAST_WIDTH);
        let usual = count.saturating_mul(WIDTH).min(MOST_WIDTH);
        let width = options.width.unwrap_or(usual);
        if width < least || width > MOST_WIDTH {
            return Err(GifError::Width {
                least,
                motions,
                width,
            });
        }
        let place = width as f32 / motions as f32;

        let camera = Camera::new(TILT);
        let aims = rows.iter().map(|row| centred(row.motion, &camera));
        let aims: Vec<_> = aims.collect();
        let poses = |index: usize| rows[index].motion.joints().iter().zip(&aims[index]);
        let poses = (0..motions).flat_map(poses);
        let seen = poses
            .clone()
            .map(|(pose, aim)| Extent::of(pose, &camera, *aim));
        let seen = seen.fold(Extent::NONE, Extent::and);
        // All shadows fall onto the ground.
        let far = |(pose, aim): (&[[f32; 3]; JOINTS], &[f32; 2])| {
            let distance = |[x, _, z]: [f32; 3]| (x - aim[0]).hypot(z - aim[1]);
            pose.iter().copied().map(distance).fold(0.0, f32::max)
        };
        let radius = poses.map(far).fold(LEAST_SEEN[0] / 2.0, f32::max).min(1e4);
        let wide = (2.0 * radius).max(seen.right - seen.left) + 2.0 * MARGIN;
        let bottom = (radius * camera.flatness()).max(-seen.bottom) + MARGIN;
        let tall = seen.top.max(LEAST_SEEN[1]) + MARGIN + bottom;
        let scale = (place / wide).min(place * TALLEST / tall);

        let label = letters(LABEL, place);
        let labels = rows.iter();
        let labels: Vec<_> = labels
            .map(|row| wrapped(row.label, label, place - 2.0 * label, LABEL_LINES))
            .collect();
        let lines = labels.iter().map(Vec::len).max().unwrap_or(0);
        let above = 0.6 * label + lines as f32 * label * LINE;
        let ground = above + (tall - bottom) * scale;
        let actors = rows.iter().zip(aims).enumerate();
        let actors = actors.map(|(index, (row, aims))| Actor {
            row: *row,
            aims,
            origin: [(index as f32 + 0.5) * place, ground],
        });
        Ok(Scene {
            actors: actors.collect(),
            labels,
            camera,
            place,
            height: ground + bottom * scale + 2.0 * letters(TIME, place),
            scale,
            radius,
        })
    }

    /// What is the same in every frame, as an SVG document.
    fn backdrop(&self) -> String {
        let label = letters(LABEL, self.place);
        let labels = self.labels.iter().enumerate();
        let labels = labels.fold(Group::new(), |group, (index, lines)| {
            let left = index as f32 * self.place + label;
            group.add(block(lines, [left, 1.5 * label], label, "#111827"))
        });
        let width = (self.place * self.actors.len() as f32).round();
        let page = page(width, self.height);
        let page = self.actors.iter().fold(page, |page, actor| {
            let [x, y] = actor.origin;
            page.add(
                Ellipse::new()
                    .set("cx", x)
                    .set("cy", y)
                    .set("rx", self.radius * self.scale)
                    .set("ry", self.radius * self.camera.flatness() * self.scale)
                    .set("fill", "#f3f4f6"),
            )
        });
        page.add(labels).to_string()
    }

    /// What is drawn over the backdrop at a frame, as an SVG document.
    fn frame(&self, frame: usize) -> String {
        let size = letters(TIME, self.place);
        let width = self.place * self.actors.len() as f32;
        let document = svg::Document::new()
            .set("width", width)
            .set("height", self.height)
            .set("font-family", "sans-serif");
        let actors = self.actors.iter().enumerate();
        let document = actors.fold(document, |document, (index, actor)| {
            let shown = actor.shown(frame);
            let pose = &actor.row.motion.joints()[shown];
            let view = View {
                camera: self.camera,
                middle: actor.aims[shown],
                origin: actor.origin,
                scale: self.scale,
            };
            let seconds = shown as f32 / FRAMES_PER_SECOND;
            let at = [(index as f32 + 0.5) * self.place, self.height - 0.8 * size];
            let time = line(&format!("{seconds:.2} s"), at, size, "#6b7280");
            document
                .add(grid(&view, self.radius))
                .add(shadow(pose, &view, "#d1d5db"))
                .add(figure(pose, &view))
                .add(time.set("text-anchor", "middle"))
        });
        document.to_string()
    }
}

/// Where the camera is aimed at every frame: it follows the motion, and has all of it around the
/// middle of the picture.
fn centred(motion: &Motion, camera: &Camera) -> Vec<[f32; 2]> {
    let aims = follow(motion);
    let poses = motion.joints().iter().zip(&aims);
    let seen = poses.flat_map(|(pose, aim)| pose.map(|[x, _, z]| camera.see([x, 0.0, z], *aim)));
    let (mut least, mut most) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for point in seen {
        let point = [point.right, -point.up / camera.flatness()];
        for axis in 0..2 {
            least[axis] = least[axis].min(point[axis]);
            most[axis] = most[axis].max(point[axis]);
        }
    }
    let [right, nearer] = [0, 1].map(|axis| (least[axis] + most[axis]) / 2.0);
    aims.iter()
        .map(|aim| camera.beside(*aim, right, nearer))
        .collect()
}

/// Size of letters in a place of that width.
fn letters((part, most): (f32, f32), place: f32) -> f32 {
    (part * place).min(most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gif::{ColorOutput, DecodeOptions};
    use lamogen_motion::Joint;

    /// A body that stands, its left hand rising `height` metres in so many frames.
    fn raise(height: f32, frames: usize) -> Motion {
        let poses = (0..frames).map(|t| {
            let mut pose = [[0.0; 3]; JOINTS];
            for joint in Joint::ALL {
                let side = match joint.name().get(..4) {
                    Some("left") => 0.2,
                    Some("righ") => -0.2,
                    _ => 0.0,
                };
                pose[joint.index()] = [side, 0.1 + 0.07 * joint.index() as f32, 0.0];
            }
            pose[Joint::LeftWrist.index()][1] = 0.8 + height * t as f32 / frames as f32;
            pose
        });
        Motion::from_joints(poses.collect()).unwrap()
    }

    /// A file, decoded.
    struct Decoded {
        size: (u16, u16),
        repeat: Repeat,
        palette: Vec<u8>,
        /// Delay, disposal and whether there is a palette of its own, of every frame.
        frames: Vec<(u16, DisposalMethod, bool)>,
        /// All pixels after every frame.
        pictures: Vec<Vec<u8>>,
    }

    fn decode(bytes: &[u8]) -> Decoded {
        let mut options = DecodeOptions::new();
        options.set_color_output(ColorOutput::Indexed);
        let mut decoder = options.read_info(bytes).unwrap();
        let size = (decoder.width(), decoder.height());
        let palette = decoder.global_palette().unwrap().to_vec();
        let mut canvas = vec![255; usize::from(size.0) * usize::from(size.1)];
        let (mut frames, mut pictures) = (Vec::new(), Vec::new());
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            frames.push((frame.delay, frame.dispose, frame.palette.is_some()));
            for (at, &index) in frame.buffer.iter().enumerate() {
                let (row, column) = (at / usize::from(frame.width), at % usize::from(frame.width));
                let (row, column) = (
                    row + usize::from(frame.top),
                    column + usize::from(frame.left),
                );
                if Some(index) != frame.transparent {
                    canvas[row * usize::from(size.0) + column] = index;
                }
            }
            pictures.push(canvas.clone());
        }
        Decoded {
            size,
            repeat: decoder.repeat(),
            palette,
            frames,
            pictures,
        }
    }

    fn animate(motions: &[&Motion], options: &GifOptions) -> Vec<u8> {
        let rows: Vec<Row<'_>> = motions
            .iter()
            .map(|motion| Row {
                label: "a hand",
                motion,
            })
            .collect();
        gif(&rows, options, &mut |_, _| ()).unwrap()
    }

    #[test]
    fn it_runs_at_true_speed_for_ever_in_one_palette() {
        let (long, short) = (raise(1.0, 6), raise(0.5, 4));
        let rows = [("a", &long), ("b", &short)].map(|(label, motion)| Row { label, motion });
        let mut told = Vec::new();
        let options = GifOptions { width: Some(300) };
        let bytes = gif(&rows, &options, &mut |done, all| told.push((done, all))).unwrap();
        let decoded = decode(&bytes);
        assert_eq!(told, (1..=6).map(|done| (done, 6)).collect::<Vec<_>>());
        // 20 frames a second, each left in place for the next, none with colours of its own.
        assert_eq!(decoded.frames, [(5, DisposalMethod::Keep, false); 6]);
        assert_eq!(decoded.repeat, Repeat::Infinite);
        assert_eq!(decoded.size.0, 300);
        assert!((150..500).contains(&decoded.size.1), "{:?}", decoded.size);
    }

    #[test]
    fn frames_put_together_are_the_pictures_that_were_drawn() {
        let motion = raise(1.0, 5);
        let row = Row {
            label: "a hand",
            motion: &motion,
        };
        let decoded = decode(&animate(&[&motion], &GifOptions::default()));
        let scene = Scene::new(&[row], &GifOptions::default()).unwrap();
        let mut palette = Palette::new();
        let backdrop = render(&scene.backdrop(), 1.0, Missing::Boxes).unwrap();
        for (frame, picture) in decoded.pictures.iter().enumerate() {
            let mut pixels = backdrop.clone();
            render_onto(&mut pixels, &scene.frame(frame)).unwrap();
            assert!(indices(&pixels, &mut palette) == *picture, "frame {frame}");
            let next = decoded.pictures.get(frame + 1);
            assert!(next != Some(picture), "frame {frame} moves");
        }
    }

    #[test]
    fn what_is_over_stays_and_what_does_not_move_does_not_flicker() {
        let (long, short) = (raise(1.0, 8), raise(1.0, 3));
        let decoded = decode(&animate(&[&long, &short], &GifOptions::default()));
        assert_eq!(decoded.frames.len(), 8);
        let columns = usize::from(decoded.size.0);
        let half = |picture: &[u8], right: bool| -> Vec<u8> {
            let rows = picture.chunks(columns);
            rows.flat_map(|row| {
                if right {
                    &row[columns / 2..]
                } else {
                    &row[..columns / 2]
                }
            })
            .copied()
            .collect()
        };
        for pair in decoded.pictures[2..].windows(2) {
            assert!(half(&pair[0], true) == half(&pair[1], true));
            assert!(half(&pair[0], false) != half(&pair[1], false));
        }
    }

    #[test]
    fn a_jump_leaves_the_ground_but_not_the_picture() {
        let body = raise(0.0, 1).joints()[0];
        let jump = (0..9).map(|t| {
            let height = 1.5 - (t as f32 - 4.0).powi(2) * 1.5 / 16.0;
            body.map(|[x, y, z]| [x, y + height, z])
        });
        let motion = Motion::from_joints(jump.collect()).unwrap();
        let decoded = decode(&animate(&[&motion], &GifOptions::default()));
        // Rows of the picture that hold a limb's or the head's own colour.
        let rows = |picture: &[u8]| -> Vec<usize> {
            let limb = |&index: &u8| {
                let at = 3 * usize::from(index);
                crate::figure::COLOURS.contains(
                    &format!(
                        "#{:02x}{:02x}{:02x}",
                        decoded.palette[at],
                        decoded.palette[at + 1],
                        decoded.palette[at + 2]
                    )
                    .as_str(),
                )
            };
            let rows = picture.chunks(usize::from(decoded.size.0)).enumerate();
            rows.filter(|(_, row)| row.iter().any(limb))
                .map(|(at, _)| at)
                .collect()
        };
        let [start, top] = [0, 4].map(|frame| rows(&decoded.pictures[frame]));
        assert!(top[0] + 80 < start[0] && top[top.len() - 1] + 80 < start[start.len() - 1]);
        assert!(top[0] > 20, "below the label");
        assert_eq!(top.len().abs_diff(start.len()), 0, "heights are true");
    }

    #[test]
    fn the_same_motions_give_the_same_bytes() {
        let motion = raise(0.7, 4);
        let options = GifOptions::default();
        assert!(animate(&[&motion], &options) == animate(&[&motion], &options));
    }

    #[test]
    fn broken_motions_are_drawn_small() {
        let mut joints = vec![[[0.0, 1.0, 0.0]; JOINTS]; 3];
        joints[1][Joint::LeftWrist.index()] = [1e30, -1e30, f32::MAX];
        joints[2] = [[f32::MIN, f32::MAX, 0.0]; JOINTS];
        let motion = Motion::from_joints(joints).unwrap();
        let decoded = decode(&animate(&[&motion], &GifOptions::default()));
        assert_eq!(decoded.frames.len(), 3);
        assert!(decoded.size.1 < 700, "{:?}", decoded.size);
    }

    #[test]
    fn no_motions_and_bad_widths_are_errors() {
        let options = |width| GifOptions { width };
        let made = |rows: &[Row<'_>], width| gif(rows, &options(width), &mut |_, _| ());
        assert!(matches!(made(&[], None), Err(GifError::Empty)));
        let motion = raise(1.0, 1);
        let rows = [Row {
            label: "",
            motion: &motion,
        }; 2];
        for width in [0, 159, 4097, u32::MAX] {
            let message = made(&rows, Some(width)).unwrap_err().to_string();
            assert!(
                message.contains("160 to 4096") && message.contains(&width.to_string()),
                "{message}"
            );
        }
        assert!(made(&rows, Some(160)).is_ok());
        // More motions than there is room for.
        assert!(made(&[rows[0]; 60], None).is_err());
    }
}
