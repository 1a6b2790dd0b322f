//! Motions on characters of other proportions, rest poses, units and axes, as they are in the files that are written.

use std::path::Path;

use glam::{DQuat, DVec3};
use lamogen_character::{
    Character, CharacterError, CharacterOptions, RetargetOptions, SaveOptions,
};
use lamogen_files::{ReadOptions, UpAxis, read};
use lamogen_motion::{JOINTS, Joint, Motion, RestPose, Rotations};
use serde_json::{Value, json};

mod characters;

use characters::{AnimatedFile, TestCharacter, characters, pack};

/// Returns a motion that turns every joint and walks, with a leg that stands.
fn motion() -> Motion {
    let rest = RestPose::humanml3d();
    let local = |frame: usize| -> [[f32; 4]; JOINTS] {
        let time = frame as f64 * 0.15;
        std::array::from_fn(|joint| {
            let turn = match Joint::ALL[joint] {
                Joint::Pelvis => DQuat::from_rotation_y(0.03 * frame as f64),
                // Hands, toes and the head turn with their parents, as those of generated motions do.
                Joint::LeftWrist
                | Joint::RightWrist
                | Joint::Head
                | Joint::LeftFoot
                | Joint::RightFoot => DQuat::IDENTITY,
                Joint::LeftAnkle | Joint::RightAnkle => DQuat::IDENTITY,
                _ => DQuat::from_euler(
                    glam::EulerRot::XYZ,
                    0.4 * (time + joint as f64).sin(),
                    0.2 * (time + 2.0 * joint as f64).cos(),
                    0.3 * (0.7 * time + joint as f64).sin(),
                ),
            };
            turn.to_array().map(|x| x as f32)
        })
    };
    let frames = 50;
    let root = (0..frames).map(|frame| [0.01 * frame as f32, 0.93, 0.02 * frame as f32]);
    let rotations = Rotations::new(rest, root.collect(), (0..frames).map(local).collect(), 20.0);
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

fn read_back(path: &Path, animation: &str) -> Motion {
    let options = ReadOptions {
        up: Some(UpAxis::Y),
        unit: Some(lamogen_files::Unit::Metre),
        animation: Some(animation.to_owned()),
        ..ReadOptions::default()
    };
    read(path, &options).unwrap().motion
}

#[test]
fn limbs_in_the_written_file_point_where_those_of_the_motion_point() {
    let folder = tempfile::tempdir().unwrap();
    let motion = motion();
    for (name, test) in characters() {
        let path = folder.path().join("hero.glb");
        test.write(&path);
        let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
        let options = RetargetOptions {
            frames_per_second: 20.0,
            plant_feet: false,
            ..RetargetOptions::default()
        };
        let animation = hero.animate(&motion, &options).unwrap().named("move");
        let out = folder.path().join("out.glb");
        hero.save(&out, &[animation], &SaveOptions::default())
            .unwrap();
        let found = read_back(&out, "move");
        assert_eq!(found.frames(), motion.frames(), "{name}");
        let turn = DQuat::from_rotation_y(test.facing.to_radians());
        let mut worst: f64 = 0.0;
        for frame in 0..motion.frames() {
            for (from, to) in LIMBS {
                let bone = |motion: &Motion| {
                    let [from, to] = [from, to]
                        .map(|joint| DVec3::from(motion.position(frame, joint).map(f64::from)));
                    (to - from).normalize()
                };
                worst = worst.max(
                    (turn * bone(&motion))
                        .angle_between(bone(&found))
                        .to_degrees(),
                );
            }
        }
        assert!(worst < 0.1, "{name}: {worst}°");
    }
}

#[test]
fn the_pelvis_moves_by_the_ratio_of_the_legs_and_stands_at_its_own_height() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    // A motion that stands in the T-pose and then moves sideways.
    let rest = RestPose::humanml3d();
    let still = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
    let root: Vec<[f32; 3]> = (0..20)
        .map(|frame| [0.05 * frame as f32, 0.93, 0.0])
        .collect();
    let rotations = Rotations::new(rest.clone(), root, vec![still; 20], 20.0);
    let motion = Motion::from_rotations(rotations).unwrap();
    for (name, test) in characters() {
        test.write(&path);
        let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
        let options = RetargetOptions {
            frames_per_second: 20.0,
            plant_feet: false,
            ..RetargetOptions::default()
        };
        let animation = hero.animate(&motion, &options).unwrap();
        let positions = hero.joint_positions(&animation);
        let place = |frame: usize, joint: Joint| {
            let found = positions[frame].iter().find(|(found, _)| *found == joint);
            DVec3::from(found.unwrap().1)
        };
        let moved = place(19, Joint::Pelvis) - place(0, Joint::Pelvis);
        let ratio = hero.leg_length() / f64::from(rest.leg());
        let expected = DQuat::from_rotation_y(test.facing.to_radians())
            * DVec3::new(0.05 * 19.0 * ratio, 0.0, 0.0);
        assert!(
            moved.distance(expected) < 1e-4,
            "{name}: {moved} and {expected}"
        );
        for ankle in [Joint::LeftAnkle, Joint::RightAnkle] {
            let height = place(5, ankle).y;
            assert!((height - 0.08).abs() < 0.01, "{name}: {height}");
        }
    }
}

#[test]
fn feet_that_stand_stay_in_their_places_on_every_body() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    // The body sways over feet that stand: hips and knees bend so that the source's ankles stay where they are.
    let rest = RestPose::humanml3d();
    let frames = 60;
    let (mut root, mut local) = (Vec::new(), Vec::new());
    for frame in 0..frames {
        let bend = 0.35 * (1.0 - (0.15 * frame as f64).cos());
        let mut turns = [[0.0f32, 0.0, 0.0, 1.0]; JOINTS];
        let mut set = |joint: Joint, angle: f64| {
            turns[joint.index()] = DQuat::from_rotation_x(angle).to_array().map(|x| x as f32);
        };
        for (hip, knee, ankle) in [
            (Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle),
            (Joint::RightHip, Joint::RightKnee, Joint::RightAnkle),
        ] {
            set(hip, -bend);
            set(knee, 1.9 * bend);
            set(ankle, -0.9 * bend);
        }
        local.push(turns);
        root.push([0.0f32, 0.0, 0.0]);
    }
    // The root follows from the left ankle, which stays.
    let free = Rotations::new(rest.clone(), root, local.clone(), 20.0).joints();
    let root = { free.iter() }.map(|pose| {
        let ankle = pose[Joint::LeftAnkle.index()];
        [-ankle[0], 0.06 - ankle[1], -ankle[2]]
    });
    let motion = Motion::from_rotations(Rotations::new(rest, root.collect(), local, 20.0)).unwrap();
    for (name, test) in characters() {
        test.write(&path);
        let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
        let slide = |plant_feet: bool| {
            let options = RetargetOptions {
                plant_feet,
                ..RetargetOptions::default()
            };
            let positions = hero.joint_positions(&hero.animate(&motion, &options).unwrap());
            let place = |frame: usize, joint: Joint| {
                let found = positions[frame].iter().find(|(found, _)| *found == joint);
                let mut place = DVec3::from(
                    found
                        .unwrap_or_else(|| {
                            // The VRM of the tests has no toes.
                            let ankle = if joint == Joint::LeftFoot {
                                Joint::LeftAnkle
                            } else {
                                Joint::RightAnkle
                            };
                            positions[frame]
                                .iter()
                                .find(|(found, _)| *found == ankle)
                                .unwrap()
                        })
                        .1,
                );
                place.y = place.y.min(0.0);
                place
            };
            let mut worst: f64 = 0.0;
            for joint in [Joint::LeftFoot, Joint::RightFoot] {
                for frame in 1..positions.len() {
                    worst = worst.max(place(frame, joint).distance(place(0, joint)));
                }
            }
            worst
        };
        let [free, planted] = [slide(false), slide(true)];
        let size = hero.leg_length();
        assert!(
            planted < 0.002 * size,
            "{name}: {planted} m, {free} m without"
        );
    }
}

#[test]
fn all_else_in_the_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    let test = TestCharacter::default();
    let before = test.glb();
    test.write(&path);
    let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
    let animation = hero
        .animate(&motion(), &RetargetOptions::default())
        .unwrap()
        .named("new");
    let out = folder.path().join("out.glb");
    hero.save(
        &out,
        std::slice::from_ref(&animation),
        &SaveOptions::default(),
    )
    .unwrap();
    let after = std::fs::read(&out).unwrap();
    let chunks = |bytes: &[u8]| {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let text = std::str::from_utf8(&bytes[20..20 + length])
            .unwrap()
            .trim_end()
            .to_owned();
        (text, bytes[20 + length + 8..].to_vec())
    };
    let ((old_text, old_data), (new_text, new_data)) = (chunks(&before), chunks(&after));
    assert!(new_data.starts_with(&old_data));
    for name in ["nodes", "meshes", "skins", "scenes", "extras", "asset"] {
        let text = |json: &str| -> String {
            let start = json.find(&format!("\"{name}\":")).unwrap();
            let value = &json[start + name.len() + 3..];
            let mut values = serde_json::Deserializer::from_str(value).into_iter::<Value>();
            values.next().unwrap().unwrap();
            value[..values.byte_offset()].to_owned()
        };
        assert_eq!(text(&old_text), text(&new_text), "{name}");
    }
    let json: Value = serde_json::from_str(&new_text).unwrap();
    assert_eq!(json["buffers"][0]["extras"]["kept"], 1);
    assert_eq!(json["animations"][0]["name"], "idle");
    assert_eq!(json["animations"][1]["name"], "new");
    // The glTF crate's own checks accept the file.
    gltf::Gltf::from_slice(&after).unwrap();
    // The animations of the character itself are dropped on request, and the file may be animated again.
    let options = SaveOptions {
        replace_animations: true,
    };
    hero.save(&out, std::slice::from_ref(&animation), &options)
        .unwrap();
    let again = Character::open(&out, &CharacterOptions::default()).unwrap();
    assert_eq!(again.animation_names(), ["new"]);
    again
        .save(&out, &[animation.named("second")], &SaveOptions::default())
        .unwrap();
    let names = Character::open(&out, &CharacterOptions::default())
        .unwrap()
        .animation_names();
    assert_eq!(names, ["new", "second"]);
}

#[test]
fn files_that_are_no_characters_are_errors_that_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    let open = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Character::open(&path, &CharacterOptions::default())
            .err()
            .unwrap()
    };
    let good = TestCharacter::default().glb();
    let change = |edit: &dyn Fn(&mut Value)| {
        let length = u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
        let mut json: Value = serde_json::from_slice(&good[20..20 + length]).unwrap();
        edit(&mut json);
        pack(&json.to_string(), &good[20 + length + 8..])
    };
    for (bytes, expected) in [
        (
            change(&|json| json["skins"] = json!([])),
            "a mesh with a skin",
        ),
        (
            change(&|json| json["nodes"][0]["scale"] = json!([1, -1, 1])),
            "not mirrored",
        ),
        (
            change(&|json| json["nodes"][0]["scale"] = json!([1, 2, 1])),
            "alike along all axes",
        ),
        (
            change(&|json| json["asset"]["version"] = json!("1.0")),
            "version 2",
        ),
        (
            change(&|json| json["nodes"][1]["children"] = json!([1])),
            "children",
        ),
        (
            change(&|json| json["nodes"][2]["rotation"] = json!([0, 0, 0, 0])),
            "without a length",
        ),
        (good[..good.len() / 2].to_vec(), "cut short"),
        (b"HIERARCHY".to_vec(), "not glTF"),
        (b"<html>".to_vec(), "web page"),
    ] {
        let message = open(&bytes).to_string();
        assert!(
            message.contains("hero.glb") && message.contains(expected),
            "{message}"
        );
    }
    let half = change(&|json| {
        for node in json["nodes"].as_array_mut().unwrap() {
            if node["name"]
                .as_str()
                .is_some_and(|name| name.contains("Leg"))
            {
                node["name"] = json!("x");
            }
        }
    });
    let message = open(&half).to_string();
    assert!(
        message.contains("mixamorig:Hips") && message.contains("Mixamo"),
        "{message}"
    );
    // A VRM whose map lacks a knee.
    let vrm = TestCharacter {
        vrm: Some(1),
        ..TestCharacter::default()
    };
    let bytes = vrm.glb();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut json: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let bones = &mut json["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"];
    bones.as_object_mut().unwrap().remove("leftLowerLeg");
    let message = open(&pack(&json.to_string(), &bytes[20 + length + 8..])).to_string();
    assert!(message.contains("left_knee"), "{message}");
    // A foot beside the hips, as in rigs whose feet are targets of inverse kinematics.
    let mut json: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let nodes = json["nodes"].as_array_mut().unwrap();
    let is_foot = |node: &Value| node["name"] == "mixamorig:LeftFoot";
    let foot = json!(nodes.iter().position(is_foot).unwrap());
    for node in &mut *nodes {
        if let Some(children) = node["children"].as_array_mut() {
            children.retain(|child| *child != foot);
        }
        if node["children"] == json!([]) {
            node.as_object_mut().unwrap().remove("children");
        }
    }
    nodes[0]["children"].as_array_mut().unwrap().push(foot);
    let message = open(&pack(&json.to_string(), &bytes[20 + length + 8..])).to_string();
    assert!(
        message.contains("expected left_ankle (\"mixamorig:LeftFoot\") below left_knee"),
        "{message}"
    );
    std::fs::write(&path, &good).unwrap();
    let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
    let error = hero
        .save(folder.path().join("a.gltf"), &[], &SaveOptions::default())
        .unwrap_err();
    assert!(matches!(error, CharacterError::Container { .. }), "{error}");
    let error = hero
        .save(
            folder.path().join("none/a.glb"),
            &[],
            &SaveOptions::default(),
        )
        .unwrap_err();
    assert!(matches!(error, CharacterError::Write { .. }), "{error}");
    let options = CharacterOptions {
        root: Some("Nobody".into()),
        ..CharacterOptions::default()
    };
    let message = Character::open(&path, &options).err().unwrap().to_string();
    assert!(message.contains("Nobody"), "{message}");
}

#[test]
fn straight_fingers_bend_towards_the_palm() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    let rest = RestPose::humanml3d();
    let still = vec![[[0.0, 0.0, 0.0, 1.0]; JOINTS]; 4];
    let rotations = Rotations::new(rest, vec![[0.0, 0.93, 0.0]; 4], still, 20.0);
    let motion = Motion::from_rotations(rotations).unwrap();
    for own_axes in [false, true] {
        let test = TestCharacter {
            own_axes,
            ..TestCharacter::default()
        };
        test.write(&path);
        let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
        let out = folder.path().join("out.glb");
        let tip_heights = |relax_hands: bool| {
            let options = RetargetOptions {
                relax_hands,
                ..RetargetOptions::default()
            };
            let animation = hero.animate(&motion, &options).unwrap().named("still");
            hero.save(&out, &[animation], &SaveOptions::default())
                .unwrap();
            let file = AnimatedFile::read(&out);
            ["LeftHandIndex", "LeftHandPinky", "RightHandMiddle"].map(|finger| {
                let place = |bone: u32| file.position(0, &format!("mixamorig:{finger}{bone}"));
                place(3).y - place(1).y
            })
        };
        // In the T-pose of the motion the palms look down.
        for height in tip_heights(true) {
            assert!((-0.05..-0.015).contains(&height), "{height}");
        }
        for height in tip_heights(false) {
            assert!(height.abs() < 1e-4, "{height}");
        }
    }
}
