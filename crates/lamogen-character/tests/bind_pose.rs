//! Files whose nodes are stored in the middle of an animation: the rest pose is that in which the mesh was bound.

use glam::{DQuat, DVec3};
use lamogen_character::{
    Character, CharacterOptions, RestPoseNotice, RetargetOptions, SaveOptions,
};
use lamogen_motion::{JOINTS, Joint, Motion, RestPose, Rotations};
use serde_json::Value;

mod characters;

use characters::{AnimatedFile, TestCharacter, characters, pack};

/// Returns a motion that turns every joint.
fn motion() -> Motion {
    let frames = 20;
    let local = |frame: usize| -> [[f32; 4]; JOINTS] {
        let time = frame as f64 * 0.2;
        std::array::from_fn(|joint| {
            let phase = time + joint as f64;
            let turn = DQuat::from_euler(
                glam::EulerRot::XYZ,
                0.3 * phase.sin(),
                0.2 * phase.cos(),
                0.3 * (0.7 * phase).sin(),
            );
            turn.to_array().map(|x| x as f32)
        })
    };
    let root = (0..frames).map(|frame| [0.01 * frame as f32, 0.93, 0.02 * frame as f32]);
    let rotations = Rotations::new(
        RestPose::humanml3d(),
        root.collect(),
        (0..frames).map(local).collect(),
        20.0,
    );
    Motion::from_rotations(rotations).unwrap()
}

#[test]
fn a_file_stored_in_a_pose_moves_as_the_same_file_in_its_rest_pose() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    let out = folder.path().join("out.glb");
    let motion = motion();
    for (name, test) in characters() {
        // The rest pose of a VRM is that of its nodes.
        if test.vrm.is_some() {
            continue;
        }
        let animate = |stored_pose: f64| {
            let test = TestCharacter {
                bind_matrices: true,
                stored_pose,
                ..test.clone()
            };
            test.write(&path);
            let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
            let options = RetargetOptions::default();
            let animation = hero.animate(&motion, &options).unwrap().named("move");
            let inner = hero.joint_positions(&animation);
            hero.save(&out, &[animation], &SaveOptions::default())
                .unwrap();
            (
                AnimatedFile::read(&out),
                inner,
                hero.rest_pose_notice().cloned(),
            )
        };
        let (unposed, _, none) = animate(0.0);
        assert_eq!(none, None, "{name}");
        let (posed, inner, notice) = animate(0.8);
        assert!(
            matches!(&notice, Some(RestPoseNotice::BindPose { degrees, .. }) if *degrees > 30.0),
            "{name}: {notice:?}"
        );
        assert_eq!(posed.frames(), unposed.frames());
        let size = 1e-3 * test.sizes[0];
        assert_eq!(posed.frames(), inner.len());
        for (frame, joints) in inner.iter().enumerate() {
            // All nodes, fingers and twist bones among them.
            for node in posed.names() {
                let [found, expected] = [&posed, &unposed].map(|file| file.position(frame, node));
                let distance = found.distance(expected);
                assert!(
                    distance < size,
                    "{name}: {node}, frame {frame}: {distance} m"
                );
            }
            for (joint, place) in joints {
                if *joint == Joint::LeftWrist {
                    let found = posed.position(frame, "mixamorig:LeftHand");
                    assert!(found.distance(DVec3::from(*place)) < size, "{name}");
                }
            }
            for (from, to) in [
                ("LeftArm", "LeftForeArm"),
                ("LeftForeArm", "LeftHand"),
                ("RightUpLeg", "RightLeg"),
                ("RightLeg", "RightFoot"),
            ] {
                let bone = |file: &AnimatedFile| {
                    let [from, to] = [from, to].map(|name| format!("mixamorig:{name}"));
                    file.position(frame, &to) - file.position(frame, &from)
                };
                let degrees = bone(&posed).angle_between(bone(&unposed)).to_degrees();
                assert!(degrees < 0.1, "{name}: {from}: {degrees}°");
            }
        }
    }
}

#[test]
fn nodes_are_the_rest_pose_where_there_is_no_other_bind_pose() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    // A small difference is no other pose, a file without matrices has no bind pose, and the rest pose of a VRM is that of its nodes.
    for (bind_matrices, stored_pose, vrm) in
        [(true, 0.01, None), (false, 0.3, None), (true, 0.3, Some(1))]
    {
        let test = TestCharacter {
            bind_matrices,
            stored_pose,
            vrm,
            ..TestCharacter::default()
        };
        test.write(&path);
        let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
        assert_eq!(hero.rest_pose_notice(), None);
    }
}

#[test]
fn what_is_wrong_with_a_bind_pose_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hero.glb");
    let notice = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let hero = Character::open(&path, &CharacterOptions::default()).unwrap();
        hero.rest_pose_notice().unwrap().to_string()
    };
    let test = TestCharacter {
        bind_matrices: true,
        stored_pose: 0.3,
        ..TestCharacter::default()
    };
    let good = test.glb();
    let length = u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&good[20..20 + length]).unwrap();
    let data = &good[20 + length + 8..];
    let mut unknown = json.clone();
    unknown["skins"][0]["inverseBindMatrices"] = 77.into();
    let text = notice(&pack(&unknown.to_string(), data));
    assert!(
        text.contains("cannot be read") && text.contains("accessor 77"),
        "{text}"
    );
    // In the bind pose of this file, all joints are in one place.
    let matrices = &json["bufferViews"][5];
    let [offset, bytes] =
        ["byteOffset", "byteLength"].map(|name| matrices[name].as_u64().unwrap() as usize);
    let mut heap = data.to_vec();
    let first = heap[offset..offset + 64].to_vec();
    for joint in heap[offset..offset + bytes].chunks_exact_mut(64) {
        joint.copy_from_slice(&first);
    }
    let text = notice(&pack(&json.to_string(), &heap));
    assert!(text.contains("no body stands"), "{text}");
    let text = notice(&good);
    assert!(text.contains("in which its mesh was bound"), "{text}");
}
