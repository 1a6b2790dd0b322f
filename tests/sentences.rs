//! Motions of several sentences, long motions, and motions that go on from others.

use lamogen::motion::Placement;
use lamogen::{
    BodyPart, Component, Device, Facing, Generation, Joint, LaMoGen, LabanOptions, LabanSeries,
    Motion, PartScale, PlaceOutcome, Preset, Request, Tag,
};

fn model() -> LaMoGen {
    LaMoGen::embedded(&Device::flex()).unwrap()
}

/// Returns the mean length over joints of the differences of an order of joint positions, in metres.
fn differences(joints: &[[[f32; 3]; 22]], order: usize) -> Vec<f32> {
    let mut rows: Vec<Vec<f32>> = { joints.iter() }
        .map(|pose| pose.as_flattened().to_vec())
        .collect();
    for _ in 0..order {
        let pairs = rows.windows(2);
        rows = pairs
            .map(|pair| pair[1].iter().zip(&pair[0]).map(|(b, a)| b - a).collect())
            .collect();
    }
    let length = |point: &[f32]| point.iter().map(|x| x * x).sum::<f32>().sqrt();
    { rows.iter() }
        .map(|row| row.chunks_exact(3).map(length).sum::<f32>() / 22.0)
        .collect()
}

/// Checks that the differences across a border are not larger than others of the motion.
fn is_smooth_at(joints: &[[[f32; 3]; 22]], border: usize, tolerance: f32) {
    for order in [1, 2, 3] {
        let values = differences(joints, order);
        let across = border - order..border;
        let largest = values[across.clone()].iter().copied().fold(0.0, f32::max);
        let others = [&values[..across.start], &values[across.end..]].concat();
        let most = others.into_iter().fold(0.0, f32::max);
        assert!(
            largest <= tolerance * most,
            "difference {order} at frame {border}: {largest}, at most {most} elsewhere"
        );
    }
}

/// Returns the ratios of the means of the components over some frames, after and before guidance.
fn changes(generation: &Generation, frames: std::ops::Range<usize>) -> [f32; 4] {
    let means = [&generation.baseline_laban, &generation.guided_laban]
        .map(|series| series.known_means(frames.clone()));
    std::array::from_fn(|component| means[1][component] / means[0][component])
}

#[test]
fn each_sentence_has_its_length_and_its_words() {
    let request = Request::new("a person walks forward")
        .seconds(3.0)
        .seed(3)
        .then(Request::new("a person jumps").seconds(2.0).tag(Tag::Strong))
        .then(
            Request::new("a person walks forward")
                .seconds(3.0)
                .part(PartScale::new(BodyPart::Arms).tag(Tag::Light).unwrap()),
        );
    let generation = model().generate(&request).unwrap();
    let motion = &generation.guided;
    assert_eq!(motion.frames(), 160);
    let sentences: Vec<_> = { generation.sentences.iter() }
        .map(|sentence| (&sentence.prompt[..], sentence.frames.clone()))
        .collect();
    assert_eq!(
        sentences,
        [
            ("a person walks forward", 0..60),
            ("a person jumps", 60..100),
            ("a person walks forward", 100..160)
        ]
    );
    // What is reported is what a file has.
    let device = Device::flex();
    let own = Motion::from_joints(motion.joints().to_vec()).unwrap();
    let own = LabanSeries::of(&own, &LabanOptions::default(), &device);
    for (found, reported) in own.frames().iter().zip(generation.guided_laban.frames()) {
        for (found, reported) in found.iter().zip(reported) {
            assert!((found - reported).abs() < 1e-4 * reported.max(1.0));
        }
    }
    let [walk, ..] = changes(&generation, 5..55);
    let [jump, ..] = changes(&generation, 64..96);
    assert!((walk - 1.0).abs() < 0.1, "{walk}");
    assert!((jump / 1.5 - 1.0).abs() < 0.1, "{jump}");
    // The arms, which only the third sentence speaks of.
    let arms = { generation.parts.iter() }
        .find(|part| part.end_effectors == *PartScale::new(BodyPart::Arms).end_effectors())
        .unwrap();
    let mean = |series: &LabanSeries| series.known_means(105..155)[0];
    let arms = mean(&arms.guided) / mean(&arms.baseline);
    assert!((arms / 0.5 - 1.0).abs() < 0.15, "{arms}");
    for border in [60, 100] {
        is_smooth_at(motion.joints(), border, 1.0);
        is_smooth_at(generation.baseline.joints(), border, 1.0);
    }
    assert!(generation.goals.to_string().contains("from 3 s Weight 1.5"));
    // The jump is where it was asked for: both feet are off the ground, and not while the body walks.
    let lowest = |frame: usize| {
        let feet = [Joint::LeftFoot, Joint::RightFoot];
        feet.map(|foot| motion.position(frame, foot)[1])
            .into_iter()
            .fold(f32::INFINITY, f32::min)
    };
    let highest = |frames: std::ops::Range<usize>| frames.map(lowest).fold(0.0, f32::max);
    let [walk, jump] = [highest(0..55), highest(60..100)];
    assert!(jump > 0.2 && walk < 0.08, "{jump} m, walking {walk} m");
}

#[test]
fn a_motion_of_one_sentence_may_be_longer_than_the_networks_longest() {
    let request = Request::new("a person walks forward").seconds(25.0).seed(1);
    let motion = model().generate(&request).unwrap().baseline;
    assert_eq!(motion.frames(), 500);
    let [pelvis, end] = [0, 499].map(|frame| motion.position(frame, Joint::Pelvis));
    assert!(
        (end[0] - pelvis[0]).hypot(end[2] - pelvis[2]) > 8.0,
        "{end:?}"
    );
    // A seed means one motion, and short motions are what they were.
    let again = model().generate(&request).unwrap().baseline;
    assert_eq!(motion, again);
}

#[test]
fn a_motion_goes_on_where_another_ends() {
    let model = model();
    let walk = Request::new("a person walks forward").seconds(4.0).seed(1);
    let walk = model.generate(&walk).unwrap().guided;
    // The clip may stand and face anywhere.
    let far = Placement::of(&walk.joints()[40]).to(&Placement::of(&walk.joints()[0]));
    let walk = Motion::from_rotations(far.of_rotations(&walk.rotations())).unwrap();
    for (sentence, seed) in [
        ("a person walks forward", 2),
        ("a person jumps", 3),
        ("a person turns around", 4),
    ] {
        let request = Request::new(sentence).seconds(3.0).seed(seed).after(&walk);
        let generation = model.generate(&request.tag(Tag::Strong)).unwrap();
        // A strong motion becomes faster than the clip.
        for (motion, tolerance) in [(&generation.baseline, 1.0), (&generation.guided, 1.2)] {
            assert_eq!(motion.frames(), 60);
            let joints = [walk.joints(), motion.joints()].concat();
            is_smooth_at(&joints, walk.frames(), tolerance);
        }
        // Goals set in within a second.
        let [change, ..] = changes(&generation, 20..60);
        assert!((change / 1.5 - 1.0).abs() < 0.1, "{sentence}: {change}");
        assert_eq!(generation.target.frames().len(), 60);
    }
}

#[test]
fn a_motion_that_goes_on_does_what_its_sentence_says() {
    let model = model();
    let stand = Request::new("a person stands still").seconds(3.0).seed(3);
    let stand = model.generate(&stand).unwrap().baseline;
    // A network that sees for long how a body stands goes on standing.
    let after = |sentence: &str, seed: u64| {
        let request = Request::new(sentence).seconds(4.0).seed(seed);
        model.generate(&request.after(&stand)).unwrap().baseline
    };
    for seed in 0..3 {
        let kick = after("a person kicks with the right leg", seed);
        let foot = |pose: &[[f32; 3]; 22]| pose[Joint::RightFoot.index()][1];
        let raised = kick.joints().iter().map(foot).fold(0.0, f32::max);
        assert!(raised > 0.4, "seed {seed}: the foot is raised by {raised}");
        let run = after("a person runs forward", seed);
        let end = run.position(run.frames() - 1, Joint::Pelvis);
        let start = run.position(0, Joint::Pelvis);
        let way = (end[0] - start[0]).hypot(end[2] - start[2]);
        assert!(way > 3.0, "seed {seed}: the run is {way} long");
    }
}

#[test]
fn a_motion_leads_from_one_to_another() {
    let model = model();
    let clip = |sentence: &str| {
        let request = Request::new(sentence).seconds(3.0).seed(1);
        model.generate(&request).unwrap().baseline
    };
    let (walk, kick) = (clip("a person walks forward"), clip("a person kicks"));
    let request = Request::new("a person walks forward")
        .seconds(3.0)
        .after(&walk);
    let motion = model.generate(&request.before(&kick)).unwrap().baseline;
    let from = [walk.joints(), motion.joints()].concat();
    is_smooth_at(&from, walk.frames(), 1.0);
    // The clip begins where the motion ends: it is moved there.
    let steps = motion.frames();
    let last = Placement::of(&motion.joints()[steps - 1]);
    let moved = Placement::of(&kick.joints()[0])
        .to(&last)
        .of_rotations(&kick.rotations());
    let relative =
        |pose: &[[f32; 3]; 22]| pose.map(|[x, y, z]| [x - pose[0][0], y, z - pose[0][2]]);
    let all = [motion.joints(), &moved.joints()].concat();
    let all: Vec<_> = all.iter().map(relative).collect();
    is_smooth_at(&all, steps, 1.0);
}

#[test]
fn a_motion_goes_on_from_another_through_places() {
    let model = model();
    let clip = |sentence: &str, seed| {
        let request = Request::new(sentence).seconds(3.0).seed(seed);
        model.generate(&request).unwrap().baseline
    };
    let walk = clip("a person walks forward", 1);
    // The clip may stand and face anywhere: here two metres away, facing left.
    let start = Placement::of(&walk.joints()[0]);
    let mut elsewhere = walk.joints()[0];
    for [x, _, z] in &mut elsewhere {
        [*x, *z] = [2.0 + *z, 1.0 - *x];
    }
    let elsewhere = start.to(&Placement::of(&elsewhere));
    let walk = Motion::from_rotations(elsewhere.of_rotations(&walk.rotations())).unwrap();
    let end = Placement::of(walk.joints().last().unwrap());
    let kick = clip("a person kicks", 1);
    let onward = || {
        let request = Request::new("a person walks forward").seconds(4.0).seed(2);
        request.after(&walk)
    };
    let path = "0:0,0 2:0.6,1.6 4:1.6,2.2";
    for (name, request) in [
        ("path", onward().path(path.parse().unwrap())),
        ("tag", onward().path(path.parse().unwrap()).tag(Tag::Light)),
        (
            "facing",
            onward()
                .path(path.parse().unwrap())
                .facing(Facing::degrees(-40.0).unwrap()),
        ),
        // Against the way that the sentence goes, the network stretches its legs.
        (
            "reach",
            Request::new("a person walks backward")
                .seconds(4.0)
                .seed(2)
                .after(&walk)
                .reach("left-hand@2=0.4,1.5,2".parse().unwrap()),
        ),
        ("before", onward().path(path.parse().unwrap()).before(&kick)),
    ] {
        let generation = model.generate(&request).unwrap();
        let motion = &generation.guided;
        assert_eq!(motion.frames(), 80);
        // Without tags nothing is asked of the components.
        assert_eq!(generation.goals.is_free(Component::Weight), name != "tag");
        let off = |outcome: &PlaceOutcome| outcome.distance();
        let farthest = generation.places.iter().map(off).fold(0.0, f32::max);
        assert!(farthest < 0.02, "{name}: {:?}", generation.places);
        // What is said is so in the motion that is returned: seen from where the clip ends.
        let seen = |frame: usize, joint: Joint| {
            end.to(&Placement::ORIGIN)
                .of_point(motion.position(frame, joint))
        };
        for (frame, joint, x, z) in match name {
            "reach" => vec![(40, Joint::LeftWrist, 0.4, 2.0)],
            _ => vec![(40, Joint::Pelvis, 0.6, 1.6), (79, Joint::Pelvis, 1.6, 2.2)],
        } {
            let found = seen(frame, joint);
            let off = (found[0] - x).hypot(found[2] - z);
            assert!(off < 0.025, "{name}: {found:?} at {frame}");
        }
        if name == "facing" {
            let poses = motion.joints();
            let turned = Placement::of(&poses[60]).heading() - end.heading();
            let turned = turned.sin().atan2(turned.cos()).to_degrees();
            assert!((turned + 40.0).abs() < 20.0, "{turned}");
        }
        let joints = [walk.joints(), motion.joints()].concat();
        is_smooth_at(&joints, walk.frames(), 1.05);
    }
}

#[test]
fn what_cannot_be_made_is_said() {
    let model = model();
    let walk = || Request::new("a person walks").seconds(3.0);
    let jump = || Request::new("a person jumps");
    let clip = model.generate(&walk()).unwrap().baseline;
    let frame = Motion::from_joints(clip.joints()[..1].to_vec()).unwrap();
    let changed = |change: fn(f32) -> f32| {
        let poses = clip.joints().iter();
        let poses = poses.map(|pose| pose.map(|point| point.map(change)));
        Motion::from_joints(poses.collect()).unwrap()
    };
    let point = changed(|_| 1.0);
    let huge = changed(|x| x * 1e9);
    let far = changed(|x| x + 1e6);
    for (request, parts) in [
        (
            walk().then(jump().seconds(1.0)),
            &["sentence 2", "40 to 72000 frames", "1 s"][..],
        ),
        (
            walk().then(jump().seconds(f32::NAN)),
            &["sentence 2", "NaN"],
        ),
        (walk().then(""), &["sentence 2", "empty"]),
        (
            walk().then(jump().seed(3)),
            &["sentence 2", "belong to the first"],
        ),
        (
            walk().then(jump().preset(Preset::Fast)),
            &["sentence 2", "belong to the first"],
        ),
        (
            walk().then(jump()).looped(true),
            &["one sentence for a loop"],
        ),
        (
            walk().after(&clip).looped(true),
            &["loop without a motion before"],
        ),
        (
            walk().after(&clip).path("4:0,1".parse().unwrap()),
            &["4 s", "0 to 3 s"],
        ),
        (walk().after(&frame), &["at least 2 frames", "found 1"]),
        (walk().before(&frame), &["at least 2 frames", "found 1"]),
        (
            walk().after(&point),
            &["to continue or to lead to", "legs of 0.01 to 1000 m", "0 m"],
        ),
        (walk().before(&huge), &["legs of 0.01 to 1000 m"]),
        (walk().after(&far), &["10000 leg lengths", " m away"]),
        (walk().seconds(3601.0), &["72000 frames", "3601 s"]),
        (
            (0..30).fold(walk(), |all, _| all.then(jump().seconds(3000.0))),
            &["an hour"],
        ),
    ] {
        let error = model.generate(&request).unwrap_err().to_string();
        for part in parts {
            assert!(error.contains(part), "{error}: {part}");
        }
    }
    let many = (0..9_999).fold(walk().frames(40), |all, _| all.then(jump().frames(40)));
    let error = model.check(&many).unwrap_err().to_string();
    assert!(error.contains("found 400000"), "{error}");
}

#[test]
fn a_run_that_is_stopped_says_how_far_it_came() {
    let model = model();
    let request = Request::new("a person walks")
        .then("a person jumps")
        .tag(Tag::Strong);
    let stopped = model.generate_with(&request, &mut |progress| match progress.done {
        10 => std::ops::ControlFlow::Break(()),
        _ => std::ops::ControlFlow::Continue(()),
    });
    let Err(lamogen::Error::Stopped(stopped)) = stopped else {
        panic!("the run was stopped");
    };
    let prediction = stopped.partial.unfinished[0].prediction.as_ref();
    assert_eq!(prediction.unwrap().frames(), 120);
}
