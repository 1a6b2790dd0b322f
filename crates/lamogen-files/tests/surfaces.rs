//! The surfaces of glTF files, and files that are damaged.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use lamogen_files::glb::{Surface, surfaces};
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

/// Adds an accessor of 32-bit floats to a file and returns its index.
fn accessor(file: &mut Value, kind: &str, numbers: &[f32]) -> usize {
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    let add = |file: &mut Value, list: &str, value: Value| {
        let list = file[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    };
    let uri = format!("data:;base64,{}", STANDARD.encode(&bytes));
    let buffer = add(
        file,
        "buffers",
        json!({ "byteLength": bytes.len(), "uri": uri }),
    );
    let view = json!({ "buffer": buffer, "byteLength": bytes.len() });
    let view = add(file, "bufferViews", view);
    let value = json!({ "bufferView": view, "componentType": 5126, "count": 4, "type": kind });
    add(file, "accessors", value)
}

/// Returns the vertices of the only surface of a file, in their order in the file.
fn vertices(change: impl FnOnce(&mut Value)) -> Surface {
    let mut read = surfaces(&strip(change), Path::new("strip.gltf")).unwrap();
    let mut surface = read.surfaces.remove(0);
    // The strip's triangles are 0, 1, 2 and 2, 1, 3, and share no vertex.
    let order = [0, 1, 2, 5];
    surface.positions = order.map(|place| surface.positions[place]).to_vec();
    surface.colours = order.map(|place| surface.colours[place]).to_vec();
    let places = order.map(|place| surface.texture_coordinates[place]);
    surface.texture_coordinates = places.to_vec();
    surface
}

#[test]
fn vertices_have_colours_of_three_or_four_numbers() {
    assert_eq!(vertices(|_| ()).colours, [[1.0; 4]; 4]);
    let painted = |kind: &str, numbers: &[f32]| {
        vertices(|file| {
            let colours = accessor(file, kind, numbers);
            file["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colours.into();
        })
        .colours
    };
    let three = [
        1.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 7.0, 0.25, 0.25, 0.25,
    ];
    assert_eq!(
        painted("VEC3", &three),
        [
            [1.0, 0.5, 0.0, 1.0],
            [0.0, 1.0, 0.5, 1.0],
            [0.0, 0.0, 1.0, 1.0],
            [0.25, 0.25, 0.25, 1.0]
        ]
    );
    assert_eq!(painted("VEC4", &[0.5; 16]), [[0.5; 4]; 4]);
}

#[test]
fn shapes_change_vertices_by_the_weights_of_node_or_mesh() {
    let shaped = |weights: &dyn Fn(&mut Value)| {
        vertices(|file| {
            let up = accessor(file, "VEC3", &[0.0, 0.0, 2.0].repeat(4));
            let aside = accessor(file, "VEC3", &[1.0, 0.0, 0.0].repeat(4));
            let targets = json!([{ "POSITION": up }, { "POSITION": aside }]);
            file["meshes"][0]["primitives"][0]["targets"] = targets;
            weights(file);
        })
        .positions[3]
    };
    assert_eq!(shaped(&|_| ()), [1.0, 1.0, 0.0]);
    let of_mesh = |file: &mut Value| file["meshes"][0]["weights"] = json!([0.5, 0.0]);
    assert_eq!(shaped(&of_mesh), [1.0, 1.0, 1.0]);
    let of_node = |file: &mut Value| {
        of_mesh(file);
        file["nodes"][1]["weights"] = json!([0.0, 1.0]);
    };
    assert_eq!(shaped(&of_node), [2.0, 1.0, 0.0]);
}

#[test]
fn places_on_the_texture_are_those_of_its_set_moved_turned_and_scaled() {
    let places = |change: &dyn Fn(&mut Value)| {
        vertices(|file| {
            let [first, second] =
                [[0.0, 1.0], [1.0, 0.0]].map(|place| accessor(file, "VEC2", &place.repeat(4)));
            let attributes = &mut file["meshes"][0]["primitives"][0]["attributes"];
            attributes["TEXCOORD_0"] = first.into();
            attributes["TEXCOORD_1"] = second.into();
            change(&mut file["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]);
        })
        .texture_coordinates[0]
    };
    assert_eq!(places(&|_| ()), [0.0, 1.0]);
    assert_eq!(
        places(&|texture| texture["texCoord"] = 1.into()),
        [1.0, 0.0]
    );
    let moved = |transform: Value| {
        places(&|texture| {
            texture["extensions"] = json!({ "KHR_texture_transform": transform });
        })
    };
    assert_eq!(
        moved(json!({ "offset": [0.25, 0.5], "scale": [2, 3] })),
        [0.25, 3.5]
    );
    assert_eq!(
        moved(json!({ "texCoord": 1, "scale": [0.5, 1] })),
        [0.5, 0.0]
    );
    // A quarter turn takes the texture's second axis, which goes down, to the first.
    let [u, v] = moved(json!({ "rotation": std::f64::consts::FRAC_PI_2 }));
    assert!((u - 1.0).abs() < 1e-6 && v.abs() < 1e-6, "{u} {v}");
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
            problem(|file| {
                let short = accessor(file, "VEC3", &[0.0; 12]);
                file["accessors"][short]["count"] = 3.into();
                file["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": short }]);
                file["meshes"][0]["weights"] = json!([1]);
            }),
            "targets[0].POSITION: expected 4 rows, found 3",
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
