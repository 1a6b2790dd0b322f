//! Files that cannot be read.

use super::*;
use crate::glb;

#[test]
fn errors_say_why_a_file_cannot_be_read() {
    let way: &[f32] = &[0.0; 6];
    let fine = document(
        two_nodes(),
        &[0.0, 0.5],
        &[(0, "translation", "LINEAR", way)],
    );
    assert!(read_json(&fine).is_ok());
    let cases: [(&str, Json, &str); 19] = [
        ("/asset/version", json!("1.0"), "version 1.0"),
        ("/nodes/0/children", json!([1]), "below itself"),
        ("/nodes/1/children", json!([0, 0]), "one parent"),
        ("/nodes/1/children", json!([7]), "out of bounds"),
        ("/nodes/1/scale", json!([1e39, 1.0, 1.0]), "nodes[1]"),
        ("/animations", json!([]), "expected an animation"),
        ("/accessors/0/count", json!(3), "accessor 0"),
        ("/accessors/1/count", json!(u64::MAX), "at most"),
        ("/accessors/1/type", json!("VEC4"), "3 numbers a row"),
        (
            "/accessors/1/sparse",
            json!({ "count": 1,
            "indices": { "bufferView": 0, "componentType": 5121 },
            "values": { "bufferView": 0 } }),
            "sparse",
        ),
        ("/bufferViews/1/byteLength", json!(20), "found 20 bytes"),
        ("/bufferViews/1/byteOffset", json!(1u64 << 60), "accessor 1"),
        ("/buffers/0/byteLength", json!(1u64 << 40), "at most"),
        (
            "/buffers/0/uri",
            json!("https://example.org/a.bin"),
            "https://example.org",
        ),
        (
            "/bufferViews/1/extensions",
            json!({ "EXT_meshopt_compression": { "buffer": 0, "byteLength": 8 } }),
            "bufferViews[1]: EXT_meshopt_compression: missing field `byteStride`",
        ),
        (
            "/bufferViews/1/extensions",
            json!({ "KHR_meshopt_compression": {
                "buffer": 0, "byteLength": 8, "byteStride": 12, "count": 2, "mode": "ATTRIBUTES"
            } }),
            "bufferViews[1]: its compressed data are damaged",
        ),
        (
            "/bufferViews/1/extensions",
            json!({ "KHR_meshopt_compression": {
                "buffer": 0, "byteLength": 8000, "byteStride": 12, "count": 2, "mode": "ATTRIBUTES"
            } }),
            "bufferViews[1]: expected its buffer to be longer",
        ),
        (
            "/bufferViews/1/extensions",
            json!({ "KHR_meshopt_compression": {
                "buffer": 0, "byteLength": 8, "byteStride": 256, "count": 1 << 21, "mode": "ATTRIBUTES"
            } }),
            "bytes in all decompressed buffer views",
        ),
        (
            "/extensionsRequired",
            json!(["EXT_something_else"]),
            "EXT_something_else",
        ),
    ];
    for (place, value, expected) in cases {
        let mut json = fine.clone();
        let (parent, key) = place.rsplit_once('/').unwrap();
        let parent = json.pointer_mut(parent).unwrap();
        match key.parse::<usize>() {
            Ok(index) => parent[index] = value,
            Err(_) => parent[key] = value,
        }
        let message = match read_json(&json) {
            Ok(_) => panic!("{place} was accepted"),
            Err(error) => error.to_string(),
        };
        assert!(
            message.contains("other.gltf") && message.contains(expected),
            "{place}: {message}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.glb");
    for (bytes, expected) in [
        (&b"Kaydara FBX Binary  "[..], "something else"),
        (b"", "something else"),
        (b"glTF\x01\0\0\0\x10\0\0\0", "version 2"),
        (b"glTF\x02\0\0\0\x0c\0\0\0", "JSON chunk"),
        (b"glTF\x02\0\0\0\xff\xff\xff\xff", "cut short"),
        (b"{}", "its JSON"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let message = read_file(&path, None).err().unwrap().to_string();
        assert!(
            message.contains("x.glb") && message.contains(expected),
            "{message}"
        );
    }
}

#[test]
fn bytes_refer_to_no_other_file() {
    let text = json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "name": "Hips" }],
        "animations": [{
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
            "samplers": [{ "input": 0, "output": 1 }],
        }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR", "min": [0.0], "max": [0.0] },
            { "bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC3" },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 12 }],
        "buffers": [{ "uri": "other.bin", "byteLength": 12 }],
    });
    let options = crate::ReadOptions::default();
    let message = crate::read_bytes(text.to_string().as_bytes(), "a.gltf", &options)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("other.bin") && message.contains("in this file"),
        "{message}"
    );
}

#[test]
fn damaged_files_never_panic_or_grow() {
    let rotations = lamogen_motion::Rotations::of(&example::motion(3));
    let options = GlbOptions {
        body: false,
        ..GlbOptions::default()
    };
    let whole = glb::bytes(&rotations.into(), &options).unwrap();
    let attempt = |bytes: &[u8]| {
        if let Ok(GltfMotion { clip, .. }) = read(bytes, Path::new("damaged.glb"), None, None) {
            let end = clip.frames as f64 * clip.seconds_per_frame;
            assert_eq!(clip.positions(end).len(), clip.nodes.len());
        }
    };
    for place in (0..whole.len()).step_by(3) {
        for value in [0, b'-', b'9', b'"', 0x7f, 0xff] {
            let mut damaged = whole.clone();
            damaged[place] = value;
            attempt(&damaged);
        }
    }
    for end in (0..whole.len()).step_by(7) {
        attempt(&whole[..end]);
    }
}
