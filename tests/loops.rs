//! Loops: the last frame leads into the first, in the sampling and on the body.

use lamogen::motion::Rotations;
use lamogen::{Device, LaMoGen, Motion, Request, Tag};

/// The largest of the values over the joints, at every frame.
fn largest(steps: &[Vec<f64>]) -> Vec<f64> {
    steps
        .iter()
        .map(|joints| joints.iter().copied().fold(0.0, f64::max))
        .collect()
}

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
            let twice = motion.repeated(2).unwrap();
            // Of accelerations, the two at the seam count: from the last step to the seam's, and from there to the first.
            for ((what, steps), seam) in ["position", "velocity", "rotation"]
                .iter()
                .zip(steps(&twice))
                .zip([frames - 1..frames, frames - 2..frames, frames - 1..frames])
            {
                for (kind, values) in [("mean", means(&steps)), ("largest", largest(&steps))] {
                    let own = percentile_90(&values[..frames - 1]);
                    let found = values[seam.clone()].iter().copied().fold(0.0, f64::max);
                    let line =
                        format!("{request}: {kind} step of {what}: seam {found:.4}, own {own:.4}");
                    println!("{line}");
                    if found > own {
                        failures.push(line);
                    }
                }
            }
        }
    }
    println!("{} of {}", failures.len(), 12 * SENTENCES.len());
    assert!(failures.is_empty(), "{failures:#?}");
}
