//! Tests of animated GIFs, which are decoded again.

use super::*;
use gif::{ColorOutput, DecodeOptions, DisposalMethod};
use lamogen_motion::{JOINTS, Joint, Motion};

/// Returns the motion of a standing body that raises its left hand by `height` metres.
fn hand_raise(height: f32, frames: usize) -> Motion {
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

/// The content of a decoded GIF.
struct DecodedGif {
    size: (u16, u16),
    repeat: Repeat,
    palette: Vec<u8>,
    /// For every frame: its delay, its disposal, and whether it has its own palette.
    frames: Vec<(u16, DisposalMethod, bool)>,
    /// The palette indices of all pixels after every frame.
    pictures: Vec<Vec<u8>>,
}

fn decode(bytes: &[u8]) -> DecodedGif {
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
    DecodedGif {
        size,
        repeat: decoder.repeat(),
        palette,
        frames,
        pictures,
    }
}

fn animate(motions: &[&Motion], options: &GifOptions) -> Vec<u8> {
    let rows: Vec<LabelledMotion<'_>> = motions
        .iter()
        .map(|motion| LabelledMotion::new("a hand", motion))
        .collect();
    gif(&rows, options, &mut |_, _| ()).unwrap()
}

#[test]
fn it_runs_in_real_time_for_ever_with_one_palette() {
    let (long, short) = (hand_raise(1.0, 6), hand_raise(0.5, 4));
    let rows =
        [("a", &long), ("b", &short)].map(|(label, motion)| LabelledMotion::new(label, motion));
    let mut progress = Vec::new();
    let options = GifOptions { width: Some(300) };
    let bytes = gif(&rows, &options, &mut |done, all| progress.push((done, all))).unwrap();
    let decoded = decode(&bytes);
    assert_eq!(progress, (1..=6).map(|done| (done, 6)).collect::<Vec<_>>());
    // 20 frames per second; each frame is kept below the next one, and none has its own palette.
    assert_eq!(decoded.frames, [(5, DisposalMethod::Keep, false); 6]);
    assert_eq!(decoded.repeat, Repeat::Infinite);
    assert_eq!(decoded.size.0, 300);
    assert!((150..500).contains(&decoded.size.1), "{:?}", decoded.size);
}

#[test]
fn decoded_frames_are_the_pictures_that_were_drawn() {
    let motion = hand_raise(1.0, 5);
    let row = LabelledMotion::new("a hand", &motion);
    let decoded = decode(&animate(&[&motion], &GifOptions::default()));
    let animation = Animation::new(&[row], None).unwrap();
    let mut palette = Palette::new();
    let backdrop = render(&animation.backdrop(), 1.0).unwrap();
    for (frame, picture) in decoded.pictures.iter().enumerate() {
        let mut pixels = backdrop.clone();
        render_onto(&mut pixels, &animation.frame(frame)).unwrap();
        assert!(
            palette_indices(&pixels, &mut palette) == *picture,
            "frame {frame}"
        );
        let next = decoded.pictures.get(frame + 1);
        assert!(next != Some(picture), "frame {frame} moves");
    }
}

#[test]
fn shorter_motions_stay_in_their_last_pose_without_flicker() {
    let (long, short) = (hand_raise(1.0, 8), hand_raise(1.0, 3));
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
    let body = hand_raise(0.0, 1).joints()[0];
    let jump = (0..9).map(|t| {
        let height = 1.5 - (t as f32 - 4.0).powi(2) * 1.5 / 16.0;
        body.map(|[x, y, z]| [x, y + height, z])
    });
    let motion = Motion::from_joints(jump.collect()).unwrap();
    let decoded = decode(&animate(&[&motion], &GifOptions::default()));
    // The rows of the picture that contain the colour of a limb or of the head.
    let rows = |picture: &[u8]| -> Vec<usize> {
        let limb = |&index: &u8| {
            let at = 3 * usize::from(index);
            lamogen_view::FIGURE_COLOURS.contains(
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
    let motion = hand_raise(0.7, 4);
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
    let draw = |rows: &[LabelledMotion<'_>], width| gif(rows, &options(width), &mut |_, _| ());
    assert!(matches!(
        draw(&[], None),
        Err(GifError::Animation(AnimationError::Empty))
    ));
    let motion = hand_raise(1.0, 1);
    let rows = [LabelledMotion::new("", &motion); 2];
    for width in [0, 159, 4097, u32::MAX] {
        let message = draw(&rows, Some(width)).unwrap_err().to_string();
        assert!(
            message.contains("160 to 4096") && message.contains(&width.to_string()),
            "{message}"
        );
    }
    assert!(draw(&rows, Some(160)).is_ok());
    // More motions than there is room for.
    assert!(draw(&[rows[0]; 60], None).is_err());
}

#[test]
fn the_caption_of_the_moment_stands_below() {
    let motion = hand_raise(0.3, 30);
    let caption = lamogen_motion::TimedCaption::new;
    let captions = [
        caption("a person stands", 0..10),
        caption("a person raises the left hand", 10..20),
    ];
    let with = LabelledMotion {
        captions: &captions,
        ..LabelledMotion::new("", &motion)
    };
    let draw = |row| {
        let bytes = gif(&[row], &GifOptions::default(), &mut |_, _| {}).unwrap();
        decode(&bytes)
    };
    let (with, without) = (draw(with), draw(LabelledMotion::new("", &motion)));
    let added = usize::from(with.size.1 - without.size.1);
    assert!(added > 10, "{added}");
    // The rows between the ground and the time.
    let width = usize::from(with.size.0);
    let below = |picture: &[u8]| {
        let rows = usize::from(with.size.1) - 22 - added..usize::from(with.size.1) - 22;
        picture[rows.start * width..rows.end * width].to_vec()
    };
    let pictures: Vec<Vec<u8>> = with.pictures.iter().map(|picture| below(picture)).collect();
    assert_eq!(pictures[2], pictures[9]);
    assert!(pictures[9] != pictures[10] && pictures[19] != pictures[20]);
    assert_eq!(pictures[10], pictures[19]);
    // After the last caption nothing is said.
    let mut colours = pictures[29].clone();
    colours.dedup();
    assert_eq!(colours.len(), 1);
}

#[test]
fn the_terms_of_the_motions_are_whole_in_the_file() {
    let terms = "Ä".repeat(400);
    let motion = hand_raise(0.3, 2).with_copyright(Some(terms.as_str()));
    let file = animate(&[&motion, &hand_raise(0.3, 2)], &GifOptions::default());
    let start = { file.windows(2) }
        .position(|pair| pair == [0x21, 0xfe])
        .unwrap();
    let (mut place, mut comment) = (start + 2, Vec::new());
    while file[place] != 0 {
        let length = usize::from(file[place]);
        comment.extend_from_slice(&file[place + 1..][..length]);
        place += 1 + length;
    }
    assert_eq!(String::from_utf8(comment).unwrap(), terms);
}
