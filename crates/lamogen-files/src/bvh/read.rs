//! BVH as other programs write it.
//!
//! The format has no standard, so what is read here is what is found: keywords in any case, braces on
//! any line, names with blanks and colons, joints with any channels in any order, `Frame Time` with or
//! without blanks, rows that are missing at the end.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::cursor::{BvhError, Cursor};
use crate::clip::{Clip, END_SITE, Node};

/// What a BVH holds.
#[derive(Debug)]
pub(crate) struct Bvh {
    pub(crate) clip: Clip,
    /// The number of frames that the file says it has.
    pub(crate) announced: usize,
}

/// A human skeleton has 20 to 200 joints; what has more would take long and is not one.
const MAX_NODES: usize = 2000;
/// The longest time between two frames, in seconds.
const MAX_FRAME_TIME: f64 = 10.0;

/// Reads a file. Bytes that are not UTF-8, as in old files' joint names, do not matter.
pub(crate) fn read(path: &Path) -> Result<Bvh, BvhError> {
    let bytes = std::fs::read(path).map_err(|reason| BvhError::Io {
        path: path.to_owned(),
        reason,
    })?;
    parse(&String::from_utf8_lossy(&bytes), path)
}

/// Reads a text; `path` stands in error messages.
pub(crate) fn parse(text: &str, path: &Path) -> Result<Bvh, BvhError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut cursor = Cursor::new(text, path);
    cursor.keyword(&["HIERARCHY"], "HIERARCHY")?;
    cursor.keyword(&["ROOT"], "ROOT and the name of the first joint")?;
    let (mut nodes, channels) = hierarchy(&mut cursor)?;
    cursor.keyword(&["MOTION"], "MOTION after the hierarchy of one ROOT")?;
    cursor.keyword(&["Frames"], "Frames: and their number")?;
    cursor.colon();
    let announced = cursor.parse("the number of frames", |token| token.parse::<usize>().ok())?;
    cursor.keyword(&["Frame", "FrameTime"], "Frame Time: and its seconds")?;
    let next = cursor.peek().split(':').next();
    if next.is_some_and(|word| word.eq_ignore_ascii_case("Time")) {
        cursor.keyword(&["Time"], "Frame Time: and its seconds")?;
    }
    cursor.colon();
    let time_line = cursor.clone();
    let seconds_per_frame = cursor.number("the seconds of a frame")?;

    let width = channels.iter().map(Vec::len).sum::<usize>();
    if width == 0 {
        return Err(cursor.error("joints with CHANNELS", "none in the whole hierarchy"));
    }
    let frames = rows(&mut cursor, width, |row| {
        let mut values = row.iter();
        for (node, channels) in nodes.iter_mut().zip(&channels) {
            node.push(channels, &mut values);
        }
    })?;
    if frames == 0 {
        return Err(cursor.error(&format!("a row of {width} numbers"), "the end of the file"));
    }
    let fits = (0.0..=MAX_FRAME_TIME).contains(&seconds_per_frame)
        && (seconds_per_frame > 0.0 || frames == 1);
    if !fits {
        return Err(time_line.error(
            &format!("more than 0 and at most {MAX_FRAME_TIME} seconds a frame"),
            &seconds_per_frame.to_string(),
        ));
    }
    Ok(Bvh {
        clip: Clip {
            nodes: finished(nodes),
            frames,
            seconds_per_frame,
        },
        announced,
    })
}

/// One number of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Channel {
    /// Where the joint is along an axis, seen from its parent.
    Position(usize),
    /// A turn about an axis in degrees, after the turns that stand before it.
    Rotation(usize),
}

impl Channel {
    fn from_name(name: &str) -> Option<Channel> {
        let name = name.to_ascii_lowercase();
        let axis = ["x", "y", "z"]
            .into_iter()
            .position(|axis| name.starts_with(axis))?;
        match &name[1..] {
            "position" => Some(Channel::Position(axis)),
            "rotation" => Some(Channel::Rotation(axis)),
            _ => None,
        }
    }
}

impl Node {
    /// Takes the node's numbers from a row. A position stands in place of the offset, as programs
    /// that move other joints than the root have it; an axis without a channel keeps its offset.
    fn push<'a>(&mut self, channels: &[Channel], values: &mut impl Iterator<Item = &'a f64>) {
        let mut place = self.rest;
        let mut turn = DQuat::IDENTITY;
        let (mut moves, mut turns) = (false, false);
        for (channel, &value) in channels.iter().zip(values) {
            match channel {
                Channel::Position(axis) => {
                    moves = true;
                    place[*axis] = value;
                }
                Channel::Rotation(axis) => {
                    turns = true;
                    turn *= DQuat::from_axis_angle(DVec3::AXES[*axis], value.to_radians());
                }
            }
        }
        if moves {
            self.translations.push(place);
        }
        if turns {
            // Thousands of products would wear the length down; three do not.
            self.rotations.push(turn);
        }
    }
}

/// The nodes with an entry for whatever does not move. Some programs give every joint six channels, and fill in only the root's, or how far the
/// joint is from its offset, which is nothing but noise: what lies nearer to nothing than to the offsets is counted from these.
fn finished(mut nodes: Vec<Node>) -> Vec<Node> {
    let below = |node: &&mut Node| node.parent.is_some() && !node.translations.is_empty();
    // Of every joint the middle distance, so that a single wild frame has no say.
    let middle = |node: &Node, from: DVec3| {
        let mut distances: Vec<f64> = { node.translations.iter() }
            .map(|place| place.distance(from))
            .collect();
        distances.sort_by(f64::total_cmp);
        distances[distances.len() / 2]
    };
    let (mut from_nothing, mut from_offset) = (0.0, 0.0);
    for node in nodes.iter_mut().filter(below) {
        from_nothing += middle(node, DVec3::ZERO);
        from_offset += middle(node, node.rest);
    }
    // A joint alone may move where it will; bones as a whole do not shrink to nothing.
    const MUCH_NEARER: f64 = 0.25;
    let is_relative = from_nothing < MUCH_NEARER * from_offset;
    for node in nodes.iter_mut().filter(below) {
        let is_nothing = node.translations.iter().all(|place| *place == DVec3::ZERO);
        if is_nothing {
            node.translations = vec![node.rest];
        } else if is_relative {
            for place in &mut node.translations {
                *place += node.rest;
            }
        }
    }
    for node in &mut nodes {
        if node.translations.is_empty() {
            node.translations = vec![node.rest];
        }
        if node.rotations.is_empty() {
            node.rotations = vec![DQuat::IDENTITY];
        }
    }
    nodes
}

/// The joints from the ROOT's name to its closing brace, and the channels of each.
fn hierarchy(cursor: &mut Cursor<'_>) -> Result<(Vec<Node>, Vec<Vec<Channel>>), BvhError> {
    let mut nodes = vec![open(cursor, None)?];
    let mut channels = vec![Vec::new()];
    let mut offset_read = vec![false];
    let mut branch = vec![0];
    while let Some(&node) = branch.last() {
        let found = cursor.clone();
        let word = cursor.token().to_ascii_uppercase();
        match word.as_str() {
            "OFFSET" if offset_read[node] => {
                return Err(found.error("one OFFSET of a joint", "a second"));
            }
            "OFFSET" => {
                for axis in 0..3 {
                    nodes[node].rest[axis] = cursor.number("three numbers after OFFSET")?;
                }
                offset_read[node] = true;
            }
            "CHANNELS" if !channels[node].is_empty() => {
                return Err(found.error("one list of CHANNELS of a joint", "a second"));
            }
            "CHANNELS" => channels[node] = channel_list(cursor)?,
            "JOINT" | "END" => {
                if nodes.len() == MAX_NODES {
                    return Err(found.error(&format!("at most {MAX_NODES} joints"), "more"));
                }
                branch.push(nodes.len());
                let mut child = open(cursor, Some(node))?;
                if word == "END" {
                    child.name = END_SITE.into();
                }
                nodes.push(child);
                channels.push(Vec::new());
                offset_read.push(false);
            }
            "}" if !offset_read[node] => {
                let name = &nodes[node].name;
                return Err(
                    found.error("OFFSET and three numbers", &format!("the end of {name:?}"))
                );
            }
            "}" => {
                branch.pop();
            }
            _ => return Err(found.error("OFFSET, CHANNELS, JOINT, End Site or }", &found.shown())),
        }
    }
    Ok((nodes, channels))
}

/// A joint's name and its opening brace.
fn open(cursor: &mut Cursor<'_>, parent: Option<usize>) -> Result<Node, BvhError> {
    let name = cursor.name()?;
    Ok(Node {
        name,
        parent,
        rest: DVec3::ZERO,
        translations: Vec::new(),
        rotations: Vec::new(),
        scale: DVec3::ONE,
    })
}

fn channel_list(cursor: &mut Cursor<'_>) -> Result<Vec<Channel>, BvhError> {
    let count = cursor.parse("the number of channels", |token| {
        token.parse::<usize>().ok()
    })?;
    let mut channels = Vec::new();
    for _ in 0..count {
        let found = cursor.clone();
        let expected = "a channel such as Xposition or Zrotation";
        let channel = cursor.parse(expected, Channel::from_name)?;
        if matches!(channel, Channel::Position(_)) && channels.contains(&channel) {
            return Err(found.error("each position channel once", &found.shown()));
        }
        channels.push(channel);
    }
    Ok(channels)
}

/// Hands every row of numbers on and says how many there are.
fn rows(
    cursor: &mut Cursor<'_>,
    width: usize,
    mut take: impl FnMut(&[f64]),
) -> Result<usize, BvhError> {
    let mut row = Vec::with_capacity(width);
    let mut frames = 0;
    while !cursor.peek().is_empty() {
        let start = cursor.clone();
        row.clear();
        while !cursor.peek_in_line().is_empty() {
            row.push(cursor.number("a number")?);
        }
        if row.len() != width {
            let expected = format!("a row of {width} numbers, one for each channel");
            return Err(start.error(&expected, &row.len().to_string()));
        }
        take(&row);
        frames += 1;
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = "HIERARCHY
ROOT Hips
{
\tOFFSET 0 0 0
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT Bip01 L Thigh: left
\t{
\t\tOFFSET 1 0 0
\t\tCHANNELS 1 Zrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0 -2 0
\t\t}
\t}
}
MOTION
Frames: 2
Frame Time: .0333333
0 90 0 0 0 0 0
1e-05 +9.e1 -.5 90 0 0 90
";

    fn parsed(text: &str) -> Result<Bvh, String> {
        parse(text, Path::new("a.bvh")).map_err(|error| error.to_string())
    }

    #[test]
    fn joints_turn_in_the_frame_of_their_parents() {
        let bvh = parsed(SMALL).unwrap();
        let names: Vec<&str> = bvh.clip.nodes.iter().map(|node| &*node.name).collect();
        assert_eq!(names, ["Hips", "Bip01 L Thigh: left", END_SITE]);
        assert_eq!((bvh.clip.frames, bvh.announced), (2, 2));
        assert_eq!(bvh.clip.seconds_per_frame, 0.0333333);
        let rest = bvh.clip.positions(0.0);
        assert!(rest[2].abs_diff_eq(DVec3::new(1.0, 88.0, 0.0), 1e-9));
        let turned = bvh.clip.positions(1.0);
        assert!(turned[1].abs_diff_eq(DVec3::new(1e-5, 91.0, -0.5), 1e-9));
        assert!(turned[2].abs_diff_eq(DVec3::new(1e-5, 93.0, -0.5), 1e-9));
    }

    #[test]
    fn layout_case_and_line_ends_do_not_matter() {
        let expected = parsed(SMALL).unwrap().clip.positions(1.0);
        for text in [
            SMALL.replace('\n', "\r\n"),
            SMALL.replace('\n', "  \n\n \t\n"),
            SMALL.replace('\t', "    "),
            SMALL.replace("\n\t\t{\n", " {\n"),
            SMALL.replace(
                "End Site\n\t\t{\n\t\t\tOFFSET 0 -2 0\n\t\t}",
                "End site { OFFSET 0 -2 0 }",
            ),
            SMALL
                .replace("JOINT", "Joint")
                .replace("OFFSET", "Offset")
                .replace("ROOT", "root"),
            SMALL
                .replace("Frame Time: ", "Frame Time:")
                .replace("Frames: ", "Frames:\t"),
            SMALL
                .replace("Frame Time: ", "FRAME TIME :\t")
                .replace("Frames: ", "frames :"),
            SMALL.replace("Frame Time: ", "FrameTime: "),
            SMALL
                .replace("Zrotation", "ZROTATION")
                .replace("Xposition", "xposition"),
            SMALL.replace("Frames: 2", "Frames: 900"),
            format!("\u{feff}{SMALL}"),
            SMALL.trim_end().to_owned(),
        ] {
            let clip = parsed(&text)
                .unwrap_or_else(|error| panic!("{error}\n{text}"))
                .clip;
            assert_eq!(clip.positions(1.0), expected, "{text}");
        }
    }

    #[test]
    fn rotations_apply_in_the_order_of_their_channels() {
        for (order, place) in [
            ("Zrotation Xrotation Yrotation", DVec3::new(0.0, 0.0, -2.0)),
            ("Xrotation Zrotation Yrotation", DVec3::new(2.0, 0.0, 0.0)),
        ] {
            let text = SMALL
                .replace("Zrotation Xrotation Yrotation", order)
                .replace("0 90 0 0 0 0 0", "0 0 0 90 90 0 0");
            let found = parsed(&text).unwrap().clip.positions(0.0);
            // The limb's end seen from the thigh: (0, -2, 0) without the turns.
            let limb = found[2] - found[1];
            assert!(limb.abs_diff_eq(place, 1e-9), "{order}: {limb}");
        }
    }

    #[test]
    fn a_joint_with_positions_moves_there_unless_they_are_all_zero() {
        let text = SMALL.replace("CHANNELS 1 Zrotation", "CHANNELS 2 Yposition Zrotation");
        let moved = text
            .replace("0 90 0 0 0 0 0", "0 90 0 0 0 0 5 0")
            .replace("0 0 90\n", "0 0 5 90\n");
        let places = parsed(&moved).unwrap().clip.positions(0.0);
        assert_eq!(places[1], DVec3::new(1.0, 95.0, 0.0));
        let three = SMALL.replace(
            "CHANNELS 1 Zrotation",
            "CHANNELS 3 Zposition Xposition Yposition",
        );
        let zero = three
            .replace("0 90 0 0 0 0 0", "0 90 0 0 0 0 0 0 0")
            .replace("0 0 90\n", "0 0 0 0 0\n");
        let places = parsed(&zero).unwrap().clip.positions(0.0);
        assert_eq!(places[1], DVec3::new(1.0, 90.0, 0.0));
    }

    #[test]
    fn positions_around_nothing_are_counted_from_the_offsets() {
        let text = SMALL.replace(
            "CHANNELS 1 Zrotation",
            "CHANNELS 4 Xposition Yposition Zposition Zrotation",
        );
        let of = |[x, y, z]: [f64; 3]| {
            let text = text
                .replace("0 90 0 0 0 0 0", &format!("0 90 0 0 0 0 {x} {y} {z} 0"))
                .replace("0 0 90\n", &format!("0 0 {x} {y} {z} 90\n"));
            parsed(&text).unwrap().clip.positions(0.0)[1]
        };
        // The offset is 1 0 0. Noise around nothing, noise around the offset, and a way of its own.
        let noise = of([1e-5, -2e-5, 0.0]);
        assert!(
            noise.abs_diff_eq(DVec3::new(1.0 + 1e-5, 90.0 - 2e-5, 0.0), 1e-9),
            "{noise}"
        );
        let absolute = of([1.00001, 0.0, 0.0]);
        assert!(
            absolute.abs_diff_eq(DVec3::new(1.00001, 90.0, 0.0), 1e-9),
            "{absolute}"
        );
        let moved = of([0.6, 0.3, 0.0]);
        assert!(
            moved.abs_diff_eq(DVec3::new(0.6, 90.3, 0.0), 1e-9),
            "{moved}"
        );
    }

    #[test]
    fn errors_say_what_where_and_instead_of_what() {
        for (text, place, expected, found) in [
            (String::new(), "line 1", "HIERARCHY", "the end of the file"),
            ("{\"asset\":".into(), "line 1", "HIERARCHY", "\"{\""),
            (SMALL.replace("ROOT", "RUT"), "line 2", "ROOT", "\"RUT\""),
            (
                SMALL.replace("ROOT Hips\n{", "ROOT Hips\n"),
                "line 2",
                "name and {",
                "\"Hips\"",
            ),
            (
                SMALL.replace("1 0 0", "1 x 0"),
                "line 8",
                "three numbers",
                "\"x\"",
            ),
            (
                SMALL.replace("1 0 0", "1 nan 0"),
                "line 8",
                "three numbers",
                "\"nan\"",
            ),
            (
                SMALL.replace("1 0 0", "1 0"),
                "line 9",
                "three numbers",
                "\"CHANNELS\"",
            ),
            (
                SMALL.replace("\t\t\tOFFSET 0 -2 0\n", ""),
                "line 12",
                "OFFSET",
                "End Site",
            ),
            (
                SMALL.replace("CHANNELS 1 Zrotation", "CHANNELS 1 Wrotation"),
                "line 9",
                "channel",
                "Wrotation",
            ),
            (
                SMALL.replace("CHANNELS 1 Z", "CHANNELS 99999999999 Z"),
                "line 10",
                "channel",
                "\"End\"",
            ),
            (
                SMALL.replace("MOTION", "ROOT Other {"),
                "line 16",
                "one ROOT",
                "\"ROOT\"",
            ),
            (
                SMALL.replace("Frames: 2", "Frames: two"),
                "line 17",
                "number of frames",
                "two",
            ),
            (
                SMALL.replace(".0333333", "0"),
                "line 18",
                "more than 0",
                "0",
            ),
            (
                SMALL.replace(".0333333", "-1"),
                "line 18",
                "more than 0",
                "-1",
            ),
            (
                SMALL.replace(".0333333", "1e300"),
                "line 18",
                "at most 10",
                "1000",
            ),
            (
                SMALL.replace("0 90 0 0 0 0 0", "0 90 0 0 0 0"),
                "line 19",
                "7 numbers",
                "6",
            ),
            (
                SMALL.replace("0 90 0 0 0 0 0", "0 90 0 0 0 0 0 0"),
                "line 19",
                "7 numbers",
                "8",
            ),
            (
                SMALL.replace("0 90 0 0 0 0 0", "0 90 0 0 1,5 0 0"),
                "line 19",
                "a number",
                "1,5",
            ),
            (
                SMALL.split("0 90").next().unwrap().into(),
                "line 19",
                "7 numbers",
                "the end",
            ),
            (
                SMALL.split("MOTION").next().unwrap().into(),
                "line 16",
                "MOTION",
                "the end",
            ),
        ] {
            let message = parsed(&text).unwrap_err();
            for part in ["a.bvh", place, expected, found] {
                assert!(message.contains(part), "{part:?} is not in {message:?}");
            }
        }
        let message = read(Path::new("no/such.bvh")).unwrap_err().to_string();
        assert!(message.contains("no/such.bvh"), "{message}");
    }

    #[test]
    fn a_single_frame_needs_no_time() {
        let text = SMALL
            .replace(".0333333", "0")
            .replace("1e-05 +9.e1 -.5 90 0 0 90\n", "");
        assert_eq!(parsed(&text).unwrap().clip.positions(3.0)[0].y, 90.0);
    }

    #[test]
    fn damaged_files_never_panic() {
        let junk = [
            "",
            "{",
            "}",
            "\n",
            "JOINT a {",
            "End",
            "-",
            "1e999",
            "nan",
            ":",
            "é",
            "99999999999999999999",
        ];
        for place in 0..SMALL.len() {
            for junk in junk {
                let _ = parsed(&format!("{}{junk}{}", &SMALL[..place], &SMALL[place..]));
                let _ = parsed(&format!("{}{junk}{}", &SMALL[..place], &SMALL[place + 1..]));
            }
            let _ = parsed(&SMALL[..place]);
            let _ = parsed(&SMALL[place..]);
        }
    }

    #[test]
    fn nesting_without_end_is_an_error() {
        let text = format!(
            "HIERARCHY ROOT a {{ OFFSET 0 0 0 {}",
            "JOINT a {".repeat(1_000_000)
        );
        assert!(parsed(&text).unwrap_err().contains("at most 2000 joints"));
    }
}
