//! Tests of the checks on an artificial body that does one action at a time.

use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Motion};

use super::*;

type Pose = [[f32; 3]; JOINTS];

/// Returns the pose of a body that stands at the origin and faces z; x is its left.
fn standing() -> Pose {
    let mut pose = [[0.0; 3]; JOINTS];
    let mut put = |joint: Joint, place: [f32; 3]| pose[joint.index()] = place;
    put(Joint::Pelvis, [0.0, 0.94, 0.0]);
    put(Joint::Spine1, [0.0, 1.06, 0.0]);
    put(Joint::Spine2, [0.0, 1.18, 0.0]);
    put(Joint::Spine3, [0.0, 1.24, 0.0]);
    put(Joint::Neck, [0.0, 1.45, 0.0]);
    put(Joint::Head, [0.0, 1.55, 0.02]);
    for (side, x) in [(Side::Left, 1.0), (Side::Right, -1.0)] {
        let of = |left: Joint| match side {
            Side::Left => left,
            Side::Right => left.mirrored(),
        };
        put(of(Joint::LeftHip), [0.08 * x, 0.87, 0.0]);
        put(of(Joint::LeftKnee), [0.08 * x, 0.47, 0.01]);
        put(of(Joint::LeftAnkle), [0.08 * x, 0.06, 0.0]);
        put(of(Joint::LeftFoot), [0.08 * x, 0.0, 0.12]);
        put(of(Joint::LeftCollar), [0.06 * x, 1.36, 0.0]);
        put(of(Joint::LeftShoulder), [0.17 * x, 1.38, 0.0]);
        put(of(Joint::LeftElbow), [0.2 * x, 1.12, 0.0]);
        put(of(Joint::LeftWrist), [0.2 * x, 0.87, 0.02]);
    }
    pose
}

/// Returns a motion of three seconds. `change` changes the standing pose at every time, which goes from 0 to 1.
fn motion(change: impl Fn(f32, &mut Pose)) -> Motion {
    let frames = 3 * FRAMES_PER_SECOND as usize;
    let poses = (0..frames).map(|frame| {
        let mut pose = standing();
        change(frame as f32 / (frames - 1) as f32, &mut pose);
        pose
    });
    Motion::from_joints(poses.collect()).unwrap()
}

/// Turns a pose to its left about the origin, and then moves it along the ground.
fn carry(pose: &mut Pose, degrees: f32, to: [f32; 2]) {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    for place in pose {
        let [x, y, z] = *place;
        *place = [
            x * cosine + z * sine + to[0],
            y,
            z * cosine - x * sine + to[1],
        ];
    }
}

/// Moves joints along an axis: 0 is to the left, 1 up, 2 forward.
fn shift(pose: &mut Pose, joints: &[Joint], axis: usize, by: f32) {
    for joint in joints {
        pose[joint.index()][axis] += by;
    }
}

/// Lowers all joints but the feet, and bends the knees forward.
fn sink(pose: &mut Pose, by: f32) {
    for joint in Joint::ALL {
        match joint {
            Joint::LeftAnkle | Joint::RightAnkle | Joint::LeftFoot | Joint::RightFoot => {}
            joint => shift(pose, &[joint], 1, -by),
        }
    }
    for knee in [Joint::LeftKnee, Joint::RightKnee] {
        // The knee is half way between hip and ankle, and so far forward that the bones keep their lengths.
        let height = (0.81 - by) / 2.0;
        let place = &mut pose[knee.index()];
        place[1] = 0.06 + height;
        place[2] = (0.405_f32.powi(2) - height.powi(2)).max(0.0).sqrt();
    }
}

/// Lays the body on the ground along z, face down.
fn lie(pose: &mut Pose) {
    for place in pose.iter_mut() {
        let [x, y, _] = *place;
        *place = [x, 0.1, y - 0.94];
    }
}

/// Returns a wave that goes from 0 to 1 and back to 0, `times` times while `time` goes from 0 to 1.
fn wave(time: f32, times: f32) -> f32 {
    (1.0 - (std::f32::consts::TAU * times * time).cos()) / 2.0
}

/// Returns the mirror image of a motion, with left and right exchanged.
fn mirrored(motion: &Motion) -> Motion {
    let poses = motion.joints().iter().map(|pose| {
        Joint::ALL.map(|joint| {
            let [x, y, z] = pose[joint.mirrored().index()];
            [-x, y, z]
        })
    });
    Motion::from_joints(poses.collect()).unwrap()
}

fn does(motion: &Motion, words: &str) -> bool {
    let check: Check = words.parse().unwrap();
    check.judge(&Measurements::of(motion)).holds()
}

/// Asserts that a check of the left side holds for a motion and the same check of the right side does not, and the
/// reverse for the mirror image.
fn assert_left(motion: &Motion, words: &str) {
    let other = words.replace("left", "right");
    assert!(does(motion, words) && !does(motion, &other), "{words}");
    let image = mirrored(motion);
    assert!(does(&image, &other) && !does(&image, words), "{other}");
}

#[test]
fn a_standing_body_passes_no_checks_but_those_of_standing() {
    let still = motion(|_, _| {});
    let done = Check::ALL.iter().filter(|(words, _)| does(&still, words));
    let done: Vec<&str> = done.map(|(words, _)| *words).collect();
    assert_eq!(done, ["goes slowly", "stays", "stands still"]);
    let measured = Measurements::of(&still);
    assert!((measured.stance_median - 1.0).abs() < 0.05, "{measured:?}");
}

#[test]
fn travel_is_seen_from_the_body_wherever_it_faces() {
    for heading in [0.0, 70.0, 170.0, -100.0] {
        let going = |forward: f32, left: f32| {
            motion(move |time, pose| {
                shift(pose, &Joint::ALL, 0, left * time);
                shift(pose, &Joint::ALL, 2, forward * time);
                carry(pose, heading, [5.0, -3.0]);
            })
        };
        assert!(does(&going(3.0, 0.0), "travels forward"));
        assert!(does(&going(-3.0, 0.0), "travels backward"));
        assert!(!does(&going(3.0, 0.0), "travels backward"));
        assert!(!does(&going(3.0, 0.0), "runs"));
        assert!(does(&going(9.0, 0.0), "runs"));
        assert!(does(&going(2.0, 0.0), "goes slowly"));
        assert!(!does(&going(6.0, 0.0), "goes slowly"));
        assert_left(&going(0.0, 2.0), "travels left");
        assert!(!does(&going(4.0, 0.5), "travels left"), "drifts");
        let measured = Measurements::of(&going(1.0, 2.0));
        assert!((measured.net_forward - 1.0).abs() < 1e-3);
        assert!((measured.net_left - 2.0).abs() < 1e-3);
    }
}

#[test]
fn turns_are_told_apart_by_side_and_angle() {
    let turning = |degrees: f32| motion(move |time, pose| carry(pose, degrees * time, [0.0; 2]));
    assert_left(&turning(90.0), "turns left");
    assert_left(&turning(90.0), "turns a quarter left");
    assert_left(&turning(180.0), "turns around left");
    assert!(does(&turning(-180.0), "turns around"));
    assert!(!does(&turning(90.0), "turns around"));
    assert!(!does(&turning(180.0), "turns a quarter left"));
    // Turns of more than half a turn, and of more than a whole one, are measured in full.
    let found = Measurements::of(&turning(700.0)).turn;
    assert!((found - 700.0).abs() < 60.0, "{found}");
    assert!(!does(&turning(360.0), "turns in a circle"), "on the spot");
    let circle = motion(|time, pose| {
        let around = 360.0 * time;
        shift(pose, &Joint::ALL, 0, -1.0);
        carry(pose, around, [0.0; 2]);
    });
    assert_left(&circle, "turns in a circle left");
    assert!(does(&circle, "travels forward"));
}

#[test]
fn stopping_and_starting_are_told_apart() {
    let going = |way: fn(f32) -> f32| {
        motion(move |time, pose| shift(pose, &Joint::ALL, 2, 4.0 * way(time)))
    };
    let (stops, starts) = (
        going(|time| time.min(0.6)),
        going(|time| (time - 0.4).max(0.0)),
    );
    assert!(does(&stops, "stops") && !does(&stops, "starts"));
    assert!(does(&starts, "starts") && !does(&starts, "stops"));
}

#[test]
fn the_hand_that_goes_up_is_named() {
    let arm = [Joint::LeftElbow, Joint::LeftWrist];
    let raised = motion(|time, pose| shift(pose, &arm, 1, 0.8 * wave(time, 1.0)));
    assert_left(&raised, "raises left hand");
    assert_left(&raised, "raises left hand over head");
    let low = motion(|time, pose| shift(pose, &arm, 1, 0.2 * wave(time, 1.0)));
    assert!(!does(&low, "raises left hand"));
    let both = motion(|time, pose| {
        let wrists = [Joint::LeftWrist, Joint::RightWrist];
        shift(pose, &wrists, 1, 0.9 * wave(time, 1.0));
    });
    assert!(does(&both, "raises both hands over head") && !does(&both, "raises left hand"));
    // One after the other is not both at once.
    let turns = motion(|time, pose| {
        let wrist = [Joint::LeftWrist, Joint::RightWrist][usize::from(time > 0.5)];
        shift(pose, &[wrist], 1, 0.9 * wave(time, 2.0));
    });
    assert!(!does(&turns, "raises both hands"));
    let drinks = motion(|time, pose| {
        let (from, to) = ([0.2, 0.87, 0.02], [0.05, 1.5, 0.2]);
        let part = wave(time, 1.0);
        pose[Joint::LeftWrist.index()] =
            std::array::from_fn(|axis| from[axis] + part * (to[axis] - from[axis]));
    });
    assert!(does(&drinks, "brings a hand to the head"));
    assert!(!does(&low, "brings a hand to the head"));
}

#[test]
fn the_fist_that_is_thrust_out_is_named() {
    let punch = motion(|time, pose| {
        let guard = [Joint::LeftWrist, Joint::RightWrist];
        for wrist in guard {
            pose[wrist.index()][1] = 1.35;
            pose[wrist.index()][2] = 0.2;
        }
        let out = wave((time * 4.0).min(1.0), 1.0);
        shift(pose, &[Joint::LeftWrist], 2, 0.4 * out);
    });
    assert_left(&punch, "punches left");
    assert!(does(&punch, "punches"));
}

#[test]
fn the_leg_that_kicks_rises_or_stands_is_named() {
    let swung = |degrees: f32, times: f32| {
        motion(move |time, pose| {
            let (sine, cosine) = (degrees * wave(time, times)).to_radians().sin_cos();
            let hip = pose[Joint::LeftHip.index()];
            for joint in [Joint::LeftKnee, Joint::LeftAnkle, Joint::LeftFoot] {
                let [x, y, z] = pose[joint.index()];
                let (y, z) = (y - hip[1], z - hip[2]);
                let turned = [y * cosine + z * sine, z * cosine - y * sine];
                pose[joint.index()] = [x, hip[1] + turned[0], hip[2] + turned[1]];
            }
        })
    };
    assert_left(&swung(80.0, 3.0), "kicks left");
    assert!(does(&swung(80.0, 3.0), "kicks"));
    assert!(!does(&swung(20.0, 3.0), "kicks left"), "too low");
    assert!(!does(&swung(80.0, 1.0), "kicks left"), "too slow");
    let knee = motion(|time, pose| {
        let up = wave(time, 1.0);
        shift(pose, &[Joint::LeftKnee], 1, 0.4 * up);
        shift(pose, &[Joint::LeftKnee], 2, 0.4 * up);
        shift(pose, &[Joint::LeftAnkle, Joint::LeftFoot], 1, 0.4 * up);
    });
    assert_left(&knee, "raises left knee");
    assert!(!does(&knee, "kicks left"));
    let balance = motion(|_, pose| shift(pose, &[Joint::RightAnkle, Joint::RightFoot], 1, 0.3));
    assert_left(&balance, "stands on left leg");
    assert!(does(&balance, "stands on one leg"));
}

#[test]
fn squats_are_counted() {
    for (times, words) in [
        (1.0, "squats once"),
        (2.0, "squats twice"),
        (3.0, "squats three times"),
    ] {
        let squats = motion(|time, pose| sink(pose, 0.4 * wave(time, times)));
        for words_of_all in ["squats once", "squats twice", "squats three times"] {
            assert_eq!(
                does(&squats, words_of_all),
                words_of_all == words,
                "{words}"
            );
        }
    }
    let once = motion(|time, pose| sink(pose, 0.4 * wave(time, 1.0)));
    assert!(does(&once, "sits down and gets up") && does(&once, "crouches"));
    let shallow = motion(|time, pose| sink(pose, 0.1 * wave(time, 2.0)));
    assert!(!does(&shallow, "squats twice"));
}

#[test]
fn lunges_need_the_named_foot() {
    let ahead = motion(|time, pose| {
        sink(pose, 0.3 * wave(time, 1.0));
        shift(pose, &[Joint::LeftAnkle, Joint::LeftFoot], 2, 0.3);
        shift(pose, &[Joint::RightAnkle, Joint::RightFoot], 2, -0.3);
    });
    assert_left(&ahead, "lunges left");
    let aside = motion(|time, pose| {
        let part = wave(time, 1.0);
        sink(pose, 0.4 * part);
        // The left foot stays under the body with its knee bent; the right leg is stretched out to the side.
        pose[Joint::LeftKnee.index()] = [0.1, 0.42, 0.3 * part];
        for (joint, x, y) in [
            (Joint::RightKnee, -0.5, 0.25),
            (Joint::RightAnkle, -0.85, 0.06),
            (Joint::RightFoot, -0.85, 0.0),
        ] {
            pose[joint.index()][0] = x;
            pose[joint.index()][1] = y;
        }
    });
    assert_left(&aside, "lunges aside left");
}

#[test]
fn a_jump_leaves_the_floor_and_a_step_does_not() {
    let jumping = |times: f32, forward: f32| {
        motion(move |time, pose| {
            // The body is on the floor half of the time.
            let up = (2.0 * wave(time, times) - 1.0).max(0.0);
            shift(pose, &Joint::ALL, 1, 0.3 * up);
            shift(pose, &Joint::ALL, 2, forward * time);
        })
    };
    let [once, thrice] = [1.0, 3.0].map(|times| jumping(times, 0.0));
    assert!(does(&once, "jumps") && does(&once, "jumps in place"));
    assert!(!does(&once, "jumps again and again") && !does(&once, "jumps forward"));
    assert!(does(&thrice, "jumps again and again"));
    assert!(!does(&thrice, "does jumping jacks"));
    let long = jumping(1.0, 1.5);
    assert!(does(&long, "jumps forward") && !does(&long, "jumps in place"));
    let steps = motion(|time, pose| {
        let feet = [Joint::LeftAnkle, Joint::LeftFoot];
        let left = (std::f32::consts::TAU * 3.0 * time).sin() > 0.0;
        for foot in feet {
            let foot = if left { foot } else { foot.mirrored() };
            shift(pose, &[foot], 1, 0.2);
        }
    });
    assert!(does(&steps, "steps in place") && !does(&steps, "jumps"));
    let jacks = motion(|time, pose| {
        let part = wave(time, 3.0);
        shift(pose, &Joint::ALL, 1, 0.3 * (2.0 * part - 1.0).max(0.0));
        for (joint, up, aside) in [(Joint::LeftWrist, 0.9, 0.0), (Joint::LeftAnkle, 0.0, 0.3)] {
            shift(pose, &[joint, joint.mirrored()], 1, up * part);
            shift(pose, &[joint], 0, aside * part);
            shift(pose, &[joint.mirrored()], 0, -aside * part);
        }
    });
    assert!(does(&jacks, "does jumping jacks"));
}

#[test]
fn sitting_lying_and_getting_up_are_told_apart() {
    let sits = |way: fn(f32) -> f32| motion(move |time, pose| sink(pose, 0.4 * way(time)));
    let down = sits(|time| (3.0 * time - 1.0).clamp(0.0, 1.0));
    let up = sits(|time| (2.0 - 3.0 * time).clamp(0.0, 1.0));
    assert!(does(&down, "sits down") && !does(&down, "stands up") && !does(&down, "goes down"));
    assert!(does(&up, "stands up") && !does(&up, "sits down") && !does(&up, "goes up"));
    let lying = |is: fn(f32) -> bool| {
        motion(move |time, pose| {
            if is(time) {
                lie(pose);
            }
        })
    };
    let [down, flat, up] = [|time| time > 0.5, |_| true, |time| time < 0.5].map(lying);
    for (motion, done) in [(&down, "lies down"), (&flat, "lies"), (&up, "gets up")] {
        for words in ["lies down", "lies", "gets up"] {
            assert_eq!(
                does(motion, words),
                words == done,
                "{words}, where it {done}"
            );
        }
    }
    let crawl = |way: f32| {
        motion(move |time, pose| {
            lie(pose);
            shift(pose, &Joint::ALL, 2, way * time);
        })
    };
    assert!(does(&crawl(1.0), "crawls forward") && !does(&crawl(1.0), "crawls backward"));
    assert!(does(&crawl(-1.0), "crawls backward") && !does(&flat, "crawls forward"));
}

#[test]
fn kneeling_puts_a_knee_to_the_floor() {
    let kneels = motion(|time, pose| {
        let down = (2.0 * time).min(1.0);
        sink(pose, 0.4 * down);
        pose[Joint::RightKnee.index()][1] = 0.47 - 0.42 * down;
    });
    assert!(does(&kneels, "kneels"));
    assert!(!does(
        &motion(|time, pose| sink(pose, 0.4 * time)),
        "kneels"
    ));
}

#[test]
fn stairs_change_the_height_of_a_body_that_stands() {
    let steps = |way: f32| motion(move |time, pose| shift(pose, &Joint::ALL, 1, way * time));
    assert!(does(&steps(0.5), "goes up") && !does(&steps(0.5), "goes down"));
    assert!(does(&steps(-0.5), "goes down") && !does(&steps(-0.5), "goes up"));
}

#[test]
fn a_hand_that_picks_up_goes_low_and_comes_back() {
    let reach = |way: fn(f32) -> f32| {
        motion(move |time, pose| {
            let part = way(time);
            sink(pose, 0.1 * part);
            shift(pose, &[Joint::RightWrist], 1, -0.5 * part);
        })
    };
    assert!(does(&reach(|time| wave(time, 1.0)), "picks up"));
    assert!(!does(&reach(|time| time), "picks up"), "stays down");
    assert!(
        !does(&reach(|time| 0.3 * wave(time, 1.0)), "picks up"),
        "not low"
    );
}

#[test]
fn a_bow_inclines_the_trunk_and_a_flip_more_than_that() {
    let bent = |degrees: f32| {
        motion(move |time, pose| {
            let (sine, cosine) = (degrees * wave(time, 1.0)).to_radians().sin_cos();
            let neck = Joint::Neck.index();
            pose[neck][2] = 0.51 * sine;
            pose[neck][1] = 0.94 + 0.51 * cosine;
        })
    };
    assert!(does(&bent(60.0), "bends forward") && !does(&bent(60.0), "goes upside down"));
    assert!(!does(&bent(15.0), "bends forward"));
    assert!(does(&bent(150.0), "goes upside down"));
}

#[test]
fn dancing_is_lively_and_goes_nowhere() {
    let limbs = [
        Joint::LeftWrist,
        Joint::RightWrist,
        Joint::LeftElbow,
        Joint::RightElbow,
        Joint::LeftKnee,
        Joint::RightAnkle,
    ];
    let dancing = |way: f32| {
        motion(move |time, pose| {
            shift(pose, &limbs, 2, 0.25 * wave(time, 6.0));
            shift(pose, &Joint::ALL, 2, way * time);
        })
    };
    assert!(does(&dancing(0.5), "dances") && !does(&dancing(5.0), "dances"));
    assert!(!does(&dancing(0.0), "stands still"));
}

#[test]
fn measurements_of_a_mirror_image_have_sides_swapped() {
    let some = motion(|time, pose| {
        shift(pose, &[Joint::LeftWrist], 1, time);
        sink(pose, 0.2 * wave(time, 1.0));
        shift(pose, &[Joint::LeftAnkle], 2, 0.3 * time);
        carry(pose, 50.0 * time, [time, 2.0 * time]);
    });
    let [of, image] = [&some, &mirrored(&some)].map(Measurements::of);
    for (one, other) in [
        (of.turn, -image.turn),
        (of.net_left, -image.net_left),
        (of.advance, image.advance),
        (of.squats, image.squats),
        (of.hand_over_shoulder[0], image.hand_over_shoulder[1]),
        (of.foot_ahead[0], image.foot_ahead[1]),
        (of.foot_speed[0], image.foot_speed[1]),
    ] {
        assert!((one - other).abs() < 1e-4, "{one} and {other}");
    }
}

#[test]
fn the_measurements_of_a_single_frame_are_finite() {
    let single = Motion::from_joints(vec![standing()]).unwrap();
    let measured = serde_json::to_string(&Measurements::of(&single)).unwrap();
    // Numbers that are not finite are written as null.
    assert!(!measured.contains("null"), "{measured}");
}

#[test]
fn checks_are_read_as_they_are_written() {
    for (words, check) in Check::ALL {
        assert_eq!(words.parse(), Ok(*check));
        assert_eq!(check.to_string(), *words);
    }
    let message = "flies".parse::<Check>().unwrap_err().to_string();
    assert!(message.contains("`flies`"), "{message}");
}
