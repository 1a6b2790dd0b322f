//! Loops: the last frame leads into the first, in the sampling and on the body.

use lamogen::motion::Rotations;
use lamogen::{Device, LaMoGen, LabanOptions, LabanSeries, Motion, Request, Tag};

/// Returns the mean of the values over the joints, at every frame.
fn means(steps: &[Vec<f64>]) -> Vec<f64> {
    steps
        .iter()
        .map(|joints| joints.iter().sum::<f64>() / joints.len() as f64)
        .collect()
}

/// Returns the value that nine of ten values do not exceed.
fn percentile_90(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[(0.9 * (sorted.len() - 1) as f64).round() as usize]
}

/// The steps of a motion from frame to frame: of positions in metres, of velocities in metres a frame, of rotations in
/// radians.
fn steps(motion: &Motion) -> [Vec<Vec<f64>>; 3] {
    let difference = |a: &[[f64; 3]], b: &[[f64; 3]]| -> Vec<[f64; 3]> {
        let pairs = a.iter().zip(b);
        pairs
            .map(|(a, b)| std::array::from_fn(|axis| b[axis] - a[axis]))
            .collect()
    };
    let length = |vector: &[f64; 3]| vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    let poses: Vec<Vec<[f64; 3]>> = { motion.joints().iter() }
        .map(|pose| pose.map(|point| point.map(f64::from)).to_vec())
        .collect();
    let velocities: Vec<Vec<[f64; 3]>> = poses
        .windows(2)
        .map(|pair| difference(&pair[0], &pair[1]))
        .collect();
    let accelerations = velocities
        .windows(2)
        .map(|pair| difference(&pair[0], &pair[1]).iter().map(length).collect());
    let rotations: Rotations = motion.rotations().into_owned();
    let turns = rotations.local().windows(2).map(|pair| {
        let joints = pair[0].iter().zip(&pair[1]);
        joints
            .map(|(a, b)| {
                let dot: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum();
                2.0 * dot.abs().min(1.0).acos()
            })
            .collect()
    });
    [
        { velocities.iter() }
            .map(|joints| joints.iter().map(length).collect())
            .collect(),
        accelerations.collect(),
        turns.collect(),
    ]
}

const SENTENCES: [&str; 6] = [
    "a person walks forward",
    "a person jumps",
    "a person waves with the left hand",
    "a person dances",
    "a person does squats",
    "a person turns left",
];

#[test]
fn the_seam_of_a_loop_is_like_any_other_step() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let tags = [Tag::Strong, Tag::Sudden, Tag::Near, Tag::Light];
    let requests: Vec<Request> = { SENTENCES.into_iter().zip(tags.into_iter().cycle()) }
        .map(|(sentence, tag)| {
            Request::new(sentence)
                .tag(tag)
                .seconds(4.0)
                .seed(5)
                .looped(true)
        })
        .collect();
    let generations = model.generate_all(&requests).unwrap();
    let mut failures = Vec::new();
    for (request, generation) in SENTENCES.iter().zip(&generations) {
        for motion in [&generation.baseline, &generation.guided] {
            let frames = motion.frames();
            assert_eq!(frames, 80);
            let [x, _, z] = motion.position(0, lamogen::Joint::Pelvis);
            assert!(x.hypot(z) < 0.15, "{request}: begins at {x}, {z}");
            let twice = motion.repeated(2).unwrap();
            // Of velocities there are two steps at the seam: from the last step to the seam's, and from there to the first. The
            // larger of two typical values is above a percentile of single ones more often than one in ten times. Where the body is at
            // its fastest when it passes the seam, the steps beside it are as large; and a millimetre is not seen.
            for ((what, steps), (seam, tolerance)) in ["position", "velocity", "rotation"]
                .iter()
                .zip(steps(&twice))
                .zip([
                    (frames - 1..frames, 1.0),
                    (frames - 2..frames, 1.3),
                    (frames - 1..frames, 1.0),
                ])
            {
                let values = means(&steps);
                let own = percentile_90(&values[..frames - 1]);
                let beside = [seam.start - 1, seam.end].map(|frame| values[frame]);
                let own = beside.into_iter().fold(own, f64::max);
                let unseen = if *what == "rotation" { 0.0 } else { 0.001 };
                let found = values[seam].iter().copied().fold(0.0, f64::max);
                if found > tolerance * own + unseen {
                    failures.push(format!("{request}: {what}: seam {found:.4}, own {own:.4}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn factors_hold_for_loops() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    for (tag, factor, component) in [(Tag::Strong, 1.5, 0), (Tag::Near, 0.5, 3)] {
        let request = Request::new("a person walks forward")
            .tag(tag)
            .seconds(3.0)
            .seed(2)
            .looped(true);
        let generation = model.generate(&request).unwrap();
        // Measured where the loop is played over its seam.
        let [baseline, guided] = [&generation.baseline, &generation.guided].map(|motion| {
            let three = motion.repeated(3).unwrap();
            let series = LabanSeries::of(&three, &LabanOptions::default(), &Device::flex());
            let values: Vec<f32> = (60..120)
                .map(|frame| series.frames()[frame][component])
                .collect();
            values.iter().sum::<f32>() / values.len() as f32
        });
        let found = guided / baseline;
        assert!((found / factor - 1.0).abs() < 0.1, "{tag}: {found}");
    }
}

#[test]
fn a_loop_that_the_network_has_no_room_for_is_refused() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let request = Request::new("a person walks forward")
        .seconds(9.8)
        .looped(true);
    let message = model.generate(&request).unwrap_err().to_string();
    assert!(message.contains("2.0 to 9.3 s"), "{message}");
}
