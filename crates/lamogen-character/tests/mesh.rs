//! The meshes of characters, and where their bones are in a motion.

mod characters;

use characters::{TestCharacter, characters, pack};
use glam::{DQuat, DVec3};
use lamogen_character::{Character, CharacterOptions, MeshPoses, RetargetOptions, SaveOptions};
use lamogen_files::glb::{self, GlbOptions};
use lamogen_motion::{JOINTS, Joint, Motion, RestPose, Rotations};
use serde_json::json;

/// Returns a motion that goes forward and to the left, turns, and moves its arms.
fn motion() -> Motion {
    let local = |frame: usize| -> [[f32; 4]; JOINTS] {
        std::array::from_fn(|joint| {
            let turn = match Joint::ALL[joint] {
                Joint::Pelvis => DQuat::from_rotation_y(0.03 * frame as f64),
                Joint::LeftShoulder | Joint::RightElbow => {
                    DQuat::from_rotation_z(0.4 * (0.2 * frame as f64).sin())
                }
                Joint::LeftKnee => DQuat::from_rotation_x(0.3 + 0.2 * (0.3 * frame as f64).sin()),
                _ => DQuat::IDENTITY,
            };
            turn.to_array().map(|x| x as f32)
        })
    };
    let frames = 41;
    let root = (0..frames).map(|frame| [0.01 * frame as f32, 0.93, 0.02 * frame as f32]);
    let local = (0..frames).map(local).collect();
    let rotations = Rotations::new(RestPose::humanml3d(), root.collect(), local, 20.0);
    Motion::from_rotations(rotations).unwrap()
}

/// Options that leave limbs where the motion has them.
fn free() -> RetargetOptions {
    RetargetOptions {
        frames_per_second: 20.0,
        plant_feet: false,
        place_hands: false,
        ..RetargetOptions::default()
    }
}

fn read(bytes: Vec<u8>) -> Character {
    Character::from_bytes(bytes, "hero.glb", &CharacterOptions::default()).unwrap()
}

/// Returns the place of a bone at a frame, by its name.
fn place(poses: &MeshPoses, names: &[&str], frame: usize, name: &str) -> DVec3 {
    let bone = names.iter().position(|found| *found == name).unwrap();
    DVec3::from(poses.frames[frame][bone].position.map(f64::from))
}

#[test]
fn the_bones_of_the_motion_s_own_body_are_at_its_joints() {
    let motion = motion();
    let file = glb::bytes(
        &motion.rotations().into_owned().into(),
        &GlbOptions::default(),
    )
    .unwrap();
    let body = read(file);
    let mesh = body.mesh().unwrap();
    let poses = body.mesh_poses(&mesh, &motion, &free()).unwrap();
    assert!((poses.scale - 1.0).abs() < 1e-4, "{}", poses.scale);
    assert_eq!(poses.frames.len(), motion.frames());
    let names: Vec<&str> = mesh.bones.iter().map(|bone| &*bone.name).collect();
    for frame in [0, 7, 40] {
        let pelvis = place(&poses, &names, frame, Joint::Pelvis.name());
        let expected = motion.position(frame, Joint::Pelvis).map(f64::from);
        assert!((pelvis.x - expected[0]).abs() < 1e-3 && (pelvis.z - expected[2]).abs() < 1e-3);
        for joint in Joint::ALL {
            let there = motion.position(frame, joint).map(f64::from);
            let expected = DVec3::from(there) - DVec3::from(expected);
            let found = place(&poses, &names, frame, joint.name()) - pelvis;
            assert!(
                found.distance(expected) < 2e-3,
                "{joint:?}: {found} {expected}"
            );
        }
    }
    // In the pose of the motion, the mesh stands around its bones, on the ground.
    let posed = |frame: usize| {
        let pose = &poses.frames[frame];
        let moved = mesh.vertices.iter().map(|vertex| {
            let bone = usize::from(vertex.bones[0]);
            let bind = glam::DMat4::from_cols_array(&mesh.bones[bone].bind.map(f64::from));
            let vertex = bind.transform_point3(DVec3::from(vertex.position.map(f64::from)));
            let turn = DQuat::from_array(pose[bone].rotation.map(f64::from));
            DVec3::from(pose[bone].position.map(f64::from))
                + turn * (f64::from(poses.scale) * vertex)
        });
        moved.collect::<Vec<DVec3>>()
    };
    let start = posed(0);
    let lowest = start.iter().map(|at| at.y).fold(f64::INFINITY, f64::min);
    let highest = start
        .iter()
        .map(|at| at.y)
        .fold(f64::NEG_INFINITY, f64::max);
    assert!(
        lowest.abs() < 0.05 && (1.5..1.9).contains(&highest),
        "{lowest} {highest}"
    );
    for (vertex, at) in mesh.vertices.iter().zip(&start) {
        let bone = DVec3::from(
            poses.frames[0][usize::from(vertex.bones[0])]
                .position
                .map(f64::from),
        );
        assert!(at.distance(bone) < 0.5, "{at} {bone}");
    }
}

#[test]
fn characters_of_all_sizes_and_directions_go_the_way_of_the_motion() {
    let motion = motion();
    for (name, test) in characters() {
        let hero = read(test.glb());
        let mesh = hero.mesh().unwrap();
        assert_eq!(mesh.indices, [0, 1, 2], "{name}");
        let poses = hero.mesh_poses(&mesh, &motion, &free()).unwrap();
        let names: Vec<&str> = mesh.bones.iter().map(|bone| &*bone.name).collect();
        let node = |joint: Joint| {
            hero.joint_names()
                .find(|(found, _)| *found == joint)
                .unwrap()
                .1
                .to_owned()
        };
        let at = |frame: usize, joint: Joint| place(&poses, &names, frame, &node(joint));
        for frame in [10, 40] {
            let way = at(frame, Joint::Pelvis) - at(0, Joint::Pelvis);
            let expected = DVec3::new(0.01, 0.0, 0.02) * frame as f64;
            assert!(way.distance(expected) < 2e-3, "{name}: {way} {expected}");
        }
        // The left is at the left, and legs are as long as those of the motion.
        let across = at(0, Joint::LeftHip) - at(0, Joint::RightHip);
        assert!(across.x > 0.9 * across.length(), "{name}: {across}");
        let leg = |hip: DVec3, knee: DVec3, ankle: DVec3| hip.distance(knee) + knee.distance(ankle);
        let found = leg(
            at(5, Joint::LeftHip),
            at(5, Joint::LeftKnee),
            at(5, Joint::LeftAnkle),
        );
        let [hip, knee, ankle] = [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle]
            .map(|joint| DVec3::from(motion.position(5, joint).map(f64::from)));
        let expected = leg(hip, knee, ankle);
        assert!(
            (found / expected - 1.0).abs() < 0.02,
            "{name}: {found} {expected}"
        );
    }
}

#[test]
fn the_bytes_are_those_of_the_file_that_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    TestCharacter::default().write(&path);
    let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
    let animation = hero
        .animate(&motion(), &RetargetOptions::default())
        .unwrap();
    let saved = folder.path().join("saved.glb");
    let animations = [animation];
    hero.save(&saved, &animations, &SaveOptions::default())
        .unwrap();
    let bytes = hero.bytes(&animations, &SaveOptions::default()).unwrap();
    assert!(bytes == std::fs::read(saved).unwrap());
}

#[test]
fn files_of_others_are_bounded_and_open_no_other_file() {
    let refused = |bytes: Vec<u8>| {
        let read = Character::from_bytes(bytes, "hero.glb", &CharacterOptions::default());
        read.and_then(|hero| hero.mesh())
            .map(drop)
            .unwrap_err()
            .to_string()
    };
    let nodes = vec![json!({}); 10_001];
    let many = json!({ "asset": { "version": "2.0" }, "nodes": nodes }).to_string();
    assert!(refused(pack(&many, &[])).contains("at most 10000 nodes, found 10001"));
    let joints = vec![0; 50_001];
    let many =
        json!({ "asset": { "version": "2.0" }, "nodes": [{}], "skins": [{ "joints": joints }] });
    assert!(refused(pack(&many.to_string(), &[])).contains("at most 50000 joints"));
    let long = json!({ "asset": { "version": "2.0" }, "extras": "x".repeat(8_000_000) });
    assert!(refused(pack(&long.to_string(), &[])).contains("bytes of JSON"));

    let file = TestCharacter::default().glb();
    let (json, data) = glb::split_chunks(&file).unwrap();
    let mut document: serde_json::Value = serde_json::from_slice(json).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let side = folder.path().join("side.bin");
    std::fs::write(&side, data.unwrap()).unwrap();
    document["buffers"][0]["uri"] = "side.bin".into();
    let message = refused(pack(&document.to_string(), &[]));
    assert!(
        message.contains("expected its bytes in this file, found the other file \"side.bin\""),
        "{message}"
    );
}

#[test]
fn damaged_files_are_read_or_refused() {
    let own = glb::bytes(
        &motion().rotations().into_owned().into(),
        &GlbOptions::default(),
    );
    let vrm = TestCharacter {
        vrm: Some(1),
        bind_matrices: true,
        ..TestCharacter::default()
    };
    let mut state = 1u64;
    let mut random = move |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as usize % below
    };
    let (mut read, mut refused) = (0, 0);
    for file in [own.unwrap(), vrm.glb()] {
        let json = glb::split_chunks(&file).unwrap().0.len();
        for _ in 0..250 {
            let mut damaged = file.clone();
            for _ in 0..=random(3) {
                // Mostly numbers of the JSON, which stays JSON then.
                let at = 20 + random(json);
                if damaged[at].is_ascii_digit() || random(20) == 0 {
                    damaged[at] = b"0123456789-"[random(11)];
                }
            }
            let character =
                Character::from_bytes(damaged, "hero.glb", &CharacterOptions::default());
            match character.and_then(|character| character.mesh()) {
                Ok(mesh) => {
                    let vertices = mesh.vertices.len();
                    assert!(
                        mesh.indices
                            .iter()
                            .all(|index| (*index as usize) < vertices)
                    );
                    read += 1;
                }
                Err(_) => refused += 1,
            }
        }
    }
    assert!(read > 20 && refused > 20, "{read} {refused}");
}
