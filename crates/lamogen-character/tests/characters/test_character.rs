//! Characters that the tests make.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3};
use serde_json::{Value, json};

/// A character that the tests make: where its joints are in the rest pose, and how its file stores them.
#[derive(Clone)]
pub struct TestCharacter {
    /// The angle by which the arms hang down from the T-pose, in degrees.
    pub arms_down: f64,
    /// The length of legs, trunk and arms in units of an adult's.
    pub sizes: [f64; 3],
    /// The width of the shoulders in units of an adult's.
    pub shoulders: f64,
    /// The size of the head in units of an adult's.
    pub head: f64,
    /// Whether the legs are beside the hips, below a node on the ground.
    pub legs_beside_hips: bool,
    /// Whether there is a neck between trunk and head.
    pub neck: bool,
    /// Whether the skin has inverse bind matrices.
    pub bind_matrices: bool,
    /// The pose in which the file stores the nodes, in place of the rest pose: how far joints are turned, in radians.
    pub stored_pose: f64,
    /// The scale and rotation of the armature above the skeleton.
    pub armature: (f64, DQuat),
    /// The direction in which the character faces, from +Z, in degrees.
    pub facing: f64,
    /// Whether each bone has axes of its own.
    pub own_axes: bool,
    /// Whether there are twist bones between upper arm and forearm.
    pub twist_bones: bool,
    /// The number of nodes of the spine.
    pub spine: usize,
    /// The humanoid map of VRM 0 or 1.
    pub vrm: Option<u32>,
}

impl Default for TestCharacter {
    fn default() -> Self {
        TestCharacter {
            arms_down: 0.0,
            sizes: [1.0; 3],
            shoulders: 1.0,
            head: 1.0,
            legs_beside_hips: false,
            neck: true,
            bind_matrices: false,
            stored_pose: 0.0,
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
        let root = { self.legs_beside_hips }.then(|| add("Root", None, DVec3::ZERO));
        let hips = add("Hips", root, DVec3::new(0.0, hip_height, 0.0));
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
        let base = hip_height + 0.52 * trunk;
        let (below_head, head_height) = match self.neck {
            true => {
                let neck = add("Neck", Some(top), DVec3::new(0.0, base, -0.02));
                (neck, base + 0.1 * trunk * self.head)
            }
            false => (top, base),
        };
        add("Head", Some(below_head), DVec3::new(0.0, head_height, 0.0));
        for (side, sign) in [("Left", 1.0), ("Right", -1.0)] {
            let collar = add(
                &format!("{side}Shoulder"),
                Some(top),
                DVec3::new(0.05 * sign * self.shoulders, shoulder_height - 0.03, -0.02),
            );
            let down = DQuat::from_rotation_z(-sign * self.arms_down.to_radians());
            let shoulder = DVec3::new(0.17 * sign * self.shoulders, shoulder_height, -0.02);
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
            let above = root.unwrap_or(hips);
            let thigh = add(&format!("{side}UpLeg"), Some(above), hip);
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
    pub fn glb(&self) -> Vec<u8> {
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
            let (_, rotation, mut translation) = local.to_scale_rotation_translation();
            let rotation = rotation * self.stored_turn(index, &node.name);
            if self.stored_pose != 0.0 && index == 0 {
                translation += DVec3::new(0.2, -0.3, 0.4) / scale;
            }
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
        // The mesh was bound in the space of the armature.
        let matrices = nodes.iter().flat_map(|node| {
            let matrix = world(node).inverse() * armature;
            matrix.as_mat4().to_cols_array()
        });
        add(floats(&matrices.collect::<Vec<f32>>()));
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
                { "bufferView": 5, "componentType": 5126, "count": nodes.len(), "type": "MAT4" },
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
        if self.bind_matrices {
            file["skins"][0]["inverseBindMatrices"] = 5.into();
        }
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

    /// Returns the rotation by which the file stores a node turned from the rest pose.
    fn stored_turn(&self, index: usize, name: &str) -> DQuat {
        let seed = index as f64;
        let angle = self.stored_pose * (1.3 * seed + 0.4).sin();
        let axis = DVec3::new(seed.sin(), (2.0 * seed).cos(), 0.4).normalize();
        match name {
            // A body that lies.
            "Hips" => DQuat::from_rotation_x(1.5 * self.stored_pose),
            _ => DQuat::from_axis_angle(axis, angle),
        }
    }

    pub fn write(&self, path: &Path) {
        std::fs::write(path, self.glb()).unwrap();
    }
}

/// Packs JSON and data as a GLB file.
pub fn pack(json: &str, data: &[u8]) -> Vec<u8> {
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

/// The characters of the tests.
pub fn characters() -> Vec<(&'static str, TestCharacter)> {
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
            "legs beside the hips",
            TestCharacter {
                legs_beside_hips: true,
                own_axes: true,
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
