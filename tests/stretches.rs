//! Long motions, which are made a stretch at a time, and streams.

use std::ops::{ControlFlow, Range};

use lamogen::{
    BodyPart, Component, Device, Error, Factor, Generation, Goal, Goals, LaMoGen, LabanOptions,
    LabanSeries, Motion, PartScale, PlaceOutcome, Places, Request, Scale, Tag,
};

fn model() -> LaMoGen {
    LaMoGen::embedded(&Device::flex()).unwrap()
}

fn strong() -> Scale {
    Scale::from_tags(&[Tag::Strong]).unwrap()
}

/// Returns the steps of all joints from one frame to the next, the largest of each frame, in metres.
fn steps(joints: &[[[f32; 3]; 22]]) -> Vec<f32> {
    let step = |pair: &[[[f32; 3]; 22]]| {
        let [from, to] = [&pair[0], &pair[1]];
        let lengths = from.iter().zip(to).map(|(a, b)| {
            let square = |axis: usize| (b[axis] - a[axis]).powi(2);
            (square(0) + square(1) + square(2)).sqrt()
        });
        lengths.fold(0.0, f32::max)
    };
    joints.windows(2).map(step).collect()
}

/// Checks that no joint leaps from the frame before each border to the border.
fn goes_on_at(joints: &[[[f32; 3]; 22]], borders: &[usize]) {
    let steps = steps(joints);
    let mut sorted = steps.clone();
    sorted.sort_by(f32::total_cmp);
    let most = sorted[steps.len() * 99 / 100];
    for &border in borders {
        assert!(
            steps[border - 1] <= 1.3 * most,
            "{} m at frame {border}, 99 % of the steps are at most {most}",
            steps[border - 1]
        );
    }
}

fn mean_change(generation: &Generation, frames: Range<usize>) -> f32 {
    let means = [&generation.baseline_laban, &generation.guided_laban]
        .map(|series| series.known_means(frames.clone())[0]);
    means[1] / means[0]
}

/// Returns the smallest and the largest speed of the pelvis along the ground in the half second after frame 180, where a stretch
/// ends, relative to the mean of the half second before. Slower ones than 0.2 m/s count as that: a body that stands sways.
fn speeds_after_180_frames(motion: &Motion) -> [f32; 2] {
    let speeds: Vec<f32> = { motion.joints().windows(2) }
        .map(|pair| (pair[1][0][0] - pair[0][0][0]).hypot(pair[1][0][2] - pair[0][0][2]))
        .map(|speed| speed.max(0.01))
        .collect();
    let before = speeds[169..179].iter().sum::<f32>() / 10.0;
    let after = { speeds[179..190].iter() }.map(|speed| speed / before);
    [f32::min, f32::max].map(|of| after.clone().reduce(of).unwrap())
}

#[test]
fn goals_that_change_at_a_border_are_reached_without_a_leap() {
    let model = model();
    for seed in 1..=8 {
        let strong_then_light = Factor::parse(Component::Weight, "0:1.5 9:0.6").unwrap();
        let goals = Goals::default().with(Component::Weight, strong_then_light);
        let request = Request::new("a person walks forward")
            .seconds(18.0)
            .seed(seed)
            .scale(goals);
        let generation = model.generate(&request).unwrap();
        // The factor changes where the first of two stretches ends.
        let [slowest, fastest] = speeds_after_180_frames(&generation.guided);
        assert!(
            slowest > 0.3 && fastest < 1.4,
            "seed {seed}: the pelvis moves at {slowest} to {fastest} times its speed before"
        );
        // Goals are reached within 0.8 s.
        for (frames, expected) in [(5..175, 1.5), (196..355, 0.6)] {
            let change = mean_change(&generation, frames);
            assert!(
                (change / expected - 1.0).abs() < 0.1,
                "seed {seed}: {change} instead of {expected}"
            );
        }
    }
}

#[test]
fn a_long_motion_goes_on_from_stretch_to_stretch_with_its_goals() {
    let arms = PartScale::new(BodyPart::Arms).tag(Tag::Light).unwrap();
    let walk = || Request::new("a person walks forward");
    let request = walk()
        .seconds(18.0)
        .seed(3)
        .scale(
            Goals::default()
                .with(
                    Component::Weight,
                    Factor::parse(Component::Weight, "0:1.5 9:0.6").unwrap(),
                )
                .with(Component::Shape, Goal::Peak(0.9)),
        )
        .then(walk().seconds(6.0))
        .then(walk().seconds(4.0).part(arms));
    let generation = model().generate(&request).unwrap();
    let motion = &generation.guided;
    assert_eq!(motion.frames(), 560);
    // 18 s are two stretches of 180 frames; the others share one.
    goes_on_at(motion.joints(), &[180, 360]);
    goes_on_at(generation.baseline.joints(), &[180, 360]);
    // Where the factor changes from 1.5 to 0.6 at once, the body slows down without leaping ahead or stopping first. Energy is the
    // square of speed, so a walk has 0.63 of its speed then, and less in the middle of a step.
    let [slowest, fastest] = speeds_after_180_frames(motion);
    assert!(
        slowest >= 0.3 && fastest < 1.4,
        "the pelvis moves at {slowest} to {fastest} times its speed before"
    );
    for (frames, expected) in [(5..175, 1.5), (196..355, 0.6), (385..475, 1.0)] {
        let change = mean_change(&generation, frames.clone());
        assert!(
            (change / expected - 1.0).abs() < 0.1,
            "{frames:?}: {change} instead of {expected}"
        );
    }
    // The peak is that of both stretches together.
    let shape = |series: &LabanSeries| -> Vec<f32> {
        let values = series.frames()[..360].iter().map(|values| values[3]);
        values.collect()
    };
    let [target, guided] = [&generation.target, &generation.guided_laban].map(shape);
    let peak = target.iter().copied().fold(0.0, f32::max);
    // Shape is a box along the axes of the room, and so are the targets of every stretch.
    assert!((peak / 0.9 - 1.0).abs() < 0.05, "{peak}");
    let change = guided.iter().sum::<f32>() / target.iter().sum::<f32>();
    assert!((change - 1.0).abs() < 0.1, "{change}");
    let part = { generation.parts.iter() }
        .find(|part| part.end_effectors == BodyPart::Arms.into())
        .unwrap();
    for series in [&part.baseline, &part.target, &part.guided] {
        assert_eq!(series.frames().len(), 560);
    }
    let [arms, before] =
        [&part.guided, &part.baseline].map(|series| series.known_means(505..555)[0]);
    assert!(
        (arms / before / 0.5 - 1.0).abs() < 0.15,
        "{}",
        arms / before
    );
    // What is reported is what a file has.
    let own = Motion::from_joints(motion.joints().to_vec()).unwrap();
    let own = LabanSeries::of(&own, &LabanOptions::default(), &Device::flex());
    for (found, reported) in own.frames().iter().zip(generation.guided_laban.frames()) {
        for (found, reported) in found.iter().zip(reported) {
            assert!((found - reported).abs() < 1e-4 * reported.max(1.0));
        }
    }
    assert_eq!(generation.target.frames().len(), 560);
    assert_eq!(generation.network.guided.frames(), 560);
    assert_eq!(generation.sentences.len(), 3);
    assert_eq!(generation.sentences[2].frames, 480..560);
}

#[test]
fn a_long_run_that_is_stopped_has_the_stretches_before() {
    let model = model();
    let request = Request::new("a person walks")
        .seconds(32.0)
        .steps(2)
        .tag(Tag::Strong);
    let mut total = 0;
    let stop_at = |step: usize, total: &mut usize| {
        let stopped = model.generate_with(&request, &mut |progress| {
            *total = progress.total;
            assert!(progress.done <= progress.total);
            match progress.done >= step {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        });
        match stopped {
            Err(Error::Stopped(stopped)) => stopped.partial.unfinished.into_iter().next().unwrap(),
            other => panic!("expected a stop, found {other:?}"),
        }
    };
    let early = stop_at(1, &mut total);
    assert!(early.finished.is_none() && early.baseline.is_none());
    // The passes of the network and the fits of three stretches.
    assert!(total > 3 * (2 + 2));
    let mut guided_stops = 0;
    let mut stops = Vec::new();
    let stopped = model.generate_with(&request, &mut |progress| {
        let is_first = progress.step.pass == lamogen::Pass::Guided && progress.step.index == 0;
        guided_stops += usize::from(is_first);
        stops.push(progress.done);
        match guided_stops {
            2 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    });
    let Err(Error::Stopped(stopped)) = stopped else {
        panic!("the run was stopped");
    };
    let unfinished = &stopped.partial.unfinished[0];
    assert_eq!(unfinished.baseline.as_ref().unwrap().frames(), 640);
    let finished = unfinished.finished.as_ref().unwrap();
    assert_eq!((finished.motion.frames(), finished.is_guided), (213, true));
}

#[test]
fn a_stream_goes_on_and_takes_what_comes() {
    let model = model();
    let mut stream = model
        .stream(&Request::new("a person walks forward").seconds(6.0).seed(2))
        .unwrap();
    let first = stream.next().unwrap().unwrap();
    assert_eq!((first.frames.clone(), first.sentence), (0..60, 0));
    // The first stretch is what the same request gives on its own.
    let alone = Request::new("a person walks forward").seconds(3.0).seed(2);
    assert_eq!(
        first.generation.guided,
        model.generate(&alone).unwrap().guided
    );
    stream.steer(strong()).unwrap();
    let second = stream.next().unwrap().unwrap();
    assert_eq!(second.frames, 60..120);
    let change = mean_change(&second.generation, 22..60);
    assert!((change / 1.5 - 1.0).abs() < 0.12, "{change}");
    assert!(stream.next().is_none());
    stream
        .then(&Request::new("a person jumps").seconds(5.0))
        .unwrap();
    let jump = stream.next().unwrap().unwrap();
    assert_eq!((jump.frames.clone(), jump.sentence), (120..170, 1));
    stream
        .replace(&Request::new("a person walks forward").seconds(3.0))
        .unwrap();
    let last = stream.next().unwrap().unwrap();
    assert_eq!((last.frames.clone(), last.sentence), (170..230, 2));
    assert!(stream.next().is_none());
    assert_eq!(stream.frames(), 230);
    let stretches = [first, second, jump, last];
    let joints: Vec<_> = { stretches.iter() }
        .flat_map(|stretch| stretch.generation.guided.joints().to_vec())
        .collect();
    goes_on_at(&joints, &[60, 120, 170]);
}

#[test]
fn stretches_are_as_short_as_the_model_allows() {
    let model = model();
    let walk = Request::new("a person walks forward").seconds(5.0).steps(2);
    let stream = model.stream(&walk).unwrap().with_longest_stretch(2.0);
    let frames: Vec<_> = stream.map(|stretch| stretch.unwrap().frames).collect();
    assert_eq!(frames, [0..50, 50..100]);
}

#[test]
fn a_stream_begins_where_a_motion_ends() {
    let model = model();
    let walk = Request::new("a person walks forward").seconds(3.0).seed(1);
    let clip = model.generate(&walk).unwrap().guided;
    let request = Request::new("a person jumps").seconds(3.0).after(&clip);
    let first = model.stream(&request).unwrap().next().unwrap().unwrap();
    let joints = [clip.joints(), first.generation.guided.joints()].concat();
    goes_on_at(&joints, &[60]);
}

/// Returns the largest distance from a place in metres.
fn farthest(places: &[PlaceOutcome]) -> f32 {
    places
        .iter()
        .map(PlaceOutcome::distance)
        .fold(0.0, f32::max)
}

#[test]
fn a_long_motion_goes_through_its_places() {
    // Two stretches, with a place where the second would begin, and a clip before them.
    let walk = || Request::new("a person walks forward");
    let model = model();
    let clip = model.generate(&walk().seconds(3.0).seed(1)).unwrap().guided;
    let request = walk()
        .seconds(18.0)
        .seed(3)
        .path("3:0,3 9:3,7 16:-1,9 18:-2.5,9".parse().unwrap())
        .reach("left-hand@9.3=3.6,1.3,7.2".parse().unwrap())
        .after(&clip);
    let generation = model.generate(&request).unwrap();
    let motion = &generation.guided;
    assert_eq!(motion.frames(), 360);
    let names: Vec<&str> = generation.places.iter().map(|place| place.name).collect();
    assert_eq!(names, ["pelvis", "pelvis", "pelvis", "pelvis", "left-hand"]);
    assert!(
        farthest(&generation.places) < 0.02,
        "{:?}",
        generation.places
    );
    let joints = [clip.joints(), motion.joints()].concat();
    goes_on_at(&joints, &[60, 60 + 176, 60 + 187]);
    // Nothing is asked of the components.
    assert_eq!(generation.goals, Goals::anything());
    // With a tag the places stay, and the factor holds.
    let strong = model.generate(&request.tag(Tag::Strong)).unwrap();
    assert!(farthest(&strong.places) < 0.03, "{:?}", strong.places);
    let change = mean_change(&strong, 25..355);
    assert!((change / 1.5 - 1.0).abs() < 0.1, "{change}");
}

#[test]
fn a_stream_is_led_through_places() {
    let model = model();
    let walk = Request::new("a person walks forward")
        .seconds(8.0)
        .seed(2)
        .path("0:0,0 4:0,4 8:3,6".parse().unwrap());
    let mut stream = model.stream(&walk).unwrap();
    let first = stream.next().unwrap().unwrap();
    // The place at four seconds is where the second stretch would have begun.
    assert_eq!(first.frames, 0..81);
    assert_eq!(first.generation.places.len(), 2);
    // Where the body shall go changes on the way, to a place beyond what has been added.
    let lead = |path: &str, reaches: &[&str]| Places {
        path: Some(path.parse().unwrap()),
        reaches: reaches.iter().map(|text| text.parse().unwrap()).collect(),
        ..Places::default()
    };
    let late = stream.lead(lead("2:0,1", &[])).unwrap_err().to_string();
    assert!(
        late.contains("found 2 s") && late.contains("from 4.05 s on"),
        "{late}"
    );
    stream
        .lead(lead("0:0,0 12:-3,9", &["head@7=-0.8,1.3,6"]))
        .unwrap();
    let second = stream.next().unwrap().unwrap();
    assert_eq!(second.frames, 81..160);
    assert_eq!(second.generation.places.len(), 1);
    assert!(stream.next().is_none());
    stream
        .then(&Request::new("a person walks forward").seconds(4.0))
        .unwrap();
    let third = stream.next().unwrap().unwrap();
    assert_eq!(third.frames, 160..240);
    assert_eq!(third.generation.places[0].seconds, 12.0);
    let stretches = [first, second, third];
    for stretch in &stretches {
        let places = &stretch.generation.places;
        assert!(farthest(places) < 0.02, "{places:?}");
    }
    let joints: Vec<_> = { stretches.iter() }
        .flat_map(|stretch| stretch.generation.guided.joints().to_vec())
        .collect();
    goes_on_at(&joints, &[81, 160]);
    // Halfway between the last two places the body is on its way.
    let pelvis = joints[170][0];
    assert!(pelvis[0] < -0.5 && pelvis[2] > 6.0, "{pelvis:?}");
}

#[test]
fn what_a_stream_cannot_do_is_said() {
    let model = model();
    let walk = || Request::new("a person walks").seconds(3.0);
    let message = |request: &Request| model.stream(request).err().unwrap().to_string();
    for (request, part) in [
        (walk().looped(true), "found a loop"),
        (walk().path("0:0,0 4:1,0".parse().unwrap()), "found 4 s"),
        (
            walk().guidance(lamogen::Guidance::paper()).tag(Tag::Strong),
            "found the network's own body",
        ),
        (walk().seconds(0.5), "0.5 s"),
        (Request::new(""), "empty"),
    ] {
        assert!(message(&request).contains(part), "{}", message(&request));
    }
    let mut stream = model.stream(&walk()).unwrap();
    let error = stream.then(&walk().seed(3)).unwrap_err().to_string();
    assert!(error.contains("belong to the first"), "{error}");
    let error = stream.replace(&Request::new(" ")).unwrap_err().to_string();
    assert!(error.contains("empty"), "{error}");
    let late = Goals::default().with(
        Component::Weight,
        Factor::parse(Component::Weight, "9:2").unwrap(),
    );
    let error = stream.steer(late).unwrap_err().to_string();
    assert!(error.contains('9'), "{error}");
    // Nothing of this has changed the stream.
    let stopped = stream.next_with(&mut |_| ControlFlow::Break(()));
    assert!(matches!(stopped, Some(Err(Error::Stopped(_)))));
    assert_eq!(stream.next().unwrap().unwrap().frames, 0..60);
}
