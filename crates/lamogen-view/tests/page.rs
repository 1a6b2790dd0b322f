//! Pages of a walk. They are kept in cargo's folder for tests (`target/tmp`), so that a browser can open them:
//! `node xtask/judges/page.mjs target/tmp/page.html`.

use std::f32::consts::TAU;
use std::path::PathBuf;

use burn::tensor::Device;
use lamogen_laban::{LabanOptions, LabanSeries};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Motion, TimedCaption};
use lamogen_view::{LabanCurve, Page, PageFigure, page, save};

/// Returns the two joints of a limb with two bones that starts at `root`. Lengths are in metres; angles are in radians,
/// measured from straight down towards the front.
fn limb(root: [f32; 3], lengths: [f32; 2], angles: [f32; 2]) -> [[f32; 3]; 2] {
    let along = |[x, y, z]: [f32; 3], length: f32, angle: f32| {
        [x, y - length * angle.cos(), z + length * angle.sin()]
    };
    let middle = along(root, lengths[0], angles[0]);
    [middle, along(middle, lengths[1], angles[1])]
}

/// Returns the motion of a person who walks along +Z. `speed` is in metres per second; `swing` is the amplitude of arms and
/// legs in radians.
fn walk(frames: usize, speed: f32, swing: f32) -> Motion {
    let pose = |frame: usize| {
        let time = frame as f32 / FRAMES_PER_SECOND;
        let stride = TAU * time * 0.95;
        let mut pose = [[0.0; 3]; JOINTS];
        let mut put = |joint: Joint, at: [f32; 3]| pose[joint.index()] = at;
        let [height, forward] = [0.93 + 0.02 * (2.0 * stride).cos(), speed * time];
        let from_root = |x: f32, y: f32, z: f32| [x, height + y, forward + z];
        put(Joint::Pelvis, from_root(0.0, 0.0, 0.0));
        put(Joint::Spine1, from_root(0.0, 0.12, -0.02));
        put(Joint::Spine2, from_root(0.0, 0.26, -0.01));
        put(Joint::Spine3, from_root(0.0, 0.32, 0.0));
        put(Joint::Neck, from_root(0.0, 0.53, 0.0));
        put(Joint::Head, from_root(0.0, 0.62, 0.04));
        use Joint::*;
        for (side, phase, [hip, knee, ankle, foot], [collar, shoulder, elbow, wrist]) in [
            (
                1.0,
                0.0,
                [LeftHip, LeftKnee, LeftAnkle, LeftFoot],
                [LeftCollar, LeftShoulder, LeftElbow, LeftWrist],
            ),
            (
                -1.0,
                TAU / 2.0,
                [RightHip, RightKnee, RightAnkle, RightFoot],
                [RightCollar, RightShoulder, RightElbow, RightWrist],
            ),
        ] {
            let (forth, back) = (
                swing * (stride + phase).sin(),
                (stride + phase).cos().max(0.0),
            );
            let root = from_root(0.06 * side, -0.08, 0.0);
            let [bent, end] = limb(
                root,
                [0.38, 0.4],
                [forth, forth - swing * 1.3 * back - 0.08],
            );
            put(hip, root);
            put(knee, bent);
            put(ankle, end);
            put(foot, [end[0] + 0.02 * side, end[1] - 0.05, end[2] + 0.13]);
            let root = from_root(0.19 * side, 0.43, -0.02);
            let [bent, end] = limb(root, [0.26, 0.25], [-forth, 0.35 - forth + swing * 0.5]);
            put(collar, from_root(0.07 * side, 0.44, -0.01));
            put(shoulder, root);
            put(elbow, [bent[0] + 0.03 * side, bent[1], bent[2]]);
            put(wrist, [end[0] + 0.02 * side, end[1], end[2]]);
        }
        pose
    };
    Motion::from_joints((0..frames).map(pose).collect()).unwrap()
}

/// Saves a page in the folder for tests.
fn save_page(name: &str, html: &str) {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    save(&path, html).unwrap();
    assert_eq!(std::fs::read_to_string(path).unwrap(), html);
}

#[test]
fn a_pair_with_its_curves_is_a_page_below_a_hundred_kilobytes() {
    let (calm, brisk) = (walk(80, 1.0, 0.35), walk(80, 1.2, 0.55));
    let measure = |motion| LabanSeries::of(motion, &LabanOptions::default(), &Device::flex());
    let (before, after, target) = (
        measure(&calm),
        measure(&brisk),
        measure(&walk(80, 1.2, 0.5)),
    );
    let html = page(&Page {
        title: "a person walks with swinging arms",
        notes: "strong, sudden · seed 7",
        figures: &[PageFigure::baseline(&calm), PageFigure::guided(&brisk)],
        curves: &[
            LabanCurve::baseline(&before),
            LabanCurve::target(&target),
            LabanCurve::guided(&after),
        ],
        captions: &[],
    });
    save_page("page.html", &html);
    assert!(html.len() < 100_000, "{} bytes", html.len());
}

#[test]
fn four_motions_of_any_length_and_hard_names_are_a_page() {
    let motions = [
        walk(60, 0.2, 0.3),
        walk(1, 0.0, 0.4),
        walk(40, 0.3, 0.6),
        walk(196, 0.1, 0.2),
    ];
    let labels = [
        "</script><b>bold</b>",
        "قفزة",
        "a label that is much longer than the room that a phone has for it, and goes on",
        "",
    ];
    let colours = [[107, 114, 128], [194, 65, 12], [3, 105, 161], [255, 255, 0]];
    let figures: Vec<PageFigure> = (0..4)
        .map(|i| PageFigure {
            label: labels[i],
            motion: &motions[i],
            colour: colours[i],
        })
        .collect();
    let title = "</title></script><script>alert(1)</script> & \"quotes\" ".repeat(4);
    let html = page(&Page {
        title: &title,
        notes: labels[2],
        figures: &figures,
        curves: &[],
        captions: &[],
    });
    save_page("page-four.html", &html);
    assert!(!html.contains("<b>") && !html.contains("<script>alert"));
}

#[test]
fn sentences_in_a_row_are_captions_of_a_page() {
    let walk = walk(120, 1.0, 0.4);
    let series = LabanSeries::of(&walk, &LabanOptions::default(), &Device::flex());
    let caption = TimedCaption::new;
    let html = page(&Page {
        title: "a scene",
        notes: "",
        figures: &[PageFigure::guided(&walk)],
        curves: &[LabanCurve::guided(&series)],
        captions: &[
            caption("a person walks forward, slowly and with long arms", 0..60),
            caption("</script><b>jumps</b>", 60..80),
            caption("a person walks on", 80..120),
        ],
    });
    save_page("page-captions.html", &html);
    assert!(!html.contains("<b>") && html.contains("\"from\":80"));
}

#[test]
fn a_motion_of_one_frame_is_a_page() {
    let still = walk(1, 0.0, 0.4);
    let series = LabanSeries::of(&still, &LabanOptions::default(), &Device::flex());
    let html = page(&Page {
        title: "stands",
        notes: "",
        figures: &[PageFigure::baseline(&still)],
        curves: &[LabanCurve::baseline(&series)],
        captions: &[],
    });
    save_page("page-still.html", &html);
    assert!(html.contains("\"frames\":1"));
}
