//! Hands that touch each other or the body, on characters of other proportions, as they are in the files that are written.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use lamogen_character::{Character, CharacterOptions, RetargetOptions, SaveOptions};
use lamogen_motion::{JOINTS, Joint, Motion, RestPose, Rotations};

mod characters;

use characters::{AnimatedFile, TestCharacter};

/// The length of a hand from the wrist to the knuckles in units of the forearm.
const HAND_LENGTH: f64 = 0.33;

/// The left arm of the motion's body in its rest pose.
struct SourceArm {
    shoulder: DVec3,
    upper: DVec3,
    forearm: DVec3,
    /// The angle of the upper arm about itself in the T-pose, in radians: 0 if the elbow bends forwards, a quarter turn if
    /// downwards, and one back if upwards.
    twist: f64,
}

/// The angles of a left arm: the shoulder's about Y and Z, and the elbow's about Y, in radians.
type ArmAngles = [f64; 3];

impl SourceArm {
    fn new(rest: &RestPose, twist: f64) -> SourceArm {
        let place = |joint: Joint| {
            let joints = std::iter::successors(Some(joint), |joint| joint.parent());
            let offsets = joints.map(|joint| DVec3::from(rest.offset(joint).map(f64::from)));
            offsets.sum::<DVec3>()
        };
        let [shoulder, elbow, wrist] =
            [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist].map(place);
        SourceArm {
            shoulder,
            upper: elbow - shoulder,
            forearm: wrist - elbow,
            twist,
        }
    }

    fn turns(&self, [around, down, elbow]: ArmAngles) -> [DQuat; 2] {
        let swing = DQuat::from_rotation_y(around) * DQuat::from_rotation_z(down);
        let shoulder = swing * DQuat::from_rotation_x(self.twist);
        [shoulder, DQuat::from_rotation_y(elbow)]
    }

    fn palm(&self, angles: ArmAngles) -> DVec3 {
        let [shoulder, elbow] = self.turns(angles);
        let below = elbow * self.forearm * (1.0 + HAND_LENGTH);
        self.shoulder + shoulder * (self.upper + below)
    }

    /// Finds the angles near others that bring the palm to a place (Levenberg and Marquardt's method).
    fn reach(&self, target: DVec3, near: ArmAngles) -> ArmAngles {
        let error = |angles: DVec3| target - self.palm(angles.to_array());
        let (mut angles, mut damping) = (DVec3::from(near), 1e-3);
        for _ in 0..500 {
            let column = |axis: DVec3| (error(angles) - error(angles + 1e-6 * axis)) / 1e-6;
            let jacobian = DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
            let transposed = jacobian.transpose();
            let normal = transposed * jacobian + DMat3::from_diagonal(DVec3::splat(damping));
            let next = angles + normal.inverse() * (transposed * error(angles));
            match error(next).length() < error(angles).length() {
                true => (angles, damping) = (next, (damping / 3.0).max(1e-9)),
                false => damping = (damping * 4.0).min(1e3),
            }
        }
        assert!(error(angles).length() < 0.05, "{target}");
        angles.to_array()
    }
}

/// Returns a motion of a body that stands, of which the palms are at these places: the left one's, in metres above the root, and
/// the right one's as in a mirror.
fn motion_of_palms(places: impl Iterator<Item = DVec3>, near: ArmAngles, twist: f64) -> Motion {
    let rest = RestPose::humanml3d();
    let arm = SourceArm::new(&rest, twist);
    let mut angles = near;
    let local: Vec<[[f32; 4]; JOINTS]> = places
        .map(|place| {
            angles = arm.reach(place, angles);
            let mut turns = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
            for (joints, sign) in [
                ([Joint::LeftShoulder, Joint::LeftElbow], 1.0),
                ([Joint::RightShoulder, Joint::RightElbow], -1.0),
            ] {
                let found = arm.turns(angles.map(|angle| sign * angle));
                for (joint, turn) in joints.into_iter().zip(found) {
                    turns[joint.index()] = turn.to_array().map(|x| x as f32);
                }
            }
            turns
        })
        .collect();
    let root = vec![[0.0, 0.93, 0.0]; local.len()];
    Motion::from_rotations(Rotations::new(rest, root, local, 20.0)).unwrap()
}

/// The distance of the palms of the clapping motion at a frame: every 14 frames, hands meet at 6 cm.
fn clap_distance(frame: usize) -> f64 {
    0.06 + 0.25 * (1.0 - (frame as f64 * std::f64::consts::TAU / 14.0).cos())
}

fn claps() -> Motion {
    let palm = |frame| DVec3::new(clap_distance(frame) / 2.0, 0.28, 0.38);
    motion_of_palms((0..57).map(palm), [-0.6, -0.7, -1.2], 0.0)
}

/// Returns a motion whose hands go from where they hang to the hips, from frame 15 to 40, and back.
fn hands_to_hips() -> Motion {
    let [hanging, hips] = [DVec3::new(0.42, -0.05, 0.1), DVec3::new(0.185, 0.0, 0.0)];
    let palm = |frame: usize| {
        let time = frame as f64;
        let part = ((time - 5.0) / 10.0)
            .min((50.0 - time) / 10.0)
            .clamp(0.0, 1.0);
        hanging.lerp(hips, part * part * (3.0 - 2.0 * part))
    };
    motion_of_palms((0..56).map(palm), [0.2, -0.7, -1.3], FRAC_PI_2)
}

/// Returns a motion whose hands go to the temples, from frame 15 to 40, and back.
fn hands_to_head() -> Motion {
    let [free, head] = [DVec3::new(0.45, 0.4, 0.2), DVec3::new(0.115, 0.68, 0.05)];
    let palm = |frame: usize| {
        let time = frame as f64;
        let part = ((time - 5.0) / 10.0)
            .min((50.0 - time) / 10.0)
            .clamp(0.0, 1.0);
        free.lerp(head, part * part * (3.0 - 2.0 * part))
    };
    motion_of_palms((0..56).map(palm), [0.0, -0.1, -2.0], -FRAC_PI_2)
}

/// Bodies of other proportions than the motion's.
fn bodies() -> Vec<(&'static str, TestCharacter)> {
    let adult = TestCharacter::default();
    let body = |sizes, shoulders, head| TestCharacter {
        sizes,
        shoulders,
        head,
        ..adult.clone()
    };
    vec![
        ("an adult", adult.clone()),
        ("wide shoulders", body([1.0; 3], 1.6, 1.0)),
        ("narrow shoulders", body([1.0; 3], 0.6, 1.0)),
        ("long arms", body([1.0, 1.0, 1.5], 1.2, 1.0)),
        ("short arms", body([1.0, 1.0, 0.7], 1.0, 1.0)),
        ("a child", body([0.45, 0.7, 0.5], 0.6, 1.2)),
        ("a giant", body([3.0, 2.5, 3.5], 3.0, 2.0)),
        (
            "a mascot without a neck",
            TestCharacter {
                neck: false,
                own_axes: true,
                arms_down: 45.0,
                ..body([0.4, 0.9, 0.7], 1.3, 2.0)
            },
        ),
    ]
}

/// Returns the file of a character with a motion.
fn animated(
    test: &TestCharacter,
    motion: &Motion,
    place_hands: bool,
    folder: &Path,
) -> AnimatedFile {
    let [path, out] = ["hero.glb", "out.glb"].map(|name| folder.join(name));
    test.write(&path);
    let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
    let options = RetargetOptions {
        frames_per_second: 20.0,
        place_hands,
        ..RetargetOptions::default()
    };
    let animation = hero.animate(motion, &options).unwrap().named("move");
    hero.save(&out, &[animation], &SaveOptions::default())
        .unwrap();
    AnimatedFile::read(&out)
}

/// Returns the middle of the knuckles of a hand.
fn palm(file: &AnimatedFile, frame: usize, side: &str) -> DVec3 {
    let knuckles = ["Index", "Middle", "Ring", "Pinky"];
    let places =
        knuckles.map(|finger| file.position(frame, &format!("mixamorig:{side}Hand{finger}1")));
    places.iter().sum::<DVec3>() / 4.0
}

/// Returns the largest step of a palm or an elbow from frame to frame.
fn largest_step(file: &AnimatedFile) -> f64 {
    let steps = (1..file.frames()).flat_map(|frame| {
        ["Left", "Right"].into_iter().flat_map(move |side| {
            let elbow = format!("mixamorig:{side}ForeArm");
            let [palms, elbows] = [
                [frame, frame - 1].map(|frame| palm(file, frame, side)),
                [frame, frame - 1].map(|frame| file.position(frame, &elbow)),
            ];
            [palms, elbows].map(|[now, before]| now.distance(before))
        })
    });
    steps.fold(0.0, f64::max)
}

/// Returns the length of a test character's hand in units of the motion's body's.
fn hand_scale(test: &TestCharacter) -> f64 {
    let forearm = SourceArm::new(&RestPose::humanml3d(), 0.0).forearm.length();
    0.07 * test.sizes[2] / (HAND_LENGTH * forearm)
}

#[test]
fn hands_that_clap_meet_on_every_body() {
    let folder = tempfile::tempdir().unwrap();
    let motion = claps();
    for (name, test) in bodies() {
        let [free, placed] =
            [false, true].map(|place| animated(&test, &motion, place, folder.path()));
        let scale = hand_scale(&test);
        let between = |file: &AnimatedFile, frame| {
            palm(file, frame, "Left").distance(palm(file, frame, "Right"))
        };
        let claps = || (0..57).step_by(14);
        let error = |file: &AnimatedFile| {
            let errors = claps().map(|frame| (between(file, frame) - 0.06 * scale).abs());
            errors.fold(0.0, f64::max)
        };
        eprintln!(
            "clap: {name}: hands {:.1} cm apart instead of {:.1} cm before, {:.1} cm after; largest step {:.1} cm before, {:.1} cm after",
            100.0 * between(&free, 14),
            6.0 * scale,
            100.0 * between(&placed, 14),
            100.0 * largest_step(&free),
            100.0 * largest_step(&placed),
        );
        assert!(error(&placed) < 0.01 * scale, "{name}: {}", error(&placed));
        assert!(largest_step(&placed) < 1.6 * largest_step(&free), "{name}");
    }
}

/// Returns the height of the neck above the hips of a character and of the motion's body.
fn trunk_scale(file: &AnimatedFile, test: &TestCharacter) -> f64 {
    let at = |name: &str| file.position(0, &format!("mixamorig:{name}"));
    let top = match test.neck {
        true => at("Neck"),
        false => at("LeftArm").midpoint(at("RightArm")),
    };
    let rest = RestPose::humanml3d();
    let source = |joint: Joint| {
        let joints = std::iter::successors(Some(joint), |joint| joint.parent());
        let offsets = joints.map(|joint| DVec3::from(rest.offset(joint).map(f64::from)));
        offsets.sum::<DVec3>()
    };
    let source_top = match test.neck {
        true => source(Joint::Neck),
        false => source(Joint::LeftShoulder).midpoint(source(Joint::RightShoulder)),
    };
    let hips = at("LeftUpLeg").midpoint(at("RightUpLeg"));
    let source_hips = source(Joint::LeftHip).midpoint(source(Joint::RightHip));
    top.distance(hips) / source_top.distance(source_hips)
}

/// Returns where the left palm is relative to a place of the body, in units of the trunk of the motion's body: of the motion, and
/// of a character without and with hands that touch. `joints` are those of which the place is the middle.
fn palm_places(
    motion: &Motion,
    test: &TestCharacter,
    files: [&AnimatedFile; 2],
    joints: [(Joint, &str); 2],
) -> [DVec3; 3] {
    const FRAME: usize = 30;
    let joint = |joint: Joint| DVec3::from(motion.position(FRAME, joint).map(f64::from));
    let [elbow, wrist] = [Joint::LeftElbow, Joint::LeftWrist].map(joint);
    let source = wrist + HAND_LENGTH * (wrist - elbow);
    let [first, second] = joints.map(|(place, _)| joint(place));
    let places = files.map(|file| {
        let at = |(_, name): (Joint, &str)| file.position(FRAME, &format!("mixamorig:{name}"));
        let origin = at(joints[0]).midpoint(at(joints[1]));
        (palm(file, FRAME, "Left") - origin) / trunk_scale(file, test)
    });
    [source - first.midpoint(second), places[0], places[1]]
}

#[test]
fn hands_on_the_hips_are_on_the_hips_of_every_body() {
    let folder = tempfile::tempdir().unwrap();
    let motion = hands_to_hips();
    for (name, test) in bodies() {
        let [free, placed] =
            [false, true].map(|place| animated(&test, &motion, place, folder.path()));
        let hips = [
            (Joint::LeftHip, "LeftUpLeg"),
            (Joint::RightHip, "RightUpLeg"),
        ];
        let [source, before, after] = palm_places(&motion, &test, [&free, &placed], hips);
        eprintln!(
            "hips: {name}: palm {:.2} beside and {:.2} above the hips in the motion, {:.2} and {:.2} before, {:.2} and {:.2} after; largest step {:.1} cm before, {:.1} cm after",
            source.x,
            source.y,
            before.x,
            before.y,
            after.x,
            after.y,
            100.0 * largest_step(&free),
            100.0 * largest_step(&placed),
        );
        // Arms that are too short come as near as they can.
        let is_in_reach = test.sizes[2] >= test.sizes[1] && test.neck;
        let [missed_before, missed] = [before, after].map(|place| (place.y - source.y).abs());
        match is_in_reach {
            true => assert!(missed < 0.06, "{name}: {after} in place of {source}"),
            false => assert!(missed < missed_before + 0.01, "{name}"),
        }
        assert!((0.13..0.3).contains(&after.x), "{name}: {after}");
        assert!(largest_step(&placed) < 1.6 * largest_step(&free), "{name}");
        // Where nothing touches, arms are as they are without.
        for frame in (0..3).chain(placed.frames() - 3..placed.frames()) {
            for node in placed.names() {
                let [with, without] = [&placed, &free].map(|file| file.position(frame, node));
                assert!(with.distance(without) < 1e-6, "{name}: {node}, {frame}");
            }
        }
    }
}

#[test]
fn hands_at_the_head_come_nearer_to_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let motion = hands_to_head();
    for (name, test) in bodies() {
        let [free, placed] =
            [false, true].map(|place| animated(&test, &motion, place, folder.path()));
        let head = [(Joint::Head, "Head"); 2];
        let [source, before, after] = palm_places(&motion, &test, [&free, &placed], head);
        let [missed_before, missed] = [before, after].map(|place| place.distance(source));
        eprintln!(
            "head: {name}: {missed_before:.2} from its place before, {missed:.2} after; largest step {:.1} cm before, {:.1} cm after",
            100.0 * largest_step(&free),
            100.0 * largest_step(&placed),
        );
        assert!(missed < missed_before + 0.01, "{name}");
        assert!(largest_step(&placed) < 1.6 * largest_step(&free), "{name}");
    }
}
