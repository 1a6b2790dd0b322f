//! Motions on characters of other proportions, rest poses, units and axes, as they are in the files that are written.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3};
use lamogen_character::{
    Character, CharacterError, CharacterOptions, RetargetOptions, SaveOptions,
};
use lamogen_files::{ReadOptions, UpAxis, read};
use lamogen_motion::{JOINTS, Joint, Motion, RestPose, Rotations};
use serde_json::{Value, json};

/// A character that the tests make: where its joints are in the rest pose, and how its file stores them.
#[derive(Clone)]
struct TestCharacter {
    /// The angle by which the arms hang down from the T-pose, in degrees.
    arms_down: f64,
    /// The length of legs, trunk and arms in units of an adult's.
    sizes: [f64; 3],
    /// The scale and rotation of the armature above the skeleton.
    armature: (f64, DQuat),
    /// The direction in which the character faces, from +Z, in degrees.
    facing: f64,
    /// Whether each bone has axes of its own.
    own_axes: bool,
    /// Whether there are twist bones between upper arm and forearm.
    twist_bones: bool,
    /// The number of nodes of the spine.
    spine: usize,
    /// The humanoid map of VRM 0 or 1.
    vrm: Option<u32>,
}

impl Default for TestCharacter {
    fn default() -> Self {
        TestCharacter {
            arms_down: 0.0,
            sizes: [1.0; 3],
            armature: (1.0, DQuat::IDENTITY),
            facing: 0.0,
            own_axes: false,
            twist_bones: false,
            spine: 3,
            vrm: None,
        }
    }
}

/// A node of a test character: name, parent, and position in the world.
struct TestNode {
    name: String,
    parent: Option<usize>,
    place: DVec3,
    rotation: DQuat,
}

const VRM_BONES: [(&str, &str); 15] = [
    ("hips", "Hips"),
    ("head", "Head"),
    ("leftUpperLeg", "LeftUpLeg"),
    ("leftLowerLeg", "LeftLeg"),
    ("leftFoot", "LeftFoot"),
    ("rightUpperLeg", "RightUpLeg"),
    ("rightLowerLeg", "RightLeg"),
    ("rightFoot", "RightFoot"),
    ("leftUpperArm", "LeftArm"),
    ("leftLowerArm", "LeftForeArm"),
    ("leftHand", "LeftHand"),
    ("rightUpperArm", "RightArm"),
    ("rightLowerArm", "RightForeArm"),
    ("rightHand", "RightHand"),
    ("neck", "Neck"),
];

impl TestCharacter {
    fn nodes(&self) -> Vec<TestNode> {
        let [legs, trunk, arms] = self.sizes;
        let mut nodes: Vec<TestNode> = Vec::new();
        let turn = DQuat::from_rotation_y(self.facing.to_radians());
        let mut add = |name: &str, parent: Option<usize>, place: DVec3| {
            let seed = nodes.len() as f64;
            nodes.push(TestNode {
                name: name.to_owned(),
                parent,
                place: turn * place,
                rotation: match self.own_axes {
                    true => DQuat::from_euler(glam::EulerRot::XYZ, seed, 2.0 * seed, 0.7 * seed),
                    false => DQuat::IDENTITY,
                },
            });
            nodes.len() - 1
        };
        let hip_height = 0.95 * legs;
        let hips = add("Hips", None, DVec3::new(0.0, hip_height, 0.0));
        let mut top = hips;
        for place in 0..self.spine {
            let height = 0.4 * trunk * (place + 1) as f64 / self.spine as f64;
            let name = format!("Spine{place}");
            top = add(
                &name,
                Some(top),
                DVec3::new(0.0, hip_height + height, -0.02),
            );
        }
        let shoulder_height = hip_height + 0.5 * trunk;
        let neck = add(
            "Neck",
            Some(top),
            DVec3::new(0.0, hip_height + 0.52 * trunk, -0.02),
        );
        add(
            "Head",
            Some(neck),
            DVec3::new(0.0, hip_height + 0.62 * trunk, 0.0),
        );
        for (side, sign) in [("Left", 1.0), ("Right", -1.0)] {
            let collar = add(
                &format!("{side}Shoulder"),
                Some(top),
                DVec3::new(0.05 * sign, shoulder_height - 0.03, -0.02),
            );
            let down = DQuat::from_rotation_z(-sign * self.arms_down.to_radians());
            let shoulder = DVec3::new(0.17 * sign, shoulder_height, -0.02);
            let along = |length: f64| shoulder + down * DVec3::new(sign * length * arms, 0.0, 0.0);
            let arm = add(&format!("{side}Arm"), Some(collar), along(0.0));
            let above = match self.twist_bones {
                true => add(&format!("{side}ArmTwist"), Some(arm), along(0.15)),
                false => arm,
            };
            let forearm = add(&format!("{side}ForeArm"), Some(above), along(0.28));
            let hand = add(&format!("{side}Hand"), Some(forearm), along(0.53));
            for (finger, place) in ["Index", "Middle", "Ring", "Pinky"].into_iter().enumerate() {
                let mut above = hand;
                for (bone, length) in [0.6, 0.63, 0.655].into_iter().enumerate() {
                    let front = DVec3::new(0.0, 0.0, 0.03 - 0.02 * finger as f64);
                    let name = format!("{side}Hand{place}{}", bone + 1);
                    above = add(&name, Some(above), along(length) + front);
                }
            }
            let hip = DVec3::new(0.09 * sign, hip_height - 0.06, 0.0);
            let thigh = add(&format!("{side}UpLeg"), Some(hips), hip);
            let knee = DVec3::new(0.09 * sign, 0.48 * legs, 0.01);
            let shin = add(&format!("{side}Leg"), Some(thigh), knee);
            let ankle = DVec3::new(0.1 * sign, 0.08, -0.02);
            let foot = add(&format!("{side}Foot"), Some(shin), ankle);
            add(
                &format!("{side}ToeBase"),
                Some(foot),
                DVec3::new(0.1 * sign, 0.02, 0.1),
            );
        }
        nodes
    }

    /// Returns the bytes of a GLB with the skeleton, a skinned triangle, an animation and things that no reader knows.
    fn glb(&self) -> Vec<u8> {
        let nodes = self.nodes();
        let (scale, turn) = self.armature;
        let armature =
            DMat4::from_scale_rotation_translation(DVec3::splat(scale), turn, DVec3::ZERO);
        let world = |node: &TestNode| {
            DMat4::from_scale_rotation_translation(DVec3::splat(scale), node.rotation, node.place)
        };
        let mut list = vec![json!({
            "name": "Armature",
            "rotation": turn.to_array(),
            "scale": vec![scale; 3],
            "children": [],
        })];
        for (index, node) in nodes.iter().enumerate() {
            let above = node.parent.map_or(armature, |parent| world(&nodes[parent]));
            let local = above.inverse() * world(node);
            let (_, rotation, translation) = local.to_scale_rotation_translation();
            list.push(json!({
                "name": format!("mixamorig:{}", node.name),
                "rotation": rotation.to_array(),
                "translation": translation.to_array(),
            }));
            let above = node.parent.map_or(0, |parent| parent + 1);
            let children = &mut list[above]["children"];
            match children.as_array_mut() {
                Some(children) => children.push((index + 1).into()),
                None => *children = json!([index + 1]),
            }
        }
        let mesh_node = list.len();
        list.push(json!({ "name": "Body", "mesh": 0, "skin": 0 }));
        let mut data: Vec<u8> = Vec::new();
        let mut views: Vec<Value> = Vec::new();
        let mut add = |bytes: Vec<u8>| {
            views.push(json!({ "buffer": 0, "byteOffset": data.len(), "byteLength": bytes.len() }));
            data.extend(bytes);
            data.resize(data.len().next_multiple_of(4), 0);
        };
        let floats = |values: &[f32]| {
            values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect()
        };
        add(floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]));
        add([0u8, 0, 0, 0].repeat(3));
        add(floats(&[1.0, 0.0, 0.0, 0.0].repeat(3)));
        add(floats(&[0.0, 1.0]));
        add(floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]));
        let mut file = json!({
            "asset": { "version": "2.0", "generator": "a test" },
            "scene": 0,
            "scenes": [{ "nodes": [0, mesh_node] }],
            "nodes": list,
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2 } }] }],
            "skins": [{ "joints": (1..=nodes.len()).collect::<Vec<_>>() }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
                { "bufferView": 1, "componentType": 5121, "count": 3, "type": "VEC4" },
                { "bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC4" },
                { "bufferView": 3, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1] },
                { "bufferView": 4, "componentType": 5126, "count": 2, "type": "VEC4" },
            ],
            "bufferViews": views,
            "animations": [{
                "name": "idle",
                "channels": [{ "sampler": 0, "target": { "node": 1, "path": "rotation" } }],
                "samplers": [{ "input": 3, "output": 4 }],
            }],
            "buffers": [{ "byteLength": data.len(), "extras": { "kept": 1 } }],
            "extras": { "unknown": [1.50, "x"] },
        });
        let index = |name: &str| 1 + nodes.iter().position(|node| node.name == name).unwrap();
        match self.vrm {
            Some(0) => {
                let bones =
                    VRM_BONES.map(|(bone, name)| json!({ "bone": bone, "node": index(name) }));
                file["extensions"] = json!({ "VRM": { "humanoid": { "humanBones": bones } } });
            }
            Some(_) => {
                let bones =
                    VRM_BONES.map(|(bone, name)| (bone.to_owned(), json!({ "node": index(name) })));
                let bones: serde_json::Map<String, Value> = bones.into_iter().collect();
                file["extensions"] = json!({ "VRMC_vrm": { "specVersion": "1.0", "humanoid": { "humanBones": bones } } });
            }
            None => {}
        }
        pack(&file.to_string(), &data)
    }

    fn write(&self, path: &Path) {
        std::fs::write(path, self.glb()).unwrap();
    }
}

/// Packs JSON and data as a GLB file.
fn pack(json: &str, data: &[u8]) -> Vec<u8> {
    let json = format!(
        "{json}{}",
        " ".repeat(json.len().next_multiple_of(4) - json.len())
    );
    let mut bytes = b"glTF".to_vec();
    let length = 12 + 8 + json.len() + 8 + data.len();
    for number in [2, length, json.len()] {
        bytes.extend((number as u32).to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(json.as_bytes());
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(data);
    bytes
}

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

/// The characters of the tests.
fn characters() -> Vec<(&'static str, TestCharacter)> {
    let upright = TestCharacter::default();
    let z_up = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    vec![
        ("T-pose", upright.clone()),
        (
            "A-pose",
            TestCharacter {
                arms_down: 45.0,
                ..upright.clone()
            },
        ),
        (
            "arms that hang",
            TestCharacter {
                arms_down: 85.0,
                ..upright.clone()
            },
        ),
        (
            "a child",
            TestCharacter {
                sizes: [0.45, 0.7, 0.5],
                ..upright.clone()
            },
        ),
        (
            "a giant",
            TestCharacter {
                sizes: [3.0, 2.5, 3.5],
                ..upright.clone()
            },
        ),
        (
            "centimetres, Z up",
            TestCharacter {
                armature: (0.01, z_up),
                ..upright.clone()
            },
        ),
        (
            "axes of their own",
            TestCharacter {
                own_axes: true,
                arms_down: 40.0,
                ..upright.clone()
            },
        ),
        (
            "twist bones",
            TestCharacter {
                twist_bones: true,
                own_axes: true,
                ..upright.clone()
            },
        ),
        (
            "turned by 130°",
            TestCharacter {
                facing: 130.0,
                ..upright.clone()
            },
        ),
        (
            "one spine node",
            TestCharacter {
                spine: 1,
                ..upright.clone()
            },
        ),
        (
            "five spine nodes",
            TestCharacter {
                spine: 5,
                ..upright.clone()
            },
        ),
        (
            "VRM 0, facing -Z",
            TestCharacter {
                vrm: Some(0),
                facing: 180.0,
                ..upright.clone()
            },
        ),
        (
            "VRM 1",
            TestCharacter {
                vrm: Some(1),
                arms_down: 30.0,
                ..upright
            },
        ),
    ]
}

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
            ["LeftHandIndex", "LeftHandPinky", "RightHandMiddle"].map(|finger| {
                let place = |bone: u32| node_position(&out, &format!("mixamorig:{finger}{bone}"));
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

/// Returns the position of a node in the first frame of the last animation of a file.
fn node_position(path: &Path, name: &str) -> DVec3 {
    let (document, buffers) = {
        let bytes = std::fs::read(path).unwrap();
        let file = gltf::Gltf::from_slice(&bytes).unwrap();
        (file.document, vec![file.blob.unwrap()])
    };
    let animation = document.animations().last().unwrap();
    let pose = |node: &gltf::Node<'_>| {
        let (translation, rotation, scale) = node.transform().decomposed();
        let mut translation = DVec3::from(translation.map(f64::from));
        let mut rotation = DQuat::from_array(rotation.map(f64::from));
        for channel in animation
            .channels()
            .filter(|channel| channel.target().node().index() == node.index())
        {
            match channel
                .reader(|buffer| Some(&buffers[buffer.index()]))
                .read_outputs()
                .unwrap()
            {
                gltf::animation::util::ReadOutputs::Translations(mut values) => {
                    translation = DVec3::from(values.next().unwrap().map(f64::from));
                }
                gltf::animation::util::ReadOutputs::Rotations(values) => {
                    let value = values.into_f32().next().unwrap();
                    rotation = DQuat::from_array(value.map(f64::from));
                }
                _ => {}
            }
        }
        DMat4::from_scale_rotation_translation(
            DVec3::from(scale.map(f64::from)),
            rotation,
            translation,
        )
    };
    fn search(
        node: gltf::Node<'_>,
        above: DMat4,
        name: &str,
        pose: &dyn Fn(&gltf::Node<'_>) -> DMat4,
    ) -> Option<DVec3> {
        let world = above * pose(&node);
        match node.name() == Some(name) {
            true => Some(world.w_axis.truncate()),
            false => node
                .children()
                .find_map(|child| search(child, world, name, pose)),
        }
    }
    let roots = document.default_scene().unwrap().nodes();
    let found = { roots }.find_map(|node| search(node, DMat4::IDENTITY, name, &pose));
    found.unwrap()
}
