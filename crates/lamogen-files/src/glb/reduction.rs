//! Reduction of a glTF document to the parts that animate nodes.
//!
//! Files of other programs contain much that the specification allows or tells readers to ignore: extras of any type,
//! channels without a node, compressed meshes, damaged animations next to the requested one. These parts are removed
//! before the document is checked, so that they cannot cause errors.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::container::FormatProblem;
use super::meshopt::{self, CompressedView};

/// The part of a document that is read.
#[derive(Clone, Copy, Debug)]
pub(super) enum DocumentPart<'a> {
    /// The animation of this name, or else the first one, and the nodes.
    Animation(Option<&'a str>),
    /// The inverse bind matrices of the skins.
    BindMatrices,
    /// The triangles and images of the surfaces.
    Surfaces,
}

/// Reduces a document to its nodes, the requested part, and everything that it refers to. Indices stay valid: entries that are not
/// needed are replaced by minimal valid ones. Other animations keep only their names. Compressed views that are needed become
/// views of their compressed bytes and are returned beside the document.
pub(super) fn reduce(
    document: &Value,
    part: DocumentPart<'_>,
) -> Result<(Value, CompressedViews), FormatProblem> {
    let list = |name: &str| document[name].as_array().map_or(&[][..], Vec::as_slice);
    let animations = list("animations");
    let chosen = match part {
        DocumentPart::Animation(None) => Some(0),
        DocumentPart::Animation(Some(name)) => {
            animations.iter().position(|entry| entry["name"] == name)
        }
        DocumentPart::BindMatrices | DocumentPart::Surfaces => None,
    };
    let mut accessors = BTreeSet::new();
    if let DocumentPart::BindMatrices = part {
        accessors.extend(bind_matrix_accessors(document).into_iter().flatten());
    }
    let mut used_views = BTreeSet::new();
    if let DocumentPart::Surfaces = part {
        accessors.extend(surface_accessors(document));
        used_views.extend(
            list("images")
                .iter()
                .filter_map(|image| index(&image["bufferView"])),
        );
    }
    let reduced_animations: Vec<Value> = { animations.iter().enumerate() }
        .map(|(position, entry)| match Some(position) == chosen {
            true => reduced_animation(entry, &mut accessors),
            false => with_name_of(entry, json!({ "channels": [], "samplers": [] })),
        })
        .collect();
    let accessors: Vec<Value> = { list("accessors").iter().enumerate() }
        .map(|(position, accessor)| match accessors.contains(&position) {
            true => {
                used_views.extend(buffer_views(accessor));
                keep_fields(
                    accessor,
                    &[
                        "bufferView",
                        "byteOffset",
                        "componentType",
                        "normalized",
                        "count",
                        "type",
                        "sparse",
                    ],
                )
            }
            false => {
                json!({ "bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR" })
            }
        })
        .collect();
    let mut compressed = CompressedViews::new();
    for &position in &used_views {
        if let Some(view) = list("bufferViews").get(position)
            && let Some(view) = compressed_view(view)
                .map_err(|problem| format!("bufferViews[{position}]: {problem}"))?
        {
            compressed.insert(position, view);
        }
    }
    let mut buffers = BTreeSet::new();
    let mut views: Vec<Value> = { list("bufferViews").iter().enumerate() }
        .map(|(position, view)| match used_views.contains(&position) {
            true if compressed.contains_key(&position) => {
                let stored = &compressed[&position];
                buffers.insert(stored.buffer);
                let mut view = keep_fields(view, &["byteStride"]);
                view["buffer"] = stored.buffer.into();
                view["byteOffset"] = stored.byte_offset.into();
                view["byteLength"] = stored.byte_length.into();
                view
            }
            true => {
                buffers.extend(index(&view["buffer"]));
                let kept = ["buffer", "byteOffset", "byteLength", "byteStride"];
                keep_fields(view, &[&kept[..], &["extensions"]].concat())
            }
            false => json!({ "buffer": 0, "byteLength": 1 }),
        })
        .collect();
    // Replaced accessors refer to the first view, and replaced views to the first buffer, so there must be one of each.
    if views.is_empty() && !accessors.is_empty() {
        views.push(json!({ "buffer": 0, "byteLength": 1 }));
    }
    let all_buffers = list("buffers");
    let buffers: Vec<Value> = match (all_buffers, views.is_empty()) {
        ([], false) => vec![json!({ "byteLength": 0, "uri": EMPTY_BUFFER })],
        (all, _) => { all.iter().enumerate() }
            .map(|(position, buffer)| match buffers.contains(&position) {
                true => keep_fields(buffer, &["byteLength", "uri"]),
                false => json!({ "byteLength": 0, "uri": EMPTY_BUFFER }),
            })
            .collect(),
    };
    let node = |node: &Value| {
        keep_fields(
            node,
            &[
                "name",
                "children",
                "translation",
                "rotation",
                "scale",
                "matrix",
            ],
        )
    };
    let mut asset = keep_fields(&document["asset"], &["version"]);
    if document["asset"]["copyright"].is_string() {
        asset["copyright"] = document["asset"]["copyright"].clone();
    }
    let mut root = json!({
        "asset": asset,
        "nodes": list("nodes").iter().map(node).collect::<Vec<_>>(),
        "animations": reduced_animations,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": buffers,
    });
    for name in ["extensionsRequired", "extensionsUsed"] {
        // Extensions of animations and nodes do not change what bind matrices are.
        if document[name].is_array() && matches!(part, DocumentPart::Animation(_)) {
            root[name] = document[name].clone();
        }
    }
    Ok((root, compressed))
}

/// The compressed views of a document, by their index.
pub(super) type CompressedViews = BTreeMap<usize, CompressedView>;

/// Returns the compressed storage of a buffer view, if it has one.
fn compressed_view(view: &Value) -> Result<Option<CompressedView>, FormatProblem> {
    let mut extensions = meshopt::EXTENSIONS.iter();
    let found = extensions.find_map(|name| Some((name, view["extensions"].get(name)?)));
    found
        .map(|(name, extension)| {
            CompressedView::deserialize(extension).map_err(|error| format!("{name}: {error}"))
        })
        .transpose()
}

/// The URI of an empty buffer.
const EMPTY_BUFFER: &str = "data:application/octet-stream;base64,";

/// Returns the accessor of the inverse bind matrices of each skin.
pub(super) fn bind_matrix_accessors(document: &Value) -> Vec<Option<usize>> {
    let skins = document["skins"].as_array().into_iter().flatten();
    skins
        .map(|skin| index(&skin["inverseBindMatrices"]))
        .collect()
}

/// Returns the accessors of the triangles of all meshes.
fn surface_accessors(document: &Value) -> Vec<usize> {
    let meshes = document["meshes"].as_array().into_iter().flatten();
    let primitives = meshes.flat_map(|mesh| mesh["primitives"].as_array().into_iter().flatten());
    let values = |value: &Value, wanted: fn(&str) -> bool| -> Vec<usize> {
        let named = value.as_object().into_iter().flatten();
        { named.filter(|(name, _)| wanted(name)) }
            .filter_map(|(_, value)| index(value))
            .collect()
    };
    let mut accessors = Vec::new();
    for primitive in primitives {
        accessors.extend(index(&primitive["indices"]));
        accessors.extend(values(&primitive["attributes"], |name| {
            let single = ["POSITION", "NORMAL", "COLOR_0", "JOINTS_0", "WEIGHTS_0"];
            single.contains(&name) || name.starts_with("TEXCOORD_")
        }));
        for target in primitive["targets"].as_array().into_iter().flatten() {
            accessors.extend(values(target, |name| {
                ["POSITION", "NORMAL"].contains(&name)
            }));
        }
    }
    accessors
}

/// Reduces an animation to the channels that move nodes, and adds the indices of their accessors to `accessors`.
fn reduced_animation(animation: &Value, accessors: &mut BTreeSet<usize>) -> Value {
    let samplers = animation["samplers"].as_array();
    let channels = animation["channels"].as_array().into_iter().flatten();
    let channels: Vec<Value> = channels
        .filter(|channel| {
            let target = &channel["target"];
            // Channels without a node must be ignored (glTF 2.0, section 3.11), and weights move no node.
            target["node"].is_number()
                && ["translation", "rotation", "scale"]
                    .iter()
                    .any(|path| target["path"] == *path)
        })
        .map(|channel| {
            let mut kept = keep_fields(channel, &["sampler"]);
            kept["target"] = keep_fields(&channel["target"], &["node", "path"]);
            kept
        })
        .collect();
    for channel in &channels {
        let sampler = index(&channel["sampler"]).zip(samplers);
        if let Some(sampler) = sampler.and_then(|(position, samplers)| samplers.get(position)) {
            accessors.extend(index(&sampler["input"]));
            accessors.extend(index(&sampler["output"]));
        }
    }
    let samplers = samplers.into_iter().flatten();
    let samplers: Vec<Value> = samplers
        .map(|sampler| keep_fields(sampler, &["input", "output", "interpolation"]))
        .collect();
    with_name_of(
        animation,
        json!({ "channels": channels, "samplers": samplers }),
    )
}

/// Returns the indices of the buffer views of an accessor.
fn buffer_views(accessor: &Value) -> impl Iterator<Item = usize> {
    let sparse = &accessor["sparse"];
    let views = [
        &accessor["bufferView"],
        &sparse["indices"]["bufferView"],
        &sparse["values"]["bufferView"],
    ];
    views.map(index).into_iter().flatten()
}

/// Returns the value as an index, if it is one.
pub(super) fn index(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|index| usize::try_from(index).ok())
}

/// Returns an object with only the fields of these names. A value that is not an object is returned as it is; it becomes
/// an error when the document is deserialised.
fn keep_fields(value: &Value, names: &[&str]) -> Value {
    let Some(fields) = value.as_object() else {
        return value.clone();
    };
    let kept = names
        .iter()
        .filter_map(|name| Some(((*name).to_owned(), fields.get(*name)?.clone())));
    Value::Object(kept.collect::<Map<_, _>>())
}

/// Returns an object with the name of another object, if that has a name.
fn with_name_of(source: &Value, mut value: Value) -> Value {
    if source["name"].is_string() {
        value["name"] = source["name"].clone();
    }
    value
}
