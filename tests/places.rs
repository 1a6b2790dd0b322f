//! Places at which bodies shall be: paths, positions to reach, and both beside tags.

use lamogen::files::{ReadOptions, WriteOptions, read, write};
use lamogen::motion::{FootSliding, Jitter};
use lamogen::{
    Device, Facing, Generation, Joint, LaMoGen, Motion, PlaceOutcome, Places, Reach, ReachPart,
    Request, Tag, TimeSummary,
};

fn model() -> LaMoGen {
    LaMoGen::embedded(&Device::flex()).unwrap()
}

/// Writes a motion to a file and reads it back.
fn through_file(motion: &Motion) -> Motion {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.bvh");
    write(&path, motion, &WriteOptions::default()).unwrap();
    read(&path, &ReadOptions::default()).unwrap().motion
}

/// Returns the largest distance from the places, in metres.
fn farthest(places: &Places, motion: &Motion) -> f32 {
    let outcomes = places.outcomes(motion);
    assert!(!outcomes.is_empty());
    outcomes
        .iter()
        .map(PlaceOutcome::distance)
        .fold(0.0, f32::max)
}

/// Returns where a body faces at a frame, in degrees to the left of the start.
fn facing(motion: &Motion, frame: usize) -> f32 {
    let across = |axis: usize| {
        let at = |joint| motion.position(frame, joint)[axis];
        at(Joint::LeftHip) - at(Joint::RightHip) + at(Joint::LeftShoulder)
            - at(Joint::RightShoulder)
    };
    (-across(2)).atan2(across(0)).to_degrees()
}

fn path(text: &str) -> Places {
    Places {
        path: Some(text.parse().unwrap()),
        ..Places::default()
    }
}

#[test]
fn a_walk_follows_its_path_with_steps() {
    let places = path("0:0,0 2:1,0 4:1,2");
    let request = Request::new("a person walks forward").seconds(4.0);
    let request = request.places(places.clone());
    let requests = [1, 2].map(|seed| request.clone().seed(seed));
    for result in model().generate_all(&requests).unwrap() {
        let [baseline, guided] = [&result.baseline, &result.guided].map(through_file);
        assert!(farthest(&places, &baseline) > 1.0);
        // Measured: 0.1 cm.
        assert!(farthest(&places, &guided) < 0.02, "{:?}", result.places);
        // The body turns to the left and back again. It keeps up with the path within the sway of a walk.
        let turned = facing(&guided, 25);
        assert!((45.0..135.0).contains(&turned), "{turned}");
        assert!(facing(&guided, 70).abs() < 40.0, "{}", facing(&guided, 70));
        let [jerk, jerk_on_path] = [&baseline, &guided].map(|motion| Jitter::of(motion).jerk);
        assert!(jerk_on_path < 1.15 * jerk, "{jerk} {jerk_on_path}");
        // Measured: 0.2 m/s, and 0.14 to 0.2 without the path.
        let sliding = FootSliding::of(&guided).speed;
        assert!(sliding < 0.3, "{sliding}");
        // Feet leave the ground.
        let heights = |foot: Joint| {
            let heights = (0..guided.frames()).map(|frame| guided.position(frame, foot)[1]);
            heights.fold(0.0, f32::max)
        };
        for foot in [Joint::LeftFoot, Joint::RightFoot] {
            assert!(heights(foot) > 0.05, "{foot:?} {}", heights(foot));
        }
    }
}

#[test]
fn hands_feet_and_head_reach_positions() {
    let reaches: [&[&str]; 3] = [
        &["left-hand@1.5=0.3,1.8,0.2", "right-hand@1.5=-0.3,1.8,0.2"],
        &["right-hand@1.5=-0.2,0.4,0.5"],
        &["left-hand@1=0.1,1.4,0.7", "head@2=0.1,1.4,0.2"],
    ];
    let sentences = [
        "a person raises both hands",
        "someone picks something up",
        "a person throws a punch",
    ];
    let model = model();
    for (sentence, reaches) in sentences.into_iter().zip(reaches) {
        let places = Places {
            reaches: reaches.iter().map(|text| text.parse().unwrap()).collect(),
            ..Places::default()
        };
        let request = Request::new(sentence).seed(1).places(places.clone());
        let result = model.generate(&request).unwrap();
        let [before, after] = [&result.baseline, &result.guided]
            .map(|motion| farthest(&places, &through_file(motion)));
        assert!(before > 0.05, "{sentence}: {before}");
        // Measured: 0.1 cm.
        assert!(after < 0.02, "{sentence}: {after}, {:?}", result.places);
    }
}

#[test]
fn tags_hold_on_a_path() {
    let places = path("2:0.5,2 4:2,4");
    let request = Request::new("a person walks forward").seconds(4.0).seed(1);
    let request = request.tag(Tag::Strong).places(places.clone());
    let result = model().generate(&request).unwrap();
    assert!(farthest(&places, &through_file(&result.guided)) < 0.02);
    let weight = |series: &lamogen::LabanSeries| series.summary(TimeSummary::Mean)[0];
    let reached = weight(&result.guided_laban) / weight(&result.target);
    assert!((0.9..1.1).contains(&reached), "{reached}");
}

#[test]
fn a_body_faces_where_it_is_told_on_its_path() {
    let request = Request::new("a person steps to the left").seed(1);
    let request = request.path("1.5:0.5,0 3:1,0".parse().unwrap());
    let model = model();
    let at_the_end = |facing_asked: Facing| {
        let result = model
            .generate(&request.clone().facing(facing_asked))
            .unwrap();
        facing(&result.guided, 55)
    };
    let forward = at_the_end(Facing::Degrees(0.0));
    assert!(forward.abs() < 25.0, "{forward}");
    let along = at_the_end(Facing::Path);
    assert!((55.0..125.0).contains(&along), "{along}");
}

#[test]
fn outcomes_and_terms_say_what_files_hold() {
    let reach = Reach::new(ReachPart::RightHand, 1.5, [-0.3, 1.5, 0.3]).unwrap();
    let request = Request::new("a person walks forward").seed(3).steps(5);
    let request = request.path("1:0,0.6 2.5:0.5,1.5".parse().unwrap());
    let result = model().generate(&request.clone().reach(reach)).unwrap();
    let names: Vec<&str> = result.places.iter().map(|place| place.name).collect();
    assert_eq!(names, ["pelvis", "pelvis", "right-hand"]);
    let guided = through_file(&result.guided);
    for place in &result.places {
        let frame = (place.seconds * 20.0) as usize;
        let joint = match place.name {
            "pelvis" => Joint::Pelvis,
            _ => Joint::RightWrist,
        };
        for (own, found) in place.reached.into_iter().zip(guided.position(frame, joint)) {
            assert!((own - found).abs() < 1e-3, "{place}");
        }
    }
    let terms: Vec<&str> = result.terms.iter().map(|term| &*term.name).collect();
    assert_eq!(terms, ["path", "facing", "right-hand at 1.5 s"]);
    let term = &result.terms[2];
    assert_eq!(term.target[30], reach.position());
    assert!(term.weight[30][0] > 0.0 && term.weight[29][0] == 0.0);
    assert_eq!(term.guided[30], result.places[2].reached);
    // Without places nothing is said.
    let alone = model()
        .generate(&Request::new("a person sits").steps(2))
        .unwrap();
    assert!(alone.places.is_empty() && alone.terms.is_empty());
}

#[test]
fn equal_places_run_together_and_as_they_run_alone() {
    let request = Request::new("a person walks forward").steps(4);
    let request = request.path("3:0.5,2".parse().unwrap());
    let requests = [
        request.clone().seed(1),
        request.clone().seed(2),
        // The end of a longer motion is another frame.
        request.clone().seed(1).seconds(4.0),
    ];
    let model = model().with_batch_size(3);
    let together = model.generate_all(&requests).unwrap();
    for (request, result) in requests.iter().zip(&together) {
        let alone: Generation = model.generate(request).unwrap();
        let distance = alone.guided.distance(&result.guided);
        assert!(distance < 1e-3, "{distance}");
        assert!(result.places[0].distance() < 0.02, "{}", result.places[0]);
    }
}

#[test]
fn places_that_a_request_cannot_have_are_refused() {
    let model = model();
    let request = || Request::new("a person walks").seconds(3.0);
    let refused = |request: Request| model.generate(&request).unwrap_err().to_string();
    for (request, parts) in [
        (
            request().path("0:0,0 4:0,2".parse().unwrap()),
            &["0 to 3 s", "found 4 s"][..],
        ),
        (
            request().reach("head@3.5=0,1.5,0".parse().unwrap()),
            &["0 to 3 s", "found 3.5 s"],
        ),
        (
            request()
                .reach("head@1=0,1.5,0".parse().unwrap())
                .reach("head@1=0,1.2,0".parse().unwrap()),
            &["head@1=0,1.5,0", "head@1=0,1.2,0"],
        ),
        (
            request().path("1:0,1".parse().unwrap()).looped(true),
            &["a path or a loop, found both"],
        ),
    ] {
        let message = refused(request);
        for part in parts {
            assert!(message.contains(part), "{message}");
        }
    }
}

#[test]
fn a_body_takes_the_poses_of_other_motions() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let clip = |sentence: &str| {
        let request = Request::new(sentence).seconds(3.0).seed(1);
        model.generate(&request).unwrap().guided
    };
    let (squat, wave) = (clip("a person squats"), clip("a person raises both hands"));
    let request = Request::new("a person stands and moves")
        .seconds(4.0)
        .seed(2)
        .pose(1.5, &squat, 25)
        .unwrap()
        .pose(3.0, &wave, 30)
        .unwrap();
    let generation = model.generate(&request).unwrap();
    // The frames of a file, read back.
    let joints = Motion::from_joints(generation.guided.joints().to_vec()).unwrap();
    for (seconds, source, frame) in [(1.5, &squat, 25), (3.0, &wave, 30)] {
        let pose = lamogen::KeyPose::new(seconds, source.joints()[frame]).unwrap();
        let distances = pose.distances(&joints.joints()[(seconds * 20.0) as usize]);
        let mean = distances.iter().sum::<f32>() / 22.0;
        assert!(mean < 0.03, "{mean} m at {seconds} s");
    }
    let outcomes = &generation.places;
    assert_eq!(outcomes.len(), 2);
    assert!(
        outcomes[0]
            .to_string()
            .starts_with("pose at 1.5 s: joints ")
    );
    assert!(outcomes.iter().all(|outcome| outcome.distance() < 0.03));
    let request = Request::new("a person stands").seconds(2.0);
    for (request, part) in [
        (request.clone().pose(2.5, &squat, 0).unwrap(), "2.5 s"),
        (
            request
                .pose(1.0, &squat, 0)
                .and_then(|request| request.pose(1.01, &squat, 5))
                .unwrap(),
            "same frame",
        ),
    ] {
        let error = model.generate(&request).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}
