//! Pictures of `lamogen-view` in pixels.

use burn::tensor::Device;
use lamogen_laban::{LabanOptions, LabanSeries};
use lamogen_motion::{JOINTS, Motion};
use lamogen_raster::png;
use lamogen_view::{LabanCurve, LabelledMotion, sheet, strip};

const TERMS: &str = "Made with a model under <CC-BY-4.0> & others:\n\"a\", 'b'";

fn motion(copyright: Option<&str>) -> Motion {
    let poses = (0..20).map(|t| [[0.1, 0.9 + 0.01 * t as f32, 0.2]; JOINTS]);
    let motion = Motion::from_joints(poses.collect()).unwrap();
    motion.with_copyright(copyright)
}

fn contains(bytes: &[u8], text: &str) -> bool {
    let mut parts = bytes.windows(text.len());
    parts.any(|part| part == text.as_bytes())
}

#[test]
fn png_files_hold_the_terms_of_the_motions() {
    let file = |copyright| {
        let motion = motion(copyright);
        let rows = [LabelledMotion::new("walk", &motion)];
        png(&strip(&rows, 2), 1.0).unwrap()
    };
    let with = file(Some(TERMS));
    assert!(contains(&with, "iTXt") && contains(&with, TERMS));
    assert!(!contains(&file(None), "iTXt"));
}

#[test]
fn every_part_of_a_sheet_is_drawn() {
    let motion = motion(None);
    let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
    let rows = [LabelledMotion::new("text alone", &motion)];
    let svg = sheet("jumps", &rows, 6, &[LabanCurve::baseline(&series)]).unwrap();
    let file = png(&svg, 1.0).unwrap();
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(file))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let (width, height) = (info.width as usize, info.height as usize);
    let is_drawn = |rows: std::ops::Range<usize>| {
        let rows = &pixels[3 * width * rows.start..3 * width * rows.end];
        rows.chunks(3).any(|pixel| pixel[0] < 200)
    };
    assert!(is_drawn(0..60) && is_drawn(60..height - 640) && is_drawn(height - 60..height));
    assert!(!is_drawn(height - 20..height), "the lower margin is free");
}
