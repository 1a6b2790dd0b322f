//! The part of a glTF document that says how nodes move.
//!
//! Files of other programs carry much that the specification allows or tells readers to ignore: extras of any type, channels without a node,
//! compressed meshes, animations that are broken beside the one that is asked for. Of all that nothing is read, so that nothing of it can be
//! wrong.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};

/// Cuts a document down to its nodes, the animation that is asked for (by its name, else the first), and what that refers to. Indices stay what
/// they are: what is not needed is replaced by the least that makes sense. Of other animations the names are left.
pub(super) fn relevant(document: &Value, animation: Option<&str>) -> Value {
    let list = |name: &str| document[name].as_array().map_or(&[][..], Vec::as_slice);
    let animations = list("animations");
    let chosen = match animation {
        None => Some(0),
        Some(asked) => animations.iter().position(|one| one["name"] == asked),
    };
    let mut accessors = BTreeSet::new();
    let cut: Vec<Value> = { animations.iter().enumerate() }
        .map(|(place, one)| match Some(place) == chosen {
            true => moving(one, &mut accessors),
            false => named(one, json!({ "channels": [], "samplers": [] })),
        })
        .collect();
    let mut used_views = BTreeSet::new();
    let accessors: Vec<Value> = { list("accessors").iter().enumerate() }
        .map(|(place, accessor)| match accessors.contains(&place) {
            true => {
                used_views.extend(places(accessor));
                only(
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
    let mut buffers = BTreeSet::new();
    let mut views: Vec<Value> = { list("bufferViews").iter().enumerate() }
        .map(|(place, view)| match used_views.contains(&place) {
            true => {
                buffers.extend(index(&view["buffer"]));
                let kept = ["buffer", "byteOffset", "byteLength", "byteStride"];
                only(view, &[&kept[..], &["extensions"]].concat())
            }
            false => json!({ "buffer": 0, "byteLength": 1 }),
        })
        .collect();
    // Accessors that stand for nothing point at the first view, views at the first buffer; so there is one of each.
    if views.is_empty() && !accessors.is_empty() {
        views.push(json!({ "buffer": 0, "byteLength": 1 }));
    }
    let all_buffers = list("buffers");
    let buffers: Vec<Value> = match (all_buffers, views.is_empty()) {
        ([], false) => vec![json!({ "byteLength": 0, "uri": EMPTY })],
        (all, _) => { all.iter().enumerate() }
            .map(|(place, buffer)| match buffers.contains(&place) {
                true => only(buffer, &["byteLength", "uri"]),
                false => json!({ "byteLength": 0, "uri": EMPTY }),
            })
            .collect(),
    };
    let node = |node: &Value| {
        only(
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
    let mut root = json!({
        "asset": only(&document["asset"], &["version"]),
        "nodes": list("nodes").iter().map(node).collect::<Vec<_>>(),
        "animations": cut,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": buffers,
    });
    for name in ["extensionsRequired", "extensionsUsed"] {
        if document[name].is_array() {
            root[name] = document[name].clone();
        }
    }
    root
}

/// A buffer of nothing.
const EMPTY: &str = "data:application/octet-stream;base64,";

/// An animation with the channels that move nodes, and the accessors of these.
fn moving(animation: &Value, accessors: &mut BTreeSet<usize>) -> Value {
    let samplers = animation["samplers"].as_array();
    let channels = animation["channels"].as_array().into_iter().flatten();
    let channels: Vec<Value> = channels
        .filter(|channel| {
            let target = &channel["target"];
            // A channel without a node is to be ignored (glTF 2.0, section 3.11); weights move no node.
            target["node"].is_number()
                && ["translation", "rotation", "scale"]
                    .iter()
                    .any(|path| target["path"] == *path)
        })
        .map(|channel| {
            let mut kept = only(channel, &["sampler"]);
            kept["target"] = only(&channel["target"], &["node", "path"]);
            kept
        })
        .collect();
    for channel in &channels {
        let sampler = index(&channel["sampler"]).zip(samplers);
        if let Some(sampler) = sampler.and_then(|(place, samplers)| samplers.get(place)) {
            accessors.extend(index(&sampler["input"]));
            accessors.extend(index(&sampler["output"]));
        }
    }
    let samplers = samplers.into_iter().flatten();
    let samplers: Vec<Value> = samplers
        .map(|sampler| only(sampler, &["input", "output", "interpolation"]))
        .collect();
    named(
        animation,
        json!({ "channels": channels, "samplers": samplers }),
    )
}

/// The buffer views of an accessor.
fn places(accessor: &Value) -> impl Iterator<Item = usize> {
    let sparse = &accessor["sparse"];
    let views = [
        &accessor["bufferView"],
        &sparse["indices"]["bufferView"],
        &sparse["values"]["bufferView"],
    ];
    views.map(index).into_iter().flatten()
}

fn index(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|index| usize::try_from(index).ok())
}

/// The fields of an object that have these names. What is no object stays what it is, for whoever reads it to say so.
fn only(value: &Value, names: &[&str]) -> Value {
    let Some(fields) = value.as_object() else {
        return value.clone();
    };
    let kept = names
        .iter()
        .filter_map(|name| Some(((*name).to_owned(), fields.get(*name)?.clone())));
    Value::Object(kept.collect::<Map<_, _>>())
}

/// An object with the name of another, if that has one.
fn named(of: &Value, mut value: Value) -> Value {
    if of["name"].is_string() {
        value["name"] = of["name"].clone();
    }
    value
}
