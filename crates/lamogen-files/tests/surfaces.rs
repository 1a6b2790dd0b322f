//! The surfaces of glTF files, and files that are damaged.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use lamogen_files::glb::surfaces;
use serde_json::{Value, json};

/// Makes a file of a triangle strip of four vertices, with changes to its JSON.
fn strip(change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let mut data: Vec<u8> = Vec::new();
    for number in [
        0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0,
    ] {
        data.extend(number.to_le_bytes());
    }
    data.extend([0, 1, 2, 3]);
    let data = STANDARD.encode(data);
    let mut document = json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": 52, "uri": format!("data:application/octet-stream;base64,{data}") }],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 4 }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5121, "count": 4, "type": "SCALAR" }
        ],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 1, 1], "baseColorTexture": { "index": 0 } }, "alphaMode": "MASK" }],
        "textures": [{ "source": 0 }],
        "images": [{ "uri": "data:image/png;base64,AAEC" }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "mode": 5, "material": 0 }] }],
        "nodes": [{}, { "mesh": 0 }]
    });
    change(&mut document);
    document.to_string().into_bytes()
}

fn problem(change: impl FnOnce(&mut Value)) -> String {
    let error = surfaces(&strip(change), Path::new("strip.gltf"));
    error.unwrap_err().to_string()
}

#[test]
fn surfaces_have_triangles_normals_and_materials() {
    let read = surfaces(&strip(|_| ()), Path::new("strip.gltf")).unwrap();
    let [surface] = &read.surfaces[..] else {
        panic!("{read:?}");
    };
    assert_eq!((surface.node, surface.skin), (1, None));
    // Two triangles that share no vertex, the second one turned as the first.
    assert_eq!(surface.indices, [0, 1, 2, 3, 4, 5]);
    assert_eq!(
        surface.positions[3..],
        [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    );
    assert!(
        surface
            .normals
            .iter()
            .all(|normal| *normal == [0.0, 0.0, 1.0])
    );
    assert!(
        surface
            .weights
            .iter()
            .all(|weights| *weights == [1.0, 0.0, 0.0, 0.0])
    );
    let material = &read.materials[surface.material.unwrap()];
    assert_eq!(
        (material.colour, material.cutoff),
        ([0.5, 0.25, 1.0, 1.0], Some(0.5))
    );
    let image = &read.images[material.image.unwrap()];
    assert_eq!(
        (&*image.media_type, &*image.bytes),
        ("image/png", &[0, 1, 2][..])
    );
}

#[test]
fn damaged_surfaces_say_what_is_wrong() {
    for (found, part) in [
        (
            problem(|file| file["accessors"][1]["count"] = 99.into()),
            "expected 99 rows",
        ),
        (
            problem(|file| file["accessors"][0]["count"] = 3.into()),
            "expected indices below 3, found 3",
        ),
        (
            problem(|file| file["accessors"][0]["count"] = 5_000_000.into()),
            "at most 4000000 rows",
        ),
        (
            problem(|file| file["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 1.into()),
            "expected 3 numbers a row, found 1",
        ),
        (
            problem(|file| {
                file["meshes"][0]["primitives"][0]["extensions"] =
                    json!({ "KHR_draco_mesh_compression": {} })
            }),
            "Draco",
        ),
        (
            problem(|file| file["images"][0] = json!({ "bufferView": 9 })),
            "images[0]",
        ),
        (
            problem(|file| file["buffers"][0]["uri"] = "other.bin".into()),
            "other.bin",
        ),
        (
            problem(|file| {
                // Many images in one view of the buffer.
                let long = "A".repeat(4 << 20);
                let buffers = file["buffers"].as_array_mut().unwrap();
                buffers
                    .push(json!({ "byteLength": 3 << 20, "uri": format!("data:;base64,{long}") }));
                let views = file["bufferViews"].as_array_mut().unwrap();
                views.push(json!({ "buffer": 1, "byteLength": 3 << 20 }));
                file["images"] = vec![json!({ "bufferView": 2 }); 22].into();
                file["textures"] = (0..22).map(|source| json!({ "source": source })).collect();
                let material = |texture: usize| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } });
                file["materials"] = (0..22).map(material).collect();
            }),
            "at most 67108864 bytes in all images",
        ),
    ] {
        assert!(
            found.contains("strip.gltf") && found.contains(part),
            "{found}"
        );
    }
}
