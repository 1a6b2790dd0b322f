//! Tests of the BVH reader on a small file and damaged variants of it.

use super::*;
use crate::clip::END_SITE;
use glam::DVec3;

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

fn parse_text(text: &str) -> Result<ParsedBvh, String> {
    parse(text, Path::new("a.bvh")).map_err(|error| error.to_string())
}

#[test]
fn joints_turn_in_the_frame_of_their_parents() {
    let bvh = parse_text(SMALL).unwrap();
    let names: Vec<&str> = bvh.clip.nodes.iter().map(|node| &*node.name).collect();
    assert_eq!(names, ["Hips", "Bip01 L Thigh: left", END_SITE]);
    assert_eq!((bvh.clip.frames, bvh.announced_frames), (2, 2));
    assert_eq!(bvh.clip.seconds_per_frame, 0.0333333);
    let rest = bvh.clip.positions(0.0);
    assert!(rest[2].abs_diff_eq(DVec3::new(1.0, 88.0, 0.0), 1e-9));
    let turned = bvh.clip.positions(1.0);
    assert!(turned[1].abs_diff_eq(DVec3::new(1e-5, 91.0, -0.5), 1e-9));
    assert!(turned[2].abs_diff_eq(DVec3::new(1e-5, 93.0, -0.5), 1e-9));
}

#[test]
fn layout_case_and_line_ends_do_not_matter() {
    let expected = parse_text(SMALL).unwrap().clip.positions(1.0);
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
        let clip = parse_text(&text)
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
        let found = parse_text(&text).unwrap().clip.positions(0.0);
        // The end of the limb relative to the thigh: (0, -2, 0) without the rotations.
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
    let places = parse_text(&moved).unwrap().clip.positions(0.0);
    assert_eq!(places[1], DVec3::new(1.0, 95.0, 0.0));
    let three = SMALL.replace(
        "CHANNELS 1 Zrotation",
        "CHANNELS 3 Zposition Xposition Yposition",
    );
    let zero = three
        .replace("0 90 0 0 0 0 0", "0 90 0 0 0 0 0 0 0")
        .replace("0 0 90\n", "0 0 0 0 0\n");
    let places = parse_text(&zero).unwrap().clip.positions(0.0);
    assert_eq!(places[1], DVec3::new(1.0, 90.0, 0.0));
}

#[test]
fn positions_around_zero_are_relative_to_the_offsets() {
    let text = SMALL.replace(
        "CHANNELS 1 Zrotation",
        "CHANNELS 4 Xposition Yposition Zposition Zrotation",
    );
    let of = |[x, y, z]: [f64; 3]| {
        let text = text
            .replace("0 90 0 0 0 0 0", &format!("0 90 0 0 0 0 {x} {y} {z} 0"))
            .replace("0 0 90\n", &format!("0 0 {x} {y} {z} 90\n"));
        parse_text(&text).unwrap().clip.positions(0.0)[1]
    };
    // The offset is 1 0 0. The cases: noise around zero, noise around the offset, and a real movement.
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
fn errors_name_the_line_and_what_was_expected_and_found() {
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
        let message = parse_text(&text).unwrap_err();
        for part in ["a.bvh", place, expected, found] {
            assert!(message.contains(part), "{part:?} is not in {message:?}");
        }
    }
    let message = crate::read("no/such.bvh", &crate::ReadOptions::default())
        .unwrap_err()
        .to_string();
    assert!(message.contains("no/such.bvh"), "{message}");
}

#[test]
fn a_single_frame_needs_no_time() {
    let text = SMALL
        .replace(".0333333", "0")
        .replace("1e-05 +9.e1 -.5 90 0 0 90\n", "");
    assert_eq!(parse_text(&text).unwrap().clip.positions(3.0)[0].y, 90.0);
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
            let _ = parse_text(&format!("{}{junk}{}", &SMALL[..place], &SMALL[place..]));
            let _ = parse_text(&format!("{}{junk}{}", &SMALL[..place], &SMALL[place + 1..]));
        }
        let _ = parse_text(&SMALL[..place]);
        let _ = parse_text(&SMALL[place..]);
    }
}

#[test]
fn nesting_without_end_is_an_error() {
    let text = format!(
        "HIERARCHY ROOT a {{ OFFSET 0 0 0 {}",
        "JOINT a {".repeat(1_000_000)
    );
    assert!(
        parse_text(&text)
            .unwrap_err()
            .contains("at most 2000 joints")
    );
}
