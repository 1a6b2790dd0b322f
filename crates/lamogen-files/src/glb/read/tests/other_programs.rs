//! Files in the style of other programs.

use super::*;

#[test]
fn an_armature_with_rotation_and_scale_stands_upright() {
    let way = [0.0, 0.0, 100.0, 0.0, 50.0, 100.0];
    let curves: [(usize, &str, &str, &[f32]); 1] = [(0, "translation", "LINEAR", &way)];
    let clip = read_json(&document(two_nodes(), &[0.0, 0.5], &curves)).unwrap();
    let names: Vec<&str> = clip.nodes.iter().map(|node| &*node.name).collect();
    assert_eq!(names, ["Armature", "Hips"]);
    assert!(clip.nodes[1].rest.distance(DVec3::Y) < 1e-6);
    assert_eq!((clip.frames, clip.seconds_per_frame), (2, 0.5));
    let hips = clip.positions(0.25)[1];
    assert!(hips.distance(DVec3::new(0.0, 1.0, -0.25)) < 1e-6, "{hips}");
}

#[test]
fn a_matrix_is_read_like_its_parts() {
    let mut nodes = two_nodes();
    let parts = nodes[1].as_object_mut().unwrap();
    parts.remove("rotation");
    parts.remove("scale");
    parts.insert(
        "matrix".into(),
        json!([
            0.01, 0.0, 0.0, 0.0, 0.0, 0.0, -0.01, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
        ]),
    );
    let way = [0.0; 3];
    let curves: [(usize, &str, &str, &[f32]); 1] = [(0, "translation", "LINEAR", &way)];
    let clip = read_json(&document(nodes, &[0.0], &curves)).unwrap();
    assert!(clip.nodes[1].rest.distance(DVec3::Y) < 1e-6);
    assert_eq!(clip.frames, 1);
}

#[test]
fn irregular_keyframes_and_splines_are_sampled_finely() {
    // x = t² as a spline, with keyframes that lie on no regular grid. The clip starts at the first keyframe.
    let times = [0.1f32, 0.337, 1.0];
    let spline: Vec<f32> = times
        .iter()
        .flat_map(|t| [2.0 * t, 0.0, 0.0, t * t, 0.0, 0.0, 2.0 * t, 0.0, 0.0])
        .collect();
    let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "CUBICSPLINE", &spline)];
    let clip = read_json(&document(two_nodes(), &times, &curves)).unwrap();
    for seconds in [0.0, 0.2, 0.4321, 0.9] {
        let (x, time) = (clip.positions(seconds)[0].x, seconds + 0.1);
        assert!((x - time * time).abs() < 1e-4, "{seconds}: {x}");
    }
}

#[test]
fn a_step_is_one_fine_frame_wide() {
    let way = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "STEP", &way)];
    let clip = read_json(&document(two_nodes(), &[0.0, 2.0], &curves)).unwrap();
    assert_eq!(clip.positions(1.98)[0].x, 0.0);
    assert_eq!(clip.positions(2.0)[0].x, 1.0);
}

#[test]
fn parts_that_move_no_node_are_ignored() {
    let way = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "LINEAR", &way)];
    let whole = document(two_nodes(), &[0.0, 2.0], &curves);
    let expected = read_json(&whole).unwrap().positions(1.0);
    let with = |change: &dyn Fn(&mut Json)| {
        let mut changed = whole.clone();
        change(&mut changed);
        let clip = read_json(&changed).map_err(|error| error.to_string());
        clip.map(|clip| clip.positions(1.0))
    };
    let push = |json: &mut Json, list: &str, value: Json| {
        if !json[list].is_array() {
            json[list] = json!([]);
        }
        json[list].as_array_mut().unwrap().push(value);
    };
    type Change<'a> = dyn Fn(&mut Json) + 'a;
    let changes: [(&str, &Change<'_>); 7] = [
        ("a channel without a node", &|json| {
            let channel = json!({ "sampler": 0, "target": { "path": "translation" } });
            push(&mut json["animations"][0], "channels", channel);
        }),
        ("weights of shapes", &|json| {
            let channel = json!({ "sampler": 99, "target": { "node": 0, "path": "weights" } });
            push(&mut json["animations"][0], "channels", channel);
        }),
        ("extras of any type", &|json| {
            json["nodes"][0]["extras"] = json!([1, "x", null]);
            json["animations"][0]["extras"] = json!(3);
            json["extras"] = json!("text");
        }),
        ("a broken animation beside", &|json| {
            push(
                json,
                "animations",
                json!({ "name": "broken", "channels": 7 }),
            );
        }),
        ("compressed meshes", &|json| {
            json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
            json["meshes"] =
                json!([{ "primitives": [{ "extensions": { "KHR_draco_mesh_compression": 1 } }] }]);
            push(
                json,
                "accessors",
                json!({ "componentType": 1, "count": 0, "type": "BENT" }),
            );
            push(json, "bufferViews", json!({ "buffer": 77 }));
        }),
        ("pictures and skins", &|json| {
            json["images"] = json!([{ "uri": 5 }]);
            json["skins"] = json!([{ "joints": "all" }]);
            json["nodes"][0]["skin"] = json!(12);
        }),
        ("other buffers", &|json| {
            push(
                json,
                "buffers",
                json!({ "byteLength": 10, "uri": "https://example.org/a.bin" }),
            );
        }),
    ];
    for (name, change) in changes {
        assert_eq!(with(change).as_ref(), Ok(&expected), "{name}");
    }
}

#[test]
fn sparse_keyframes_are_read() {
    use base64::Engine;
    // A path of four keyframes, two of which are stored as sparse values with indices of one byte.
    let times = [0.0, 1.0, 2.0, 3.0];
    let way = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0];
    let curves: [(usize, &str, &str, &[f32]); 1] = [(1, "translation", "LINEAR", &way)];
    let mut json = document(two_nodes(), &times, &curves);
    let output = json["animations"][0]["samplers"][0]["output"]
        .as_u64()
        .unwrap() as usize;
    let mut bytes = vec![1u8, 3, 0, 0];
    for number in [7.0f32, 0.0, 0.0, 9.0, 0.0, 0.0] {
        bytes.extend(number.to_le_bytes());
    }
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let uri = format!("data:application/octet-stream;base64,{data}");
    let buffer = json["buffers"].as_array().unwrap().len();
    json["buffers"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "byteLength": bytes.len(), "uri": uri }));
    let views = json["bufferViews"].as_array_mut().unwrap();
    let first = views.len();
    views.push(json!({ "buffer": buffer, "byteLength": 2 }));
    views.push(json!({ "buffer": buffer, "byteOffset": 4, "byteLength": 24 }));
    let sparse = json!({
        "count": 2,
        "indices": { "bufferView": first, "componentType": 5121 },
        "values": { "bufferView": first + 1 },
    });
    json["accessors"][output]["sparse"] = sparse;
    let at = |json: &Json, second: f64| {
        let clip = read_json(json).map_err(|error| error.to_string());
        clip.map(|clip| clip.positions(second)[0].x)
    };
    for (second, expected) in [(0.0, 0.0), (1.0, 7.0), (2.0, 2.0), (3.0, 9.0)] {
        assert_eq!(at(&json, second), Ok(expected));
    }
    // Values that are not stored at all are zero.
    json["accessors"][output]
        .as_object_mut()
        .unwrap()
        .remove("bufferView");
    for (second, expected) in [(0.0, 0.0), (1.0, 7.0), (2.0, 0.0), (3.0, 9.0)] {
        assert_eq!(at(&json, second), Ok(expected));
    }
    json["accessors"][output]["sparse"]["count"] = json!(40);
    assert!(at(&json, 0.0).unwrap_err().contains("sparse"));
}

#[test]
fn animations_that_are_not_read_are_named() {
    let way: &[f32] = &[0.0; 6];
    let curves = [(0, "translation", "LINEAR", way)];
    let mut json = document(two_nodes(), &[0.0, 0.5], &curves);
    let mut second = json["animations"][0].clone();
    second["name"] = "walk".into();
    let mut third = second.clone();
    third.as_object_mut().unwrap().remove("name");
    json["animations"]
        .as_array_mut()
        .unwrap()
        .extend([second, third]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("several.gltf");
    std::fs::write(&path, json.to_string()).unwrap();
    assert_eq!(
        read_file(&path, None).unwrap().1,
        ["walk", "without a name"]
    );
    assert_eq!(
        read_file(&path, Some("walk")).unwrap().1,
        ["idle", "without a name"]
    );
}

#[test]
fn a_size_that_changes_moves_what_is_below() {
    let sizes: &[f32] = &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0];
    let on = |node| {
        let curves = [(node, "scale", "LINEAR", sizes)];
        read_json(&document(two_nodes(), &[0.0, 0.5], &curves)).unwrap()
    };
    // A hundred units above the armature, which is 0.01, 1 and then 2 large; the leaf's own size moves nothing.
    let [leaf, armature] = [on(0), on(1)];
    for (clip, seconds, height) in [
        (&leaf, 0.0, 1.0),
        (&leaf, 0.5, 1.0),
        (&armature, 0.0, 100.0),
        (&armature, 0.25, 150.0),
        (&armature, 0.5, 200.0),
    ] {
        let found = clip.positions(seconds)[1];
        let expected = DVec3::new(0.0, height, 0.0);
        assert!(found.distance(expected) < 1e-3, "{seconds}: {found}");
    }
}
