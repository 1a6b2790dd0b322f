//! Motions are written as VRM animations and read back through the public functions of the crate.

use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Quat, Vec3};
use lamogen_files::glb::split_chunks;
use lamogen_files::vrma::{self, VrmaOptions, human_bone};
use lamogen_files::{
    ImportedMotion, JointMapping, ReadOptions, WriteOptions, read, read_bytes, write,
};
use lamogen_motion::{JOINTS, Joint, JointTurning, Motion, RestPose, Rotations};
use serde_json::{Value, json};

/// Returns a motion of a person who walks in a circle, twists the trunk, bends and swings all limbs.
fn motion(frames: usize) -> Motion {
    let rest = RestPose::humanml3d();
    let pose = |frame: usize| {
        let time = frame as f32 / 20.0;
        Joint::ALL.map(|joint| {
            let swing = (3.0 * time + joint.index() as f32).sin();
            let turn = match joint {
                Joint::Pelvis => Quat::from_rotation_y(TAU * time / 4.0),
                Joint::Spine3 => Quat::from_rotation_y(0.5 * time.sin()),
                Joint::LeftShoulder => Quat::from_rotation_z(0.8 * swing - FRAC_PI_2),
                Joint::RightShoulder => Quat::from_rotation_z(FRAC_PI_2 - 0.8 * swing),
                Joint::LeftElbow => Quat::from_rotation_y(-0.8 - 0.4 * swing),
                Joint::RightElbow => Quat::from_rotation_y(0.8 + 0.4 * swing),
                Joint::LeftKnee | Joint::RightKnee => Quat::from_rotation_x(0.6 + 0.4 * swing),
                joint if joint.children().next().is_none() => Quat::IDENTITY,
                _ => Quat::from_rotation_x(0.3 * swing),
            };
            turn.to_array()
        })
    };
    let path = |frame: usize| {
        let time = frame as f32 / 20.0;
        [time.sin(), 0.9, time.cos() - 1.0]
    };
    let rotations = Rotations::new(
        rest,
        (0..frames).map(path).collect(),
        (0..frames).map(pose).collect(),
        20.0,
    );
    Motion::from_joints(rotations.joints()).unwrap()
}

/// Returns the document of a GLB file.
fn document(file: &[u8]) -> Value {
    serde_json::from_slice(split_chunks(file).unwrap().0).unwrap()
}

/// Returns a GLB file with another document.
fn with_document(file: &[u8], document: &Value) -> Vec<u8> {
    let binary = split_chunks(file).unwrap().1.unwrap();
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut changed = b"glTF\x02\0\0\0".to_vec();
    changed.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", binary)] {
        changed.extend((chunk.len() as u32).to_le_bytes());
        changed.extend(kind);
        changed.extend(chunk);
    }
    changed
}

/// Returns the file of a motion with a keyframe at each of its frames.
fn file(motion: &Motion) -> Vec<u8> {
    vrma::bytes(&motion.rotations(), &VrmaOptions::default()).unwrap()
}

/// Reads a file whose document was changed.
fn read_changed(
    file: &[u8],
    name: &str,
    change: impl FnOnce(&mut Value),
) -> Result<ImportedMotion, String> {
    let mut document = document(file);
    change(&mut document);
    let file = with_document(file, &document);
    read_bytes(&file, name, &ReadOptions::default()).map_err(|error| error.to_string())
}

/// Returns the map of human bones in a document.
fn human_bones(document: &mut Value) -> &mut serde_json::Map<String, Value> {
    let bones = &mut document["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"];
    bones.as_object_mut().unwrap()
}

/// Returns the largest distance of a joint from where it is expected, in metres.
fn largest_gap(found: &[[[f32; 3]; JOINTS]], expected: &[[[f32; 3]; JOINTS]]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let pairs = { found.iter().flatten() }.zip(expected.iter().flatten());
    pairs
        .map(|(found, expected)| Vec3::from(*found).distance(Vec3::from(*expected)))
        .fold(0.0, f32::max)
}

#[test]
fn a_file_is_a_humanoid_in_t_pose_that_turns_its_bones() {
    let document = document(&file(&motion(40)));
    assert_eq!(document["extensionsUsed"], json!(["VRMC_vrm_animation"]));
    let extension = &document["extensions"]["VRMC_vrm_animation"];
    assert_eq!(extension["specVersion"], "1.0");
    for part in ["meshes", "skins", "materials"] {
        assert_eq!(document.get(part), None);
    }
    // The nodes, their places in the T-pose, and their parents.
    let nodes = document["nodes"].as_array().unwrap();
    let mut parents = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for child in node["children"].as_array().into_iter().flatten() {
            parents[child.as_u64().unwrap() as usize] = Some(parent);
        }
        for part in ["rotation", "scale", "matrix", "mesh"] {
            assert_eq!(node.get(part), None);
        }
    }
    let place = |node: usize| {
        let chain = std::iter::successors(Some(node), |node| parents[*node]);
        let offsets = chain.filter_map(|node| nodes[node]["translation"].as_array());
        offsets.fold(Vec3::ZERO, |sum, offset| {
            sum + Vec3::from_slice(&[0, 1, 2].map(|axis| offset[axis].as_f64().unwrap() as f32))
        })
    };
    let bones = extension["humanoid"]["humanBones"].as_object().unwrap();
    // All joints but the middle spine are bones; the chest has the upper spine's place.
    assert_eq!(bones.len(), JOINTS - 1);
    assert_eq!(bones.get("upperChest"), None);
    let node = |bone: &str| bones[bone]["node"].as_u64().unwrap() as usize;
    for (bone, parent) in [
        ("spine", "hips"),
        ("chest", "spine"),
        ("neck", "chest"),
        ("head", "neck"),
        ("leftShoulder", "chest"),
        ("leftUpperArm", "leftShoulder"),
        ("leftLowerArm", "leftUpperArm"),
        ("leftHand", "leftLowerArm"),
        ("rightUpperLeg", "hips"),
        ("rightLowerLeg", "rightUpperLeg"),
        ("rightFoot", "rightLowerLeg"),
        ("rightToes", "rightFoot"),
    ] {
        let above = std::iter::successors(parents[node(bone)], |node| parents[*node]);
        let mut above = above.filter(|above| bones.values().any(|bone| bone["node"] == *above));
        assert_eq!(above.next(), Some(node(parent)), "{bone}");
        assert_eq!(nodes[node(bone)]["name"], bone);
    }
    let between = |from: &str, to: &str| (place(node(to)) - place(node(from))).normalize();
    for (from, to, direction) in [
        ("leftUpperArm", "leftLowerArm", Vec3::X),
        ("leftLowerArm", "leftHand", Vec3::X),
        ("rightUpperArm", "rightHand", Vec3::NEG_X),
        ("leftUpperLeg", "leftFoot", Vec3::NEG_Y),
        ("rightUpperLeg", "rightFoot", Vec3::NEG_Y),
        ("hips", "head", Vec3::Y),
    ] {
        assert!(between(from, to).dot(direction) > 0.99, "{from} to {to}");
    }
    assert!(between("leftFoot", "leftToes").z > 0.8);
    assert!(place(node("leftToes")).y.abs() < 0.11);
    // Only the hips move, and every bone that turns another one has a rotation.
    let channels = document["animations"][0]["channels"].as_array().unwrap();
    let targets: Vec<(u64, &str)> = { channels.iter() }
        .map(|channel| &channel["target"])
        .map(|target| {
            let path = target["path"].as_str().unwrap();
            (target["node"].as_u64().unwrap(), path)
        })
        .collect();
    for joint in Joint::ALL {
        let Some(bone) = human_bone(joint) else {
            assert_eq!(joint, Joint::Spine2);
            continue;
        };
        let bone = node(bone) as u64;
        assert_eq!(
            targets.contains(&(bone, "translation")),
            joint == Joint::Pelvis
        );
        assert!(!targets.contains(&(bone, "scale")));
        assert_eq!(
            targets.contains(&(bone, "rotation")),
            joint.children().next().is_some(),
            "{}",
            joint.name()
        );
    }
}

#[test]
fn joints_and_rotations_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.vrma");
    let motion = motion(61);
    // At 20 and 60 frames a second there is a keyframe at every frame of the motion, at 30 at every second one.
    for (rate, step) in [(Some(20.0), 1), (Some(60.0), 1), (None, 2)] {
        let options = WriteOptions {
            frames_per_second: rate,
            ..WriteOptions::default()
        };
        write(&path, &motion, &options).unwrap();
        let imported = read(&path, &ReadOptions::default()).unwrap();
        assert_eq!(
            imported.source_frames_per_second,
            f64::from(rate.unwrap_or(30.0))
        );
        assert_eq!(imported.scheme, Some("VRM animation"));
        assert_eq!((imported.placed, imported.notices), (vec![], vec![]));
        let of =
            |motion: &Motion| -> Vec<_> { motion.joints().iter().step_by(step).copied().collect() };
        let gap = largest_gap(&of(&imported.motion), &of(&motion));
        assert!(gap < 1e-4, "{rate:?}: {gap}");
        if rate == Some(20.0) {
            // The file's own rotations, too, are those of the motion, above the trunk whose twist it shares out.
            let expected = JointTurning::of(&motion.rotations());
            let found = imported.turning.unwrap();
            for joint in [
                Joint::Neck,
                Joint::LeftCollar,
                Joint::LeftHip,
                Joint::RightElbow,
            ] {
                let gap = found.mean(joint) - expected.mean(joint);
                assert!(gap.abs() < 0.01, "{}: {gap}", joint.name());
            }
            assert!(found.mean(Joint::Spine2) < 1e-6);
        }
        if step == 1 {
            let [found, expected] = [&imported.motion, &motion].map(|motion| motion.rotations());
            let turns = { found.local().iter().flatten() }.zip(expected.local().iter().flatten());
            for (found, expected) in turns {
                let angle = Quat::from_array(*found).angle_between(Quat::from_array(*expected));
                assert!(angle < 0.01, "{rate:?}: {angle}");
            }
        }
    }
}

#[test]
fn bones_are_found_by_the_extension_and_not_by_names() {
    let motion = motion(20);
    let file = file(&motion);
    let rename = |document: &mut Value| {
        for (index, node) in { document["nodes"].as_array_mut().unwrap().iter_mut() }.enumerate() {
            node["name"] = json!(format!("thing {}", 99 - index));
        }
        document["extensionsRequired"] = json!(["VRMC_vrm_animation"]);
        // Expressions and eyes move no joint.
        document["extensions"]["VRMC_vrm_animation"]["lookAt"] = json!({ "node": 0 });
    };
    for name in ["motion.vrma", "motion.VRMA", "motion.glb"] {
        let imported = read_changed(&file, name, rename).unwrap();
        assert!(largest_gap(imported.motion.joints(), motion.joints()) < 1e-4);
    }
    // The names of a mapping come before the bones of the extension.
    let mut mapping = JointMapping::default();
    for joint in Joint::ALL {
        let mirrored = human_bone(joint.mirrored()).unwrap_or("middleSpine");
        mapping = mapping.with(joint, mirrored);
    }
    let options = ReadOptions {
        mapping: Some(mapping),
        ..ReadOptions::default()
    };
    let imported = read_bytes(&file, "motion.vrma", &options).unwrap();
    let (found, expected) = (imported.motion.joints()[0], motion.joints()[0]);
    let gap = Vec3::from(found[Joint::LeftHip.index()])
        .distance(Vec3::from(expected[Joint::RightHip.index()]));
    assert!(gap < 1e-4, "{gap}");
}

#[test]
fn optional_bones_that_are_missing_are_placed() {
    let motion = motion(20);
    let optional = [
        ("chest", Joint::Spine3),
        ("neck", Joint::Neck),
        ("leftShoulder", Joint::LeftCollar),
        ("rightShoulder", Joint::RightCollar),
        ("leftToes", Joint::LeftFoot),
    ];
    let imported = read_changed(&file(&motion), "motion.vrma", |document| {
        for (bone, _) in optional {
            human_bones(document).remove(bone);
        }
        document["extensions"]["VRMC_vrm_animation"]["specVersion"] = json!("1.0-draft");
    });
    let imported = imported.unwrap();
    for (bone, joint) in optional {
        assert!(imported.placed.contains(&joint), "{bone}");
    }
    for (found, expected) in imported.motion.joints().iter().zip(motion.joints()) {
        for joint in Joint::ALL {
            let [found, expected] = [found, expected].map(|pose| Vec3::from(pose[joint.index()]));
            let allowed = match imported.placed.contains(&joint) {
                true => 0.1,
                false => 1e-4,
            };
            let gap = found.distance(expected);
            assert!(gap < allowed, "{}: {gap}", joint.name());
        }
    }
}

#[test]
fn a_trunk_of_three_bones_is_the_spine() {
    // As other programs have it: an upper chest, and no node for a middle spine.
    let motion = motion(20);
    let imported = read_changed(&file(&motion), "motion.vrma", |document| {
        let extension = &mut document["extensions"]["VRMC_vrm_animation"];
        let middle = extension["extras"]["middleSpine"].clone();
        extension.as_object_mut().unwrap().remove("extras");
        let bones = human_bones(document);
        let chest = bones.insert("chest".into(), middle).unwrap();
        bones.insert("upperChest".into(), chest);
    });
    let imported = imported.unwrap();
    assert!(largest_gap(imported.motion.joints(), motion.joints()) < 1e-4);
    // An entry of extras that is no node of its own is not looked at; the joints are then found along the trunk.
    for middle in [json!({ "node": 99 }), json!({ "node": 1 }), json!(7)] {
        let imported = read_changed(&file(&motion), "motion.vrma", |document| {
            document["extensions"]["VRMC_vrm_animation"]["extras"]["middleSpine"] = middle;
        });
        let imported = imported.unwrap();
        assert!(largest_gap(imported.motion.joints(), motion.joints()) < 1e-4);
    }
}

#[test]
fn errors_say_what_is_wrong_with_the_bones() {
    type Change = fn(&mut Value);
    let cases: [(Change, &[&str]); 13] = [
        (
            |document| document["extensions"] = json!({}),
            &["VRMC_vrm_animation", "found none"],
        ),
        (
            |document| document["extensions"]["VRMC_vrm_animation"]["specVersion"] = json!("2.0"),
            &["specVersion", "\"1.0\"", "found \"2.0\""],
        ),
        (
            |document| document["extensions"]["VRMC_vrm_animation"]["specVersion"] = Value::Null,
            &["specVersion", "found none"],
        ),
        (
            |document| document["extensions"]["VRMC_vrm_animation"]["humanoid"] = Value::Null,
            &["humanoid.humanBones", "found none"],
        ),
        (
            |document| document["extensions"]["VRMC_vrm_animation"]["humanoid"] = json!([1]),
            &["humanoid.humanBones", "found none"],
        ),
        (
            |document| human_bones(document)["leftFoot"] = json!({ "node": 99 }),
            &["humanBones.leftFoot.node", "one of 24 nodes", "found 99"],
        ),
        (
            |document| human_bones(document)["leftFoot"] = json!({ "node": -1 }),
            &["humanBones.leftFoot.node", "found -1"],
        ),
        (
            |document| human_bones(document)["leftFoot"] = json!({ "node": "leftFoot" }),
            &["humanBones.leftFoot.node", "found \"leftFoot\""],
        ),
        (
            |document| human_bones(document)["leftFoot"] = json!({}),
            &["humanBones.leftFoot.node", "found none"],
        ),
        (
            |document| {
                let foot = human_bones(document)["rightFoot"].clone();
                human_bones(document)["leftFoot"] = foot;
            },
            &["a node of its own", "leftFoot", "rightFoot"],
        ),
        (
            |document| {
                for bone in ["hips", "rightLowerArm"] {
                    human_bones(document).remove(bone);
                }
            },
            &["found none for hips, rightLowerArm"],
        ),
        (
            |document| document["animations"] = json!([]),
            &["expected an animation"],
        ),
        (|document| document["nodes"] = json!([]), &[]),
    ];
    let file = file(&motion(5));
    for (change, parts) in cases {
        let message = read_changed(&file, "bad.vrma", change).unwrap_err();
        for part in ["bad.vrma"].iter().chain(parts) {
            assert!(message.contains(part), "{part} is not in {message}");
        }
    }
    for bytes in [&b""[..], b"glTF\x02\0\0\0\xff\xff\xff\xff", b"HIERARCHY"] {
        assert!(read_bytes(bytes, "bad.vrma", &ReadOptions::default()).is_err());
    }
}

#[test]
fn a_file_says_its_name_notes_and_terms() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.vrma");
    let options = WriteOptions {
        vrma: VrmaOptions {
            name: "a jump".into(),
            notes: BTreeMap::from([("seed".into(), "7".into())]),
            copyright: None,
        },
        ..WriteOptions::default()
    };
    let motion = motion(5).with_copyright(Some("CC0-1.0"));
    write(&path, &motion, &options).unwrap();
    let document = document(&std::fs::read(&path).unwrap());
    assert_eq!(document["animations"][0]["name"], "a jump");
    assert_eq!(document["nodes"][0]["extras"]["seed"], "7");
    assert_eq!(document["asset"]["copyright"], "CC0-1.0");
    let imported = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(imported.motion.copyright(), Some("CC0-1.0"));
    let far = vec![[[0.0, 2e6, 0.0]; JOINTS]];
    let far = Motion::from_joints(far).unwrap();
    let other = folder.path().join("far.vrma");
    let error = write(&other, &far, &options).unwrap_err().to_string();
    assert!(error.contains("far.vrma") && !other.exists(), "{error}");
}

#[test]
fn the_rest_pose_stands_on_the_ground_of_the_motion() {
    let motion = motion(40);
    let lowest = |pose: &[[f32; 3]; JOINTS]| {
        let feet = [Joint::LeftFoot, Joint::RightFoot].map(|foot| pose[foot.index()][1]);
        feet[0].min(feet[1])
    };
    let ground = motion.joints().iter().map(lowest).fold(f32::MAX, f32::min);
    let leg = |file: &[u8]| {
        let document = document(file);
        let height = document["nodes"][1]["translation"][1].as_f64().unwrap() as f32;
        let rest = motion.rotations();
        let leg: f32 = [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle]
            .map(|joint| -rest.rest().offset(joint)[1])
            .iter()
            .sum();
        height - leg + rest.rest().offset(Joint::LeftFoot)[1]
    };
    // Where the balls of the feet stand; a motion far above the origin does not show its ground.
    for (wanted, expected) in [(0.0, 0.0), (0.03, 0.03), (2.0, 0.0)] {
        let lifted = { motion.joints().iter() }
            .map(|pose| pose.map(|[x, y, z]| [x, y - ground + wanted, z]));
        let lifted = Motion::from_joints(lifted.collect()).unwrap();
        let found = leg(&file(&lifted));
        assert!((found - expected).abs() < 0.005, "{wanted}: {found}");
    }
}
