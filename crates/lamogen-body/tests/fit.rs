//! Tests of fits: bones stay rigid, standing feet do not slide, and feet in the air stay there.

use std::f32::consts::{FRAC_PI_2, PI};
use std::ops::ControlFlow;

use lamogen_body::{FitInput, FitObjective, FitOptions, ground};
use lamogen_motion::{
    BoneDrift, FRAMES_PER_SECOND, FootSliding, JOINTS, Joint, JointTurning, Motion, RestPose,
    Rotations, npy,
};

const FRAMES: usize = 60;

/// Returns the golden motion of the tests of pose features, with rigid bones. Like captured motion, it has joint positions
/// only.
fn captured() -> Motion {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../lamogen-motion/tests/golden/joints.npy"
    );
    let array = npy::read(path).unwrap();
    let (points, _) = array.values.as_chunks::<3>();
    let (poses, _) = points.as_chunks::<JOINTS>();
    let stretching = Motion::from_joints(poses.to_vec()).unwrap();
    Motion::from_joints(Rotations::of(&stretching).joints()).unwrap()
}

/// Returns a turn by an angle in radians about an axis of the world, as a quaternion.
fn turn(axis: usize, angle: f32) -> [f32; 4] {
    let mut q = [0.0, 0.0, 0.0, (angle / 2.0).cos()];
    q[axis] = (angle / 2.0).sin();
    q
}

/// Returns the motion of HumanML3D's body with the given root position in metres and local rotations at every frame.
fn body(
    root: impl Fn(usize) -> [f32; 3],
    rotations: impl Fn(usize, &mut [[f32; 4]; JOINTS]),
) -> Motion {
    let local = (0..FRAMES).map(|frame| {
        let mut pose = [turn(0, 0.0); JOINTS];
        rotations(frame, &mut pose);
        pose
    });
    let rotations = Rotations::new(
        RestPose::humanml3d(),
        (0..FRAMES).map(root).collect(),
        local.collect(),
        FRAMES_PER_SECOND,
    );
    // The motion has joint positions only, so the fit does not know these rotations.
    Motion::from_joints(rotations.joints()).unwrap()
}

/// Returns the height of the pelvis above the balls of the feet in the T-pose, in metres.
fn standing_height() -> f32 {
    let rest = RestPose::humanml3d();
    let leg = [
        Joint::LeftHip,
        Joint::LeftKnee,
        Joint::LeftAnkle,
        Joint::LeftFoot,
    ];
    -leg.iter().map(|joint| rest.offset(*joint)[1]).sum::<f32>()
}

fn fit(motion: &Motion, fit: &FitOptions) -> Motion {
    fit_on(motion, &RestPose::humanml3d(), fit)
}

/// Returns the input of a fit to a body on a ground at height 0.
fn input<'a>(motion: &'a Motion, body: &'a RestPose) -> FitInput<'a> {
    FitInput {
        motion,
        body,
        ground: 0.0,
        start: None,
    }
}

fn fit_on(motion: &Motion, body: &RestPose, fit: &FitOptions) -> Motion {
    let fitted = fit.run(&[input(motion, body)], None, &mut |_| {
        ControlFlow::Continue(())
    });
    assert!(!fitted.is_stopped);
    Motion::from_rotations(fitted.rotations.into_iter().next().unwrap()).unwrap()
}

fn largest_gap(a: &Motion, b: &Motion) -> f32 {
    let pairs = a
        .joints()
        .as_flattened()
        .iter()
        .zip(b.joints().as_flattened());
    let gap = |(a, b): (&[f32; 3], &[f32; 3])| {
        let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f32>().sqrt()
    };
    pairs.map(gap).fold(0.0, f32::max)
}

/// Returns the largest distance that a foot moves along the ground from one frame to the next, in metres.
fn largest_slide(motion: &Motion, foot: Joint, frames: std::ops::Range<usize>) -> f32 {
    let steps = frames.clone().zip(frames.skip(1));
    let slide = |(a, b)| {
        let [a, b] = [a, b].map(|frame| motion.position(frame, foot));
        (a[0] - b[0]).hypot(a[2] - b[2])
    };
    steps.map(slide).fold(0.0, f32::max)
}

#[test]
fn a_captured_clip_of_rigid_bones_is_reproduced_to_a_millimetre() {
    // All terms that ask for more than nearness are off or negligible.
    let near = FitOptions {
        evaluations: 300,
        jerk: 0.0,
        rotation: 0.0,
        haste: 0.0,
        stand: 0.0,
        clearance: 0.0,
        floor: 0.0,
        plane: 0.0,
        hinge: 0.0,
        prior: 1e-6,
        ..FitOptions::default()
    };
    let motion = captured();
    let fitted = fit_on(&motion, &RestPose::of(&motion), &near);
    let distance = fitted.distance(&motion);
    let largest = largest_gap(&fitted, &motion);
    println!("{distance} m, {largest} m at most");
    assert!(largest < 1e-3, "{distance} {largest}");
    assert!(BoneDrift::of(&fitted).largest() < 1e-5);
}

#[test]
fn feet_that_stand_stop_sliding_and_the_body_stays_where_it_is() {
    // A standing body drifts by 20 cm a second, with its feet 6 cm below the ground.
    let height = standing_height() - 0.06;
    let drifting = body(|frame| [0.0, height, 0.01 * frame as f32], |_, _| ());
    assert!(FootSliding::of(&drifting).speed > 0.19);
    let fitted = fit(&drifting, &FitOptions::default());
    let sliding = FootSliding::of(&fitted);
    assert!(sliding.speed < 0.02, "{sliding:?}");
    for foot in [Joint::LeftFoot, Joint::RightFoot] {
        assert!(largest_slide(&fitted, foot, 0..FRAMES) < 3e-3);
        let lowest = (0..FRAMES).map(|frame| fitted.position(frame, foot)[1]);
        let lowest = lowest.fold(f32::INFINITY, f32::min);
        assert!(lowest > -0.01, "{foot:?} is at {lowest}");
    }
}

#[test]
fn a_foot_in_the_air_is_not_pulled_down_and_a_jump_leaves_the_ground() {
    // The body rises by 40 cm and comes down again.
    let jump = body(
        |frame| {
            let lift = (frame as f32 / (FRAMES - 1) as f32 * std::f32::consts::PI).sin();
            [0.0, standing_height() + 0.4 * lift, 0.0]
        },
        |_, _| (),
    );
    let fitted = fit(&jump, &FitOptions::default());
    for foot in [Joint::LeftFoot, Joint::RightFoot] {
        let [before, after] = [&jump, &fitted].map(|motion| motion.position(FRAMES / 2, foot)[1]);
        assert!((before - after).abs() < 0.01, "{before} became {after}");
    }
    // One leg is held up during the whole motion.
    let held = body(
        |_| [0.0, standing_height(), 0.0],
        |_, pose| pose[Joint::LeftHip.index()] = turn(0, -1.2),
    );
    let fitted = fit(&held, &FitOptions::default());
    let foot = fitted.position(30, Joint::LeftFoot)[1];
    assert!((foot - held.position(30, Joint::LeftFoot)[1]).abs() < 0.01);
}

#[test]
fn a_body_that_lies_or_never_touches_the_ground_keeps_its_pose() {
    let lying = body(
        |frame| [0.0, 0.15 + 0.01 * (0.3 * frame as f32).sin(), 0.0],
        |_, pose| pose[0] = turn(0, -FRAC_PI_2),
    );
    let swimming = body(
        |frame| [0.0, 3.0, 0.05 * frame as f32],
        |frame, pose| {
            pose[0] = turn(0, 1.4);
            pose[Joint::LeftHip.index()] = turn(0, 0.4 * (0.5 * frame as f32).sin());
        },
    );
    for (motion, bound) in [(lying, 0.05), (swimming, 0.01)] {
        let fitted = fit(&motion, &FitOptions::default());
        assert!(
            fitted.distance(&motion) < bound,
            "{}",
            fitted.distance(&motion)
        );
    }
}

#[test]
fn elbows_and_knees_bend_one_way_only() {
    // The left knee and the right elbow overstretch by 20 degrees and back.
    let overstretched = body(
        |_| [0.0, standing_height(), 0.0],
        |frame, pose| {
            let share = (0.2 * frame as f32).sin().powi(2);
            pose[Joint::LeftKnee.index()] = turn(0, -0.35 * share);
            pose[Joint::RightElbow.index()] = turn(1, -0.35 * share);
            // Both are bent well at the end, which shows the direction in which they bend.
            if frame > 45 {
                pose[Joint::LeftKnee.index()] = turn(0, 0.1 * (frame - 45) as f32);
                pose[Joint::RightElbow.index()] = turn(1, 0.1 * (frame - 45) as f32);
            }
        },
    );
    let fitted = fit(&overstretched, &FitOptions::default());
    let rotations = fitted.rotations();
    for (joint, axis) in [(Joint::LeftKnee, 0), (Joint::RightElbow, 1)] {
        for pose in rotations.local() {
            let [.., w] = pose[joint.index()];
            let angle = 2.0 * (pose[joint.index()][axis] * w.signum()).asin().to_degrees();
            assert!(angle > -6.0, "{joint:?} bends by {angle} degrees");
        }
    }
}

#[test]
fn a_body_that_snaps_round_turns_like_one_that_has_weight() {
    let snapping = body(
        |_| [0.0, standing_height(), 0.0],
        |frame, pose| pose[0] = turn(1, if frame < 30 { 0.0 } else { 3.0 }),
    );
    let pelvis = |motion: &Motion| {
        JointTurning::of(&motion.rotations())
            .largest(Joint::Pelvis)
            .degrees
    };
    assert!(pelvis(&snapping) > 170.0);
    let fitted = fit(&snapping, &FitOptions::default());
    assert!(pelvis(&fitted) < 45.0, "{}", pelvis(&fitted));
    let far = [0, FRAMES - 1].map(|frame| {
        let [a, b] = [&fitted, &snapping].map(|motion| motion.position(frame, Joint::LeftWrist));
        (a[0] - b[0]).hypot(a[2] - b[2])
    });
    assert!(far.iter().all(|far| *far < 0.05), "{far:?}");
}

#[test]
fn motions_of_a_frame_or_three_and_bodies_without_bones_are_fitted_too() {
    let whole = captured();
    for frames in 1..5 {
        let short = Motion::from_joints(whole.joints()[..frames].to_vec()).unwrap();
        let fitted = fit(&short, &FitOptions::default());
        assert_eq!(fitted.frames(), frames);
    }
    let point = Motion::from_joints(vec![[[0.1, 0.2, 0.3]; JOINTS]; 8]).unwrap();
    let fitted = fit_on(&point, &RestPose::of(&point), &FitOptions::default());
    assert!(largest_gap(&fitted, &point) < 1e-3);
}

#[test]
fn a_motion_becomes_the_same_alone_beside_others_and_on_any_number_of_threads() {
    let (long, rest) = (captured(), RestPose::humanml3d());
    let short = Motion::from_joints(long.joints()[5..40].to_vec()).unwrap();
    let input = |motion| input(motion, &rest);
    let run = |inputs: &[FitInput<'_>], threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let run = || FitOptions::default().run(inputs, None, &mut |_| ControlFlow::Continue(()));
        pool.build().unwrap().install(run).rotations
    };
    let together = run(&[input(&long), input(&short)], 4);
    assert_eq!(together[0], run(&[input(&long)], 1)[0]);
    assert_eq!(together[1], run(&[input(&short)], 3)[0]);
}

/// An objective that draws one coordinate of a joint to a value in metres, from a frame on.
struct CoordinateObjective {
    joint: Joint,
    axis: usize,
    from: usize,
    value: f32,
}

impl FitObjective for CoordinateObjective {
    fn evaluate(
        &mut self,
        joints: &[Vec<[[f32; 3]; JOINTS]>],
    ) -> Vec<(f64, Vec<[[f64; 3]; JOINTS]>)> {
        let (joint, axis) = (self.joint.index(), self.axis);
        let evaluate = |poses: &Vec<[[f32; 3]; JOINTS]>| {
            let mut gradient = vec![[[0.0; 3]; JOINTS]; poses.len()];
            let mut value = 0.0;
            for (gradient, pose) in gradient.iter_mut().zip(poses).skip(self.from) {
                let off = pose[joint][axis] - self.value;
                value += f64::from(off * off);
                gradient[joint][axis] = f64::from(2.0 * off);
            }
            (value, gradient)
        };
        joints.iter().map(evaluate).collect()
    }
}

#[test]
fn a_goal_is_reached_and_a_stop_keeps_what_there_is() {
    let still = body(|_| [0.0, standing_height(), 0.0], |_, _| ());
    let rest = RestPose::humanml3d();
    let input = input(&still, &rest);
    let wrist = |rotations: &Rotations| rotations.joints()[30][Joint::RightWrist.index()][1];
    let before = still.position(30, Joint::RightWrist)[1];
    let requested = before + 0.2;
    let wrist_objective = || CoordinateObjective {
        joint: Joint::RightWrist,
        axis: 1,
        from: 0,
        value: requested,
    };
    let fit = FitOptions {
        goal: 100.0,
        ..FitOptions::default()
    };
    let whole = fit.run(&[input], Some(&mut wrist_objective()), &mut |_| {
        ControlFlow::Continue(())
    });
    assert!((wrist(&whole.rotations[0]) - requested).abs() < 0.03);

    let mut last_done = 0;
    let stopped = fit.run(&[input], Some(&mut wrist_objective()), &mut |progress| {
        last_done = progress.done;
        match progress.done {
            10 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    });
    assert!(stopped.is_stopped && last_done == 10);
    assert!(wrist(&stopped.rotations[0]) > before + 0.02);
}

#[test]
fn a_goal_makes_a_step_shorter_or_longer_and_feet_stand_where_it_ends() {
    // The body stands for a second, hops 40 cm ahead within half a second, and stands again.
    let progress = |frame: usize| ((frame as f32 - 20.0) / 10.0).clamp(0.0, 1.0);
    let hop = body(
        |frame| {
            let part = progress(frame);
            let lift = (part * std::f32::consts::PI).sin();
            [0.0, standing_height() + 0.15 * lift, 0.4 * part]
        },
        |_, _| (),
    );
    let rest = RestPose::humanml3d();
    let input = input(&hop, &rest);
    for place in [0.25, 0.55] {
        let mut goal = CoordinateObjective {
            joint: Joint::Pelvis,
            axis: 2,
            from: 32,
            value: place,
        };
        let fit = FitOptions {
            goal: 500.0,
            ..FitOptions::default()
        };
        let fitted = fit.run(
            &[input],
            Some(&mut goal),
            &mut |_| ControlFlow::Continue(()),
        );
        let fitted = Motion::from_rotations(fitted.rotations[0].clone()).unwrap();
        for foot in [Joint::LeftFoot, Joint::RightFoot] {
            // The body leans a little, too.
            let moved = fitted.position(45, foot)[2] - hop.position(45, foot)[2];
            let share = moved / (place - 0.4);
            assert!(share > 0.4, "{place}: {foot:?} moved by {moved}");
            for standing in [0..20, 33..FRAMES] {
                let slide = largest_slide(&fitted, foot, standing);
                assert!(slide < 5e-3, "{place}: {foot:?} slides by {slide}");
            }
        }
    }
}

#[test]
fn the_ground_is_as_low_as_the_feet_come() {
    let sunk = body(|_| [0.0, standing_height() - 0.5, 0.0], |_, _| ());
    assert!((ground(&sunk) + 0.5).abs() < 0.02, "{}", ground(&sunk));
    // Upside down, and on the back with raised legs: the hands, the head or the back are on the ground.
    let upside_down = body(|_| [0.0, 1.0, 0.0], |_, pose| pose[0] = turn(0, PI));
    let on_the_back = body(
        |_| [0.0, 0.1, 0.0],
        |_, pose| {
            pose[0] = turn(0, -FRAC_PI_2);
            for hip in [Joint::LeftHip, Joint::RightHip] {
                pose[hip.index()] = turn(0, -FRAC_PI_2);
            }
        },
    );
    for motion in [upside_down, on_the_back] {
        let joints = motion.joints().as_flattened().iter();
        let lowest = f64::from(joints.map(|joint| joint[1]).fold(f32::INFINITY, f32::min));
        assert!(
            (ground(&motion) - lowest).abs() < 1e-3,
            "{}",
            ground(&motion)
        );
    }
}
