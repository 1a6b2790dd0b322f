//! Motions on the skeletons of BVH files, and loops and root motion on characters.

use std::path::Path;

use glam::{DQuat, DVec3};
use lamogen_character::{
    Character, CharacterError, CharacterOptions, RetargetOptions, SaveOptions,
};
use lamogen_files::{ReadOptions, read};
use lamogen_motion::{JOINTS, Joint, Motion, RestPose, RootMotion, Rotations};

/// A joint of the test skeleton: its name, its parent's, and its position in the T-pose, in metres, Y up, facing +Z.
const JOINTS_OF_FILE: [(&str, &str, [f64; 3]); 20] = [
    ("Hips", "", [0.0, 0.9, 0.0]),
    ("Spine", "Hips", [0.0, 1.0, 0.0]),
    ("Spine1", "Spine", [0.0, 1.2, 0.0]),
    ("Neck", "Spine1", [0.0, 1.45, 0.0]),
    ("Head", "Neck", [0.0, 1.55, 0.02]),
    ("LeftShoulder", "Spine1", [0.05, 1.4, 0.0]),
    ("LeftArm", "LeftShoulder", [0.18, 1.4, 0.0]),
    ("LeftForeArm", "LeftArm", [0.46, 1.4, 0.0]),
    ("LeftHand", "LeftForeArm", [0.71, 1.4, 0.0]),
    ("RightShoulder", "Spine1", [-0.05, 1.4, 0.0]),
    ("RightArm", "RightShoulder", [-0.18, 1.4, 0.0]),
    ("RightForeArm", "RightArm", [-0.46, 1.4, 0.0]),
    ("RightHand", "RightForeArm", [-0.71, 1.4, 0.0]),
    ("LeftUpLeg", "Hips", [0.1, 0.85, 0.0]),
    ("LeftLeg", "LeftUpLeg", [0.1, 0.46, 0.01]),
    ("LeftFoot", "LeftLeg", [0.1, 0.08, 0.0]),
    ("LeftToeBase", "LeftFoot", [0.1, 0.02, 0.12]),
    ("RightUpLeg", "Hips", [-0.1, 0.85, 0.0]),
    ("RightLeg", "RightUpLeg", [-0.1, 0.46, 0.01]),
    ("RightFoot", "RightLeg", [-0.1, 0.08, 0.0]),
];

/// How the skeleton is stored.
#[derive(Clone, Copy)]
struct Form {
    /// The number of units in a metre.
    scale: f64,
    has_z_up: bool,
    order: &'static str,
    /// Whether the pose without rotations has all bones along +X, and the T-pose is that of the first frame.
    has_straight_bones: bool,
    /// Whether a joint with six channels is above the hips.
    has_root: bool,
}

const PLAIN: Form = Form {
    scale: 100.0,
    has_z_up: false,
    order: "Zrotation Xrotation Yrotation",
    has_straight_bones: false,
    has_root: false,
};

/// Returns the text of a BVH with the test skeleton in the T-pose, and its hierarchy alone.
fn bvh(form: Form) -> (String, String) {
    let axes = |[x, y, z]: [f64; 3]| match form.has_z_up {
        true => DVec3::new(x, -z, y) * form.scale,
        false => DVec3::new(x, y, z) * form.scale,
    };
    let place = |name: &str| {
        let found = JOINTS_OF_FILE.iter().find(|(joint, ..)| *joint == name);
        found.map(|(_, _, place)| axes(*place))
    };
    // With straight bones, each joint is turned so that its bone, along +X, points to its child.
    let mut world: Vec<(String, DQuat)> = Vec::new();
    for (name, ..) in JOINTS_OF_FILE {
        let child = JOINTS_OF_FILE.iter().find(|(_, parent, _)| *parent == name);
        let turn = match (form.has_straight_bones, child) {
            (true, Some((child, ..))) => {
                let bone = place(child).unwrap() - place(name).unwrap();
                DQuat::from_rotation_arc(DVec3::X, bone.normalize())
            }
            _ => DQuat::IDENTITY,
        };
        world.push((name.to_owned(), turn));
    }
    let turn_of = |name: &str| {
        let found = world.iter().find(|(joint, _)| joint == name);
        found.map_or(DQuat::IDENTITY, |(_, turn)| *turn)
    };
    let mut header = String::from("HIERARCHY\n");
    let mut row: Vec<f64> = Vec::new();
    struct Writer<'a> {
        form: Form,
        place: &'a dyn Fn(&str) -> Option<DVec3>,
        turn: &'a dyn Fn(&str) -> DQuat,
    }
    fn write(w: &Writer<'_>, name: &str, parent: &str, header: &mut String, row: &mut Vec<f64>) {
        let keyword = match parent.is_empty() && !w.form.has_root {
            true => "ROOT",
            false => "JOINT",
        };
        let above = (w.place)(parent).unwrap_or(DVec3::ZERO);
        let offset = (w.turn)(parent).inverse() * ((w.place)(name).unwrap() - above);
        let position = match parent.is_empty() {
            true => "6 Xposition Yposition Zposition",
            false => "3",
        };
        // The hips of most files have no offset: their position is in the channels.
        let at = if parent.is_empty() {
            DVec3::ZERO
        } else {
            offset
        };
        header.push_str(&format!(
            "{keyword} {name}\n{{\n OFFSET {} {} {}\n CHANNELS {position} {}\n",
            at.x, at.y, at.z, w.form.order
        ));
        if parent.is_empty() {
            row.extend(offset.to_array());
        }
        let local = (w.turn)(parent).inverse() * (w.turn)(name);
        // The angles of the first frame, for the order ZYX alone.
        let (z, y, x) = local.to_euler(glam::EulerRot::ZYX);
        row.extend([z, y, x].map(f64::to_degrees));
        for (child, above, _) in JOINTS_OF_FILE {
            if above == name {
                write(w, child, name, header, row);
            }
        }
        header.push_str("}\n");
    }
    let writer = Writer {
        form,
        place: &place,
        turn: &turn_of,
    };
    if form.has_root {
        header.push_str(&format!(
            "ROOT Reference\n{{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition {}\n",
            form.order
        ));
        row.extend([0.0; 6]);
    }
    write(&writer, "Hips", "", &mut header, &mut row);
    if form.has_root {
        header.push_str("}\n");
    }
    let row: Vec<String> = row.iter().map(|value| format!("{value:.9}")).collect();
    let text = format!(
        "{header}MOTION\nFrames: 2\nFrame Time: 0.02\n{0}\n{0}\n",
        row.join(" ")
    );
    (text, header)
}

/// A body that walks forward with swinging limbs, turned by a quarter; a loop of 40 frames if the numbers of waves are whole.
fn motion() -> Motion {
    let frames = 40;
    let (mut root, mut local) = (Vec::new(), Vec::new());
    for frame in 0..frames {
        let wave = (std::f64::consts::TAU * f64::from(frame) / 20.0).sin();
        let mut turns = [[0.0f32, 0.0, 0.0, 1.0]; JOINTS];
        let mut set = |joint: Joint, turn: DQuat| {
            turns[joint.index()] = turn.to_array().map(|x| x as f32);
        };
        set(
            Joint::Pelvis,
            DQuat::from_rotation_y(1.5) * DQuat::from_rotation_z(0.05 * wave),
        );
        set(Joint::LeftHip, DQuat::from_rotation_x(0.5 * wave));
        set(Joint::RightHip, DQuat::from_rotation_x(-0.5 * wave));
        set(Joint::LeftKnee, DQuat::from_rotation_x(0.4 + 0.3 * wave));
        set(
            Joint::LeftShoulder,
            DQuat::from_rotation_z(-1.2 + 0.4 * wave),
        );
        set(
            Joint::RightShoulder,
            DQuat::from_rotation_z(1.2 + 0.3 * wave),
        );
        set(Joint::RightElbow, DQuat::from_rotation_y(0.9 + 0.5 * wave));
        set(Joint::Spine2, DQuat::from_rotation_y(0.2 * wave));
        local.push(turns);
        root.push([0.05 * frame as f32, 0.93, 0.0]);
    }
    let rotations = Rotations::new(RestPose::humanml3d(), root, local, 20.0);
    Motion::from_rotations(rotations).unwrap()
}

const LIMBS: [(Joint, Joint); 8] = [
    (Joint::LeftHip, Joint::LeftKnee),
    (Joint::LeftKnee, Joint::LeftAnkle),
    (Joint::RightHip, Joint::RightKnee),
    (Joint::RightKnee, Joint::RightAnkle),
    (Joint::LeftShoulder, Joint::LeftElbow),
    (Joint::LeftElbow, Joint::LeftWrist),
    (Joint::RightShoulder, Joint::RightElbow),
    (Joint::RightElbow, Joint::RightWrist),
];

fn open(path: &Path, text: &str) -> Result<Character, CharacterError> {
    std::fs::write(path, text).unwrap();
    Character::open(path, &CharacterOptions::default())
}

#[test]
fn limbs_in_the_written_bvh_point_where_those_of_the_motion_point() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skeleton.bvh");
    let motion = motion();
    let forms = [
        ("centimetres", PLAIN),
        (
            "metres, Z up, angles XYZ",
            Form {
                scale: 1.0,
                has_z_up: true,
                order: "Xrotation Yrotation Zrotation",
                ..PLAIN
            },
        ),
        (
            "bones along X",
            Form {
                order: "Zrotation Yrotation Xrotation",
                has_straight_bones: true,
                ..PLAIN
            },
        ),
        (
            "a root above the hips",
            Form {
                has_root: true,
                ..PLAIN
            },
        ),
    ];
    for (name, form) in forms {
        let (text, header) = bvh(form);
        let mut texts = vec![text];
        if !form.has_straight_bones && !form.has_z_up {
            texts.push(header.clone());
        }
        for text in texts {
            let skeleton = open(&path, &text).unwrap();
            let options = RetargetOptions {
                frames_per_second: 20.0,
                plant_feet: false,
                place_hands: false,
                ..RetargetOptions::default()
            };
            let animation = skeleton.animate(&motion, &options).unwrap();
            let out = folder.path().join("out.bvh");
            skeleton
                .save(&out, &[animation], &SaveOptions::default())
                .unwrap();
            let written = std::fs::read_to_string(&out).unwrap();
            assert!(written.starts_with(header.trim_end()), "{name}");
            let found = read(&out, &ReadOptions::default()).unwrap();
            assert_eq!(found.motion.frames(), motion.frames(), "{name}");
            let mut worst: f64 = 0.0;
            for frame in 0..motion.frames() {
                for (from, to) in LIMBS {
                    let bone = |motion: &Motion| {
                        let [from, to] = [from, to]
                            .map(|joint| DVec3::from(motion.position(frame, joint).map(f64::from)));
                        (to - from).normalize()
                    };
                    let angle = bone(&motion).angle_between(bone(&found.motion));
                    worst = worst.max(angle.to_degrees());
                }
            }
            assert!(worst < 0.1, "{name}: {worst}°");
            // The body stands on the ground, although its hips are at the origin without rotations.
            let toes = found
                .motion
                .joints()
                .iter()
                .flat_map(|pose| [pose[10][1], pose[7][1]]);
            let lowest = toes.fold(f32::INFINITY, f32::min);
            assert!((-0.05..0.12).contains(&lowest), "{name}: {lowest} m");
        }
    }
}

#[test]
fn the_travel_goes_into_the_root_or_nowhere() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skeleton.bvh");
    let form = Form {
        has_root: true,
        ..PLAIN
    };
    let skeleton = open(&path, &bvh(form).0).unwrap();
    let options = RetargetOptions::default();
    let whole = skeleton.animate(&motion(), &options).unwrap();
    let place = |animation: &lamogen_character::CharacterAnimation, frame: usize| {
        let joints = &skeleton.joint_positions(animation)[frame];
        let pelvis = joints.iter().find(|(joint, _)| *joint == Joint::Pelvis);
        DVec3::from(pelvis.unwrap().1)
    };
    let travelled = place(&whole, whole.frames() - 1) - place(&whole, 0);
    assert!(travelled.x > 1.5, "{travelled}");

    let rooted = motion().with_root_motion(RootMotion::Root);
    let rooted = skeleton.animate(&rooted, &options).unwrap();
    let root = rooted.root.as_ref().unwrap();
    assert_eq!(root.name, "Reference");
    for frame in 0..whole.frames() {
        assert!(place(&rooted, frame).distance(place(&whole, frame)) < 1e-4);
        // In centimetres: only the height and a little sway are left in the hips.
        let [x, y, z] = rooted.pelvis.positions[frame];
        assert!(
            x.abs() < 2.0 && z.abs() < 2.0 && y > 80.0,
            "{frame}: {x} {y} {z}"
        );
    }
    let still = motion().with_root_motion(RootMotion::None);
    let still = skeleton.animate(&still, &options).unwrap();
    assert_eq!(still.root, None);
    let moved = place(&still, still.frames() - 1) - place(&still, 0);
    assert!(moved.length() < 0.02, "{moved}");

    let plain = open(&path, &bvh(PLAIN).0).unwrap();
    let rooted = motion().with_root_motion(RootMotion::Root);
    let message = plain.animate(&rooted, &options).unwrap_err().to_string();
    assert!(message.contains("above the pelvis \"Hips\""), "{message}");
}

#[test]
fn loops_close_on_the_character() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skeleton.bvh");
    let skeleton = open(&path, &bvh(PLAIN).0).unwrap();
    let walk = motion().with_loop_travel(Some([2.0, 0.0]));
    for (motion, travels) in [
        (walk.clone(), true),
        (walk.with_root_motion(RootMotion::None), false),
    ] {
        let animation = skeleton
            .animate(&motion, &RetargetOptions::default())
            .unwrap();
        assert!(animation.is_loop);
        assert_eq!(
            (animation.frames(), animation.frames_per_second),
            (61, 30.0)
        );
        for bone in &animation.bones {
            let [first, last] = [bone.rotations[0], bone.rotations[60]];
            let dot: f32 = first.iter().zip(last).map(|(a, b)| a * b).sum();
            assert!(dot.abs() > 1.0 - 1e-6, "{}: {first:?} {last:?}", bone.name);
        }
        let [first, last] = [0, 60].map(|frame| animation.pelvis.positions[frame]);
        let ratio = skeleton.leg_length() / f64::from(RestPose::humanml3d().leg());
        let expected = if travels { 200.0 * ratio } else { 0.0 };
        assert!((f64::from(last[0] - first[0]) - expected).abs() < 1e-2);
        let out = folder.path().join("out.bvh");
        skeleton
            .save(&out, &[animation], &SaveOptions::default())
            .unwrap();
        let text = std::fs::read_to_string(&out).unwrap();
        assert!(
            text.contains("Frames: 60\n"),
            "a BVH ends one step before its first frame"
        );
    }
}

#[test]
fn skeletons_that_cannot_be_moved_are_errors_that_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skeleton.bvh");
    let (text, header) = bvh(PLAIN);
    for (text, expected) in [
        (
            header.replace("3 Zrotation Xrotation Yrotation", "2 Zrotation Xrotation"),
            "three rotations about different axes of the joint \"Spine\", or none, found Z, X",
        ),
        (
            header.replace("6 Xposition Yposition Zposition Zrotation", "3 Zrotation"),
            "three position channels of the pelvis \"Hips\"",
        ),
        (text.replace("LeftArm", "Wing"), "but for leftarm"),
        (text.replace("HIERARCHY", "HIERARCH"), "line 1"),
    ] {
        let message = open(&path, &text).unwrap_err().to_string();
        assert!(message.contains("skeleton.bvh"), "{message}");
        assert!(message.contains(expected), "{message}");
    }
    let skeleton = open(&path, &text).unwrap();
    let animation = skeleton
        .animate(&motion(), &RetargetOptions::default())
        .unwrap();
    let message = skeleton
        .save(
            folder.path().join("a.glb"),
            &[animation],
            &SaveOptions::default(),
        )
        .unwrap_err()
        .to_string();
    assert!(message.contains("ends in .bvh"), "{message}");
    let message = skeleton
        .save(folder.path().join("a.bvh"), &[], &SaveOptions::default())
        .unwrap_err()
        .to_string();
    assert!(message.contains("one animation"), "{message}");
}
