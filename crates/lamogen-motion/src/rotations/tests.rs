use std::f64::consts::{PI, TAU};

use super::*;
use crate::limb::bend_limb;
use crate::skeleton::Joint::*;
use crate::skeleton::LEGS;

/// Lengths of the bones of HumanML3D's body in metres, indexed by the joint in which they end.
const LENGTHS: [f64; JOINTS] = [
    0.0, 0.103, 0.110, 0.132, 0.394, 0.390, 0.143, 0.432, 0.426, 0.057, 0.143, 0.149, 0.219, 0.137,
    0.143, 0.103, 0.132, 0.123, 0.257, 0.263, 0.266, 0.270,
];

/// Returns a body in T-pose with these bone lengths.
fn body() -> RestPose {
    let mut pose = [[0.0; 3]; JOINTS];
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            let offset = rest::direction(joint) * LENGTHS[joint.index()];
            let place = vector(pose[parent.index()]) + offset;
            pose[joint.index()] = place.as_vec3().to_array();
        }
    }
    RestPose::of(&Motion::from_joints(vec![pose]).unwrap())
}

/// Returns known rotations of that body, and the motion that they give.
fn moved(frames: usize, turn: impl Fn(usize, Joint) -> DQuat) -> (Rotations, Motion) {
    let rotations = Rotations {
        rest: body(),
        root: (0..frames)
            .map(|t| [0.01 * t as f32, 0.9, 0.02 * t as f32])
            .collect(),
        local: (0..frames)
            .map(|t| Joint::ALL.map(|joint| turn(t, joint).to_array().map(|x| x as f32)))
            .collect(),
        frames_per_second: FRAMES_PER_SECOND,
        loop_travel: None,
    };
    let motion = Motion::from_joints(rotations.joints()).unwrap();
    (rotations, motion)
}

/// Returns the largest distance in metres between the joints of a motion and those that rotations give.
fn error(rotations: &Rotations, motion: &Motion) -> f32 {
    rotations.distance(motion).largest
}

/// Returns the largest turn of a joint from one frame to the next in degrees, its frame, and the joint's name.
fn largest_step(rotations: &Rotations) -> (f64, usize, &'static str) {
    let mut largest = (0.0, 0, "");
    for (t, pair) in rotations.local().windows(2).enumerate() {
        for joint in Joint::ALL {
            let [a, b] = [0, 1].map(|i| quaternion(pair[i][joint.index()]));
            let step = a.angle_between(b).to_degrees();
            if step > largest.0 {
                largest = (step, t, joint.name());
            }
        }
    }
    largest
}

/// Returns whether quaternions, and not only the rotations that they stand for, go on without a jump.
fn signs_are_kept(rotations: &Rotations) -> bool {
    rotations
        .local()
        .windows(2)
        .all(|pair| (0..JOINTS).all(|j| quaternion(pair[0][j]).dot(quaternion(pair[1][j])) >= 0.0))
}

/// Returns a local rotation with which all joints swing and limbs bend and stretch; `whole` turns the whole body at a
/// time in seconds.
fn swinging(t: usize, joint: Joint, whole: impl Fn(f64) -> DQuat) -> DQuat {
    let time = t as f64 / 20.0;
    let phase = joint.index() as f64;
    let wave = |speed: f64, size: f64| size * (speed * time * TAU + phase).sin();
    match joint {
        Pelvis => whole(time),
        LeftKnee | RightKnee => DQuat::from_rotation_x(0.6 + wave(0.8, 0.6)),
        LeftElbow => DQuat::from_rotation_y(-0.9 + wave(0.7, 0.7)),
        RightElbow => DQuat::from_rotation_y(0.9 + wave(0.7, 0.7)),
        LeftHip | RightHip => DQuat::from_euler(
            glam::EulerRot::XYZ,
            wave(0.5, 0.7),
            wave(0.3, 0.4),
            wave(0.4, 0.3),
        ),
        LeftShoulder | RightShoulder => DQuat::from_euler(
            glam::EulerRot::XYZ,
            wave(0.5, 0.6),
            wave(0.6, 0.5),
            wave(0.4, 0.9),
        ),
        // A turn about X would be a twist about the collar's own bone, which positions do not show.
        LeftCollar | RightCollar => DQuat::from_rotation_z(wave(0.3, 0.15)),
        Head | LeftWrist | RightWrist | LeftFoot | RightFoot => DQuat::IDENTITY,
        _ => DQuat::from_euler(glam::EulerRot::XYZ, wave(0.4, 0.15), 0.0, wave(0.3, 0.15)),
    }
}

#[test]
fn positions_come_back_at_every_heading_and_upside_down() {
    type NamedTurn = (&'static str, fn(f64) -> DQuat);
    let turns: [NamedTurn; 7] = [
        ("forwards", |_| DQuat::IDENTITY),
        ("backwards", |time| {
            DQuat::from_rotation_y(PI + 0.3 * (time * 3.0).sin())
        }),
        ("to the left", |_| DQuat::from_rotation_y(PI / 2.0)),
        ("turning", |time| DQuat::from_rotation_y(time * 2.0)),
        ("cartwheel", |time| DQuat::from_rotation_z(time * 3.0)),
        ("somersault", |time| DQuat::from_rotation_x(time * 4.0)),
        ("standing on the head", |time| {
            DQuat::from_rotation_x(PI) * DQuat::from_rotation_y(time)
        }),
    ];
    for (name, whole) in turns {
        for heading in 0..8 {
            let facing = DQuat::from_rotation_y(f64::from(heading) * PI / 4.0);
            let (known, motion) = moved(100, |t, joint| {
                swinging(t, joint, |time| facing * whole(time))
            });
            let found = Rotations::of(&motion);
            let error = error(&found, &motion);
            assert!(error < 1e-4, "{name}, heading {heading}: {error} m");
            let (step, known) = (largest_step(&found), largest_step(&known));
            assert!(
                step.0 < 1.5 * known.0 + 2.0,
                "{name}, {heading}: {step:?}, known {known:?}"
            );
            assert!(signs_are_kept(&found), "{name}, heading {heading}");
        }
    }
}

#[test]
fn only_the_pelvis_knows_where_the_body_faces() {
    let (_, motion) = moved(60, |t, joint| swinging(t, joint, |_| DQuat::IDENTITY));
    let found = Rotations::of(&motion);
    for step in 1..12 {
        let facing = DQuat::from_rotation_y(f64::from(step) * TAU / 12.0);
        let poses = motion.joints().iter();
        let turned = poses.map(|pose| pose.map(|p| (facing * vector(p)).as_vec3().to_array()));
        let turned = Rotations::of(&Motion::from_joints(turned.collect()).unwrap());
        for (a, b) in found.local().iter().zip(turned.local()) {
            for j in 1..JOINTS {
                let angle = quaternion(a[j]).angle_between(quaternion(b[j]));
                assert!(angle < 1e-3, "{} {angle}", Joint::ALL[j].name());
            }
        }
    }
}

#[test]
fn twists_of_upper_arms_and_thighs_are_found_and_knees_and_elbows_are_hinges() {
    let (known, motion) = moved(120, |t, joint| swinging(t, joint, DQuat::from_rotation_y));
    let found = Rotations::of(&motion);
    for (t, (known, found)) in known.local().iter().zip(found.local()).enumerate() {
        for (upper, lower, axis) in [
            (LeftHip, LeftKnee, DVec3::X),
            (RightHip, RightKnee, DVec3::X),
            (LeftShoulder, LeftElbow, DVec3::Y),
            (RightShoulder, RightElbow, DVec3::Y),
        ] {
            let bend = quaternion(known[lower.index()]);
            if bend.to_axis_angle().1 < 0.6 {
                continue;
            }
            let [known, turn] = [known, found].map(|pose| quaternion(pose[upper.index()]));
            let off = known.angle_between(turn).to_degrees();
            assert!(off < 3.0, "frame {t}, {}: {off}", upper.name());
            let bend = quaternion(found[lower.index()]);
            let off = bend
                .xyz()
                .normalize()
                .cross(axis)
                .length()
                .asin()
                .to_degrees();
            assert!(
                off < 8.0,
                "frame {t}, {}: {off} off the hinge",
                lower.name()
            );
        }
    }
}

#[test]
fn the_twist_of_a_limb_that_straightens_is_carried_through() {
    // A bent arm, turned outwards by 60°, straightens for two seconds and bends again.
    let (_, motion) = moved(80, |t, joint| {
        let bend = (0.02 * (t as f64 - 20.0) * (t as f64 - 60.0) / 8.0).clamp(0.0, 1.2);
        match joint {
            LeftShoulder => DQuat::from_rotation_z(-1.0) * DQuat::from_rotation_x(1.05),
            LeftElbow => DQuat::from_rotation_y(-bend),
            _ => DQuat::IDENTITY,
        }
    });
    let found = Rotations::of(&motion);
    let known = DQuat::from_rotation_z(-1.0) * DQuat::from_rotation_x(1.05);
    assert!(motion.position(40, LeftWrist) != motion.position(0, LeftWrist));
    for (t, pose) in found.local().iter().enumerate() {
        let off = quaternion(pose[LeftShoulder.index()])
            .angle_between(known)
            .to_degrees();
        let limit = if (12..68).contains(&t) { 25.0 } else { 3.0 };
        assert!(off < limit, "frame {t}: {off}");
    }
    assert!(largest_step(&found).0 < 10.0, "{:?}", largest_step(&found));
    assert!(error(&found, &motion) < 1e-4);
}

#[test]
fn knees_that_overstretch_and_noise_on_straight_limbs_turn_nothing_around() {
    let (_, motion) = moved(100, |t, joint| {
        let noise = |seed: f64| ((t as f64 * 12.9898 + seed * 78.233).sin() * 43758.5453).fract();
        match joint {
            LeftKnee => DQuat::from_rotation_x(0.35 * (t as f64 * 0.3).sin()),
            RightKnee | LeftElbow | RightElbow => DQuat::from_euler(
                glam::EulerRot::XYZ,
                0.08 * noise(joint.index() as f64),
                0.08 * noise(joint.index() as f64 + 0.3),
                0.08 * noise(joint.index() as f64 + 0.6),
            ),
            LeftShoulder => DQuat::from_rotation_z(-1.3),
            RightShoulder => DQuat::from_rotation_z(1.3),
            _ => DQuat::IDENTITY,
        }
    });
    let found = Rotations::of(&motion);
    for (t, pose) in found.local().iter().enumerate() {
        for (joint, known) in [
            (LeftHip, DQuat::IDENTITY),
            (RightHip, DQuat::IDENTITY),
            (LeftShoulder, DQuat::from_rotation_z(-1.3)),
            (RightShoulder, DQuat::from_rotation_z(1.3)),
        ] {
            let off = quaternion(pose[joint.index()])
                .angle_between(known)
                .to_degrees();
            assert!(off < 15.0, "frame {t}, {}: {off}", joint.name());
        }
    }
}

#[test]
fn a_leg_may_go_past_the_opposite_of_its_rest() {
    // The hip makes a full circle, a little to the side: the leg goes straight up beside the head and over.
    for side in [-0.1, -0.02, 0.001, 0.05] {
        let (_, motion) = moved(120, |t, joint| match joint {
            LeftHip => {
                DQuat::from_rotation_z(side) * DQuat::from_rotation_x(-TAU * t as f64 / 120.0)
            }
            LeftKnee => DQuat::from_rotation_x(0.05),
            _ => DQuat::IDENTITY,
        });
        let found = Rotations::of(&motion);
        let step = largest_step(&found);
        assert!(step.0 < 20.0, "side {side}: {step:?}");
        assert!(error(&found, &motion) < 1e-4);
    }
}

#[test]
fn bodies_that_are_not_rigid_are_met_as_well_as_one_can() {
    let (_, motion) = moved(50, |t, joint| swinging(t, joint, |_| DQuat::IDENTITY));
    let noisy = motion.joints().iter().enumerate().map(|(t, pose)| {
        std::array::from_fn(|j| {
            std::array::from_fn(|axis| {
                pose[j][axis] + 0.005 * ((t * 31 + j * 7 + axis) as f32 * 1.7).sin()
            })
        })
    });
    let noisy = Motion::from_joints(noisy.collect()).unwrap();
    let distance = Rotations::of(&noisy).distance(&noisy);
    assert!((0.003..0.05).contains(&distance.largest), "{distance:?}");
    assert!(distance.mean < 0.5 * distance.largest && distance.mean > 1e-4);
    let [worst, there] = [
        &Rotations::of(&noisy).joints()[distance.frame],
        &noisy.joints()[distance.frame],
    ];
    let [worst, there] = [worst, there].map(|pose| vector(pose[distance.joint.index()]));
    assert!((worst.distance(there) as f32 - distance.largest).abs() < 1e-6);
}

#[test]
fn a_branch_joint_whose_children_lie_on_one_line_is_rigid_too() {
    for height in [0.2, 0.0, -0.1] {
        let mut rest = body();
        let line = [(LeftCollar, 0.05), (RightCollar, -0.05), (Neck, 0.0)];
        for (joint, x) in line {
            rest.offsets[joint.index()] = [x, height, 0.01];
        }
        let (known, _) = moved(60, |t, joint| swinging(t, joint, DQuat::from_rotation_x));
        let moved = Rotations { rest, ..known };
        let motion = Motion::from_joints(moved.joints()).unwrap();
        let error = error(&Rotations::of(&motion), &motion);
        assert!(error < 1e-3, "{height}: {error} m");
    }
}

#[test]
fn the_rest_pose_is_a_t_pose_with_the_bodys_bones() {
    let (_, motion) = moved(50, |t, joint| {
        swinging(t, joint, |time| {
            DQuat::from_rotation_x(time) * DQuat::from_rotation_y(2.0)
        })
    });
    let rest = RestPose::of(&motion);
    for joint in Joint::ALL {
        let offset = vector(rest.offset(joint));
        let length = LENGTHS[joint.index()];
        assert!((offset.length() - length).abs() < 1e-5, "{}", joint.name());
    }
    for joint in [LeftShoulder, LeftElbow, LeftWrist] {
        assert!(vector(rest.offset(joint)).normalize().dot(DVec3::X) > 0.9999);
    }
    for joint in [LeftKnee, RightKnee, LeftAnkle, RightAnkle] {
        assert!(vector(rest.offset(joint)).normalize().dot(DVec3::NEG_Y) > 0.9999);
    }
    let across = vector(rest.offset(LeftHip)) - vector(rest.offset(RightHip));
    assert!(across.normalize().dot(DVec3::X) > 0.9999);
    for (joint, tip) in rest.tips() {
        let is_end = joint.children().next().is_none();
        assert!(is_end && vector(tip).length() > 0.05, "{}", joint.name());
    }
}

#[test]
fn joints_that_fall_together_and_single_frames_give_numbers() {
    for pose in [[[0.0; 3]; JOINTS], [[0.3, 1.0, -0.2]; JOINTS]] {
        for frames in [1, 2, 5] {
            let motion = Motion::from_joints(vec![pose; frames]).unwrap();
            let found = Rotations::of(&motion);
            assert!(error(&found, &motion) < 1e-6);
            assert!(
                found
                    .local()
                    .as_flattened()
                    .as_flattened()
                    .iter()
                    .all(|x| x.is_finite())
            );
        }
    }
    let (_, motion) = moved(1, |t, joint| {
        swinging(t, joint, |_| DQuat::from_rotation_y(3.0))
    });
    assert!(error(&Rotations::of(&motion), &motion) < 1e-4);
}

#[test]
fn resampling_keeps_the_frames_that_both_rates_have_and_the_bones() {
    let (_, motion) = moved(41, |t, joint| swinging(t, joint, DQuat::from_rotation_y));
    let found = Rotations::of(&motion);
    let fine = found.resampled(60.0);
    assert_eq!((fine.frames(), fine.frames_per_second()), (121, 60.0));
    let (coarse, fine_joints) = (found.joints(), fine.joints());
    for (t, pose) in coarse.iter().enumerate() {
        for j in 0..JOINTS {
            let gap = (vector(pose[j]) - vector(fine_joints[3 * t][j])).length();
            assert!(gap < 1e-5, "frame {t}: {gap}");
        }
    }
    let steps = (largest_step(&found).0, largest_step(&fine).0);
    assert!(steps.1 < steps.0 / 2.5, "{steps:?}");
    assert!(signs_are_kept(&fine));
    assert!(found.resampled(20.0) == found);
    assert_eq!(found.resampled(10.0).frames(), 21);
    assert_eq!(found.resampled(29.97).frames(), 61);
    let (_, short) = moved(1, |_, _| DQuat::IDENTITY);
    assert_eq!(Rotations::of(&short).resampled(120.0).frames(), 1);
}

/// Returns a motion of which one frame in three is kept, at 20 frames a second, and the motion itself at 60.
fn thinned(frames: usize, turn: impl Fn(f64, Joint) -> DQuat) -> (Rotations, Rotations) {
    let (mut fine, _) = moved(frames, |t, joint| turn(t as f64 / 60.0, joint));
    fine.frames_per_second = 60.0;
    (fine.resampled(20.0), fine)
}

#[test]
fn resampled_movement_is_smooth_and_near_the_movement_itself() {
    let (coarse, fine) = thinned(121, |time, joint| match joint {
        LeftKnee => DQuat::from_rotation_x(0.8 + 0.7 * (3.0 * time * TAU).sin()),
        RightElbow => DQuat::from_rotation_y(0.9 + 0.8 * (2.0 * time * TAU).cos()),
        _ => DQuat::IDENTITY,
    });
    let again = coarse.resampled(60.0);
    let error = |straight: bool| {
        let pairs = (3..118).flat_map(|frame| {
            [LeftKnee, RightElbow].map(|joint| {
                let there = quaternion(fine.local[frame][joint.index()]);
                let found = quaternion(again.local[frame][joint.index()]);
                let [a, b] = [0, 1].map(|next| {
                    quaternion(coarse.local[(frame / 3 + next).min(40)][joint.index()])
                });
                let on_arc = a.slerp(b, (frame % 3) as f64 / 3.0);
                let found = if straight { on_arc } else { found };
                there.angle_between(found).to_degrees()
            })
        });
        pairs.fold(0.0, f64::max)
    };
    // Of knees that swing three times a second, the shortest arc cuts off the ends by degrees.
    assert!(error(true) > 3.0, "{}", error(true));
    assert!(error(false) < 0.6 * error(true), "{}", error(false));
}

#[test]
fn a_joint_that_comes_to_rest_does_not_swing_beyond_its_place() {
    let (coarse, _) = thinned(91, |time, joint| match joint {
        RightKnee => DQuat::from_rotation_x((1.2 - 2.4 * time).max(0.0)),
        _ => DQuat::IDENTITY,
    });
    let again = coarse.resampled(120.0);
    for pose in again.local() {
        let turn = quaternion(pose[RightKnee.index()]).to_scaled_axis();
        assert!(turn.x > -1e-6, "{turn}");
    }
    let rest = quaternion(again.local()[again.frames() - 1][RightKnee.index()]);
    assert!(rest.angle_between(DQuat::IDENTITY) < 1e-6);
}

#[test]
fn a_resampled_loop_goes_on_over_its_seam() {
    let swing = |time: f64, joint| match joint {
        LeftKnee => DQuat::from_rotation_x(0.8 + 0.7 * (1.5 * time * TAU).sin()),
        _ => DQuat::IDENTITY,
    };
    // Two seconds, which are three cycles of the knee; the frame that closes the loop is not in it.
    let (coarse, _) = thinned(118, swing);
    let again = coarse.resampled_loop([0.8, 2.4], 60.0);
    assert_eq!((coarse.frames(), again.frames()), (40, 121));
    let error = |frame: usize| {
        let there = swing(frame as f64 / 60.0, LeftKnee);
        let found = quaternion(again.local[frame][LeftKnee.index()]);
        there.angle_between(found).to_degrees()
    };
    let worst = (0..=120).map(error).fold(0.0, f64::max);
    let seam = [1, 2, 118, 119].map(error).into_iter().fold(0.0, f64::max);
    assert!(worst < 0.6 && seam < 0.1, "{worst} {seam}");
    let first = vector(again.root[0]);
    assert!((first - vector(coarse.root[0])).length() < 1e-6);
    let travelled = vector(again.root[120]) - first;
    assert!(
        (travelled - DVec3::new(0.8, 0.0, 2.4)).length() < 1e-5,
        "{travelled}"
    );
}

#[test]
fn a_foot_that_stands_stands_between_the_frames_too() {
    // A body that sways and bobs over its feet.
    let (mut swaying, _) = moved(41, |_, joint| match joint {
        LeftHip | RightHip => DQuat::from_rotation_x(-0.5),
        LeftKnee | RightKnee => DQuat::from_rotation_x(1.0),
        LeftAnkle | RightAnkle => DQuat::from_rotation_x(-0.5),
        _ => DQuat::IDENTITY,
    });
    let start = WorldPose::new(&swaying.rest, [0.0, 0.85, 0.0], &swaying.local[0]);
    for frame in 0..41 {
        let time = frame as f64 / 20.0;
        let [side, bob] = [1.1, 1.7].map(|speed: f64| (speed * time * TAU).sin());
        let offset = DVec3::new(0.08 * side, 0.05 * bob, 0.0);
        swaying.root[frame] = (vector([0.0, 0.85, 0.0]) + offset).as_vec3().to_array();
        let pose = WorldPose::new(&swaying.rest, swaying.root[frame], &swaying.local[frame]);
        for [hip, knee, ankle] in LEGS {
            let joints = [hip, knee, ankle].map(|joint| pose.positions[joint.index()]);
            let turns = bend_limb(joints, start.positions[ankle.index()], None);
            let thigh = turns[0] * pose.rotations[hip.index()];
            let shin = turns[1] * pose.rotations[knee.index()];
            let foot = start.rotations[ankle.index()];
            let pelvis = pose.rotations[Pelvis.index()];
            for (joint, parent, turn) in [
                (hip, pelvis, thigh),
                (knee, thigh, shin),
                (ankle, shin, foot),
            ] {
                let local = parent.conjugate() * turn;
                swaying.local[frame][joint.index()] = local.to_array().map(|x| x as f32);
            }
        }
    }
    let fine = swaying.resampled(120.0);
    let places = fine.joints();
    for joint in [LeftAnkle, RightAnkle, LeftFoot, RightFoot] {
        let there = start.positions[joint.index()];
        let gaps = places
            .iter()
            .map(|pose| vector(pose[joint.index()]).distance(there));
        let gap = gaps.fold(0.0, f64::max);
        assert!(gap < 2e-5, "{joint:?}: {gap}");
    }
}

/// Checks real clips: joints in `.npy` files in the folder that LAMOGEN_CLIPS names.
#[test]
#[ignore = "needs clips: LAMOGEN_CLIPS=folder cargo test --release --workspace -- --ignored real_clips"]
fn real_clips_come_back_without_flips() {
    let folder =
        std::env::var("LAMOGEN_CLIPS").expect("LAMOGEN_CLIPS names a folder of joints in .npy");
    let mut clips = 0;
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let array = crate::npy::read(entry.path()).unwrap();
        let (points, _) = array.values.as_chunks::<3>();
        let (poses, _) = points.as_chunks::<JOINTS>();
        let motion = Motion::from_joints(poses.to_vec()).unwrap();
        let found = Rotations::of(&motion);
        let (error, step) = (error(&found, &motion), largest_step(&found));
        println!(
            "{}: {:.2} mm, largest step {step:?}",
            entry.path().display(),
            1e3 * error
        );
        assert!(signs_are_kept(&found));
        clips += 1;
    }
    assert!(clips > 0, "no clips");
}

#[test]
fn another_body_moves_in_the_same_directions() {
    let swing = |t: usize, joint: Joint| {
        let axis = DVec3::new(1.0, 0.3 * joint.index() as f64, 0.2);
        DQuat::from_axis_angle(axis.normalize(), 0.4 * (0.1 * t as f64).sin())
    };
    let (_, motion) = moved(60, swing);
    let rotations = Rotations::of(&motion);

    // On a body of the same shape and half the size, all positions are half as large.
    let half = RestPose {
        offsets: rotations
            .rest()
            .offsets
            .map(|offset| offset.map(|x| x / 2.0)),
    };
    let scaled = motion
        .joints()
        .iter()
        .map(|pose| pose.map(|point| point.map(|x| x / 2.0)));
    let scaled = Motion::from_joints(scaled.collect()).unwrap();
    assert!(error(&rotations.on(&half), &scaled) < 1e-4);

    // On HumanML3D's body, limbs keep their directions and bones get the lengths of that body.
    let target = RestPose::humanml3d();
    let moved = Motion::from_joints(rotations.on(&target).joints()).unwrap();
    for (before, after) in motion.joints().iter().zip(moved.joints()) {
        for joint in [
            LeftKnee, LeftAnkle, RightFoot, Spine2, Head, LeftElbow, RightWrist,
        ] {
            let parent = joint.parent().unwrap();
            let [a, b] = [before, after]
                .map(|pose| vector(pose[joint.index()]) - vector(pose[parent.index()]));
            assert!(a.angle_between(b) < 1e-3, "{}", joint.name());
            let length = vector(target.offset(joint)).length();
            assert!((b.length() - length).abs() < 1e-5, "{}", joint.name());
        }
    }
}

#[test]
fn the_body_of_humanml3d_has_its_bones() {
    let body = RestPose::humanml3d();
    for joint in Joint::ALL {
        let found = vector(body.offset(joint)).length();
        let expected = LENGTHS[joint.index()];
        assert!((found - expected).abs() < 1e-3, "{}: {found}", joint.name());
    }
    assert!((body.leg() - 0.821).abs() < 1e-3, "{}", body.leg());
}
