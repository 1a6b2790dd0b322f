//! A glTF file whose parts are kept as they are: only what is added changes its text.

use std::io::Write;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use lamogen_files::glb::{GlbError, Surfaces, split_chunks};
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::value::{RawValue, to_raw_value};
use serde_json::{Value, json};

use crate::character::has_extension;
use crate::error::CharacterError;

/// The fields of a JSON object in their order, with the text of each value.
#[derive(Clone, Debug, Default)]
pub(crate) struct RawObject(Vec<(String, Box<RawValue>)>);

impl<'de> Deserialize<'de> for RawObject {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Fields;
        impl<'de> Visitor<'de> for Fields {
            type Value = RawObject;

            fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str("a JSON object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<RawObject, A::Error> {
                let mut fields = Vec::new();
                while let Some(field) = map.next_entry()? {
                    fields.push(field);
                }
                Ok(RawObject(fields))
            }
        }
        deserializer.deserialize_map(Fields)
    }
}

impl RawObject {
    /// Returns the text of a value.
    fn get(&self, name: &str) -> Option<&RawValue> {
        let field = self.0.iter().find(|(field, _)| field == name);
        field.map(|(_, value)| &**value)
    }

    /// Replaces a value, or appends it.
    fn set(&mut self, name: &str, value: Box<RawValue>) {
        match self.0.iter_mut().find(|(field, _)| field == name) {
            Some((_, old)) => *old = value,
            None => self.0.push((name.to_owned(), value)),
        }
    }

    /// Removes a value.
    fn remove(&mut self, name: &str) {
        self.0.retain(|(field, _)| field != name);
    }

    /// Returns the object as text.
    fn text(&self) -> String {
        let fields = self.0.iter().map(|(name, value)| {
            let name = serde_json::to_string(name).expect("text is JSON");
            format!("{name}:{}", value.get())
        });
        format!("{{{}}}", fields.collect::<Vec<_>>().join(","))
    }

    /// Returns the items of an array as text; none if there is no array.
    fn items(&self, name: &str) -> Vec<Box<RawValue>> {
        let array = self.get(name);
        array
            .and_then(|array| serde_json::from_str(array.get()).ok())
            .unwrap_or_default()
    }

    /// Replaces an array.
    fn set_items(&mut self, name: &str, items: &[Box<RawValue>]) {
        let items: Vec<&str> = items.iter().map(|item| item.get()).collect();
        let text = format!("[{}]", items.join(","));
        let value = RawValue::from_string(text).expect("an array of JSON values is JSON");
        self.set(name, value);
    }
}

/// A glTF file.
#[derive(Clone, Debug)]
pub(crate) struct GltfDocument {
    path: PathBuf,
    /// The folder of files that this one refers to; `None` if no other file may be read.
    folder: Option<PathBuf>,
    root: RawObject,
    /// The parts of the JSON that are read.
    value: Value,
    /// The bytes of the whole file.
    bytes: Vec<u8>,
    /// Whether the file is a GLB.
    is_binary: bool,
}

/// The most bytes of JSON of a file that somebody else made.
const MAX_JSON: usize = 8_000_000;
/// The most nodes of such a file.
const MAX_NODES: usize = 10_000;
/// The most joints of all skins of such a file.
const MAX_SKIN_JOINTS: usize = 50_000;

/// Returns the reason of an error without the path of the file, which is said elsewhere.
fn reason(error: GlbError) -> String {
    match error {
        GlbError::Format { reason, .. } => reason,
        error => error.to_string(),
    }
}

/// The type of the chunk of JSON in a GLB file.
const JSON_CHUNK: &[u8] = b"JSON";
/// The type of the binary chunk.
const BINARY_CHUNK: &[u8] = b"BIN\0";

impl GltfDocument {
    /// Parses the bytes of a `.glb`, `.vrm` or `.gltf` file. Files that it refers to are read from `folder`, if there is one.
    pub(crate) fn parse(
        bytes: Vec<u8>,
        path: &Path,
        folder: Option<&Path>,
    ) -> Result<GltfDocument, CharacterError> {
        let format_error = |reason: String| CharacterError::Format {
            path: path.to_owned(),
            reason,
        };
        let is_binary = bytes.starts_with(b"glTF");
        let (json, _) = match is_binary {
            true => split_chunks(&bytes).map_err(format_error)?,
            false => (&*bytes, None),
        };
        let text = std::str::from_utf8(json)
            .map_err(|_| format_error("expected glTF, found bytes that are no text".into()))?;
        let text = text
            .trim_start_matches('\u{feff}')
            .trim_end_matches(['\0', ' ']);
        let not_json = |error: serde_json::Error| format_error(format!("not glTF: {error}"));
        let root: RawObject = serde_json::from_str(text).map_err(not_json)?;
        let value: Value = serde_json::from_str(text).map_err(not_json)?;
        let version = value.pointer("/asset/version").and_then(Value::as_str);
        if !version.is_some_and(|version| version.starts_with("2.")) {
            let found = version.unwrap_or("none");
            return Err(format_error(format!(
                "expected glTF of version 2, found version {found}"
            )));
        }
        Ok(GltfDocument {
            path: path.to_owned(),
            folder: folder.map(Path::to_owned),
            root,
            value,
            bytes,
            is_binary,
        })
    }

    /// Returns the path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the binary chunk of the file; empty if it has none.
    fn binary_chunk(&self) -> &[u8] {
        let chunks = self.is_binary.then(|| split_chunks(&self.bytes));
        let chunk = chunks.and_then(|chunks| chunks.ok()?.1);
        chunk.unwrap_or_default()
    }

    /// Returns a part of the JSON.
    pub(crate) fn value(&self, name: &str) -> &Value {
        &self.value[name]
    }

    /// Returns the inverse bind matrices of every skin, column by column; `None` for a skin without them.
    pub(crate) fn inverse_bind_matrices(&self) -> Result<Vec<Option<Vec<[f64; 16]>>>, String> {
        lamogen_files::glb::inverse_bind_matrices(&self.bytes, &self.path, self.folder.as_deref())
            .map_err(reason)
    }

    /// Returns the surfaces of the file.
    pub(crate) fn surfaces(&self) -> Result<Surfaces, String> {
        lamogen_files::glb::surfaces(&self.bytes, &self.path).map_err(reason)
    }

    /// Checks that the JSON of a file is no larger than that of characters is: once parsed, it takes many times its size.
    pub(crate) fn check_json_size(bytes: &[u8], path: &Path) -> Result<(), CharacterError> {
        let found = split_chunks(bytes).map_or(0, |(json, _)| json.len());
        match found <= MAX_JSON {
            true => Ok(()),
            false => Err(CharacterError::Format {
                path: path.to_owned(),
                reason: format!("expected at most {MAX_JSON} bytes of JSON, found {found}"),
            }),
        }
    }

    /// Checks that the file is no larger than characters are, so that reading it takes no long time.
    pub(crate) fn check_size(&self) -> Result<(), CharacterError> {
        let length = |value: &Value| value.as_array().map_or(0, Vec::len);
        let skins = self.value["skins"].as_array().into_iter().flatten();
        let joints: usize = skins.map(|skin| length(&skin["joints"])).sum();
        let sizes = [
            ("nodes", length(&self.value["nodes"]), MAX_NODES),
            ("joints of skins", joints, MAX_SKIN_JOINTS),
        ];
        match sizes.into_iter().find(|(_, found, most)| found > most) {
            None => Ok(()),
            Some((name, found, most)) => Err(CharacterError::Format {
                path: self.path.clone(),
                reason: format!("expected at most {most} {name}, found {found}"),
            }),
        }
    }

    /// Returns the names of the file's animations.
    pub(crate) fn animation_names(&self) -> Vec<String> {
        let animations = self.value["animations"].as_array();
        let names = animations.into_iter().flatten();
        names
            .map(|animation| animation["name"].as_str().unwrap_or("").to_owned())
            .collect()
    }

    /// Writes the file with further animations. `replace` drops those that it has; their keyframes stay in the buffers.
    pub(crate) fn write(
        &self,
        path: &Path,
        animations: &[AnimationData],
        replace: bool,
    ) -> Result<(), CharacterError> {
        let wants_binary = !has_extension(path, "gltf");
        if wants_binary != self.is_binary {
            return Err(CharacterError::Container {
                path: path.to_owned(),
                expected: if self.is_binary {
                    ".glb or .vrm"
                } else {
                    ".gltf"
                },
                character: self.path.clone(),
            });
        }
        if !self.is_binary && !self.is_beside(path) {
            return Err(CharacterError::SideFiles {
                path: path.to_owned(),
                character: self.path.clone(),
            });
        }
        let content = self.content(animations, replace)?;
        lamogen_io::write_atomically(path, |mut file| self.write_content(&content, &mut file))
            .map_err(|reason| CharacterError::Write {
                path: path.to_owned(),
                reason,
            })
    }

    /// Returns the file with further animations. `replace` drops those that it has.
    pub(crate) fn bytes(
        &self,
        animations: &[AnimationData],
        replace: bool,
    ) -> Result<Vec<u8>, CharacterError> {
        let content = self.content(animations, replace)?;
        let mut bytes = Vec::new();
        self.write_content(&content, &mut bytes)
            .map_err(|reason| CharacterError::Write {
                path: self.path.clone(),
                reason,
            })?;
        Ok(bytes)
    }

    /// Returns the parts of the file with further animations.
    fn content(
        &self,
        animations: &[AnimationData],
        replace: bool,
    ) -> Result<DocumentContent, CharacterError> {
        let mut root = self.root.clone();
        if replace {
            root.remove("animations");
        }
        let old_chunk = self.binary_chunk();
        // A view's offset counts from the start of the buffer, and floats are aligned to four bytes.
        let has_chunk_buffer = self.is_binary && { self.value["buffers"].get(0) }
            .is_some_and(|buffer| buffer["uri"].is_null());
        let start = if has_chunk_buffer { old_chunk.len() } else { 0 };
        let mut data = vec![0; start.next_multiple_of(4) - start];
        let mut buffers = root.items("buffers");
        let buffer = if has_chunk_buffer { 0 } else { buffers.len() };
        for animation in animations {
            animation.append(&mut root, buffer, start, &mut data);
        }
        let total = start + data.len();
        if has_chunk_buffer {
            let mut first: RawObject = serde_json::from_str(buffers[0].get()).unwrap_or_default();
            first.set(
                "byteLength",
                to_raw_value(&total).expect("a number is JSON"),
            );
            buffers[0] = RawValue::from_string(first.text()).expect("an object is JSON");
        } else {
            let uri = format!(
                "data:application/octet-stream;base64,{}",
                STANDARD.encode(&data)
            );
            let new = json!({ "byteLength": data.len(), "uri": uri });
            buffers.push(to_raw_value(&new).expect("an object is JSON"));
        }
        root.set_items("buffers", &buffers);
        let json = root.text();
        if self.is_binary && self.bytes.len() + data.len() + json.len() > u32::MAX as usize {
            return Err(CharacterError::Format {
                path: self.path.clone(),
                reason: "expected at most 4 GiB, found more".into(),
            });
        }
        Ok(DocumentContent {
            json,
            data,
            total,
            has_chunk_buffer,
        })
    }

    /// Writes the parts of a file.
    fn write_content(
        &self,
        content: &DocumentContent,
        file: &mut dyn Write,
    ) -> std::io::Result<()> {
        let DocumentContent {
            json,
            data,
            total,
            has_chunk_buffer,
        } = content;
        let old_chunk = self.binary_chunk();
        if !self.is_binary {
            return file.write_all(json.as_bytes());
        }
        let json_length = json.len().next_multiple_of(4);
        let chunk_length = match *has_chunk_buffer {
            true => total.next_multiple_of(4),
            false => old_chunk.len(),
        };
        let chunk_header = if chunk_length > 0 { 8 } else { 0 };
        let length = 12 + 8 + json_length + chunk_header + chunk_length;
        let number = |value: usize| (value as u32).to_le_bytes();
        file.write_all(b"glTF")?;
        file.write_all(&number(2))?;
        file.write_all(&number(length))?;
        file.write_all(&number(json_length))?;
        file.write_all(JSON_CHUNK)?;
        file.write_all(json.as_bytes())?;
        file.write_all(&b"   "[..json_length - json.len()])?;
        if chunk_length == 0 {
            return Ok(());
        }
        file.write_all(&number(chunk_length))?;
        file.write_all(BINARY_CHUNK)?;
        file.write_all(old_chunk)?;
        if *has_chunk_buffer {
            file.write_all(data)?;
            file.write_all(&[0; 3][..chunk_length - *total])?;
        }
        Ok(())
    }

    /// Whether a path is in the folder of this file, or this file refers to no other file.
    fn is_beside(&self, path: &Path) -> bool {
        let uris = ["buffers", "images"].into_iter().flat_map(|name| {
            let items = self.value[name].as_array();
            items
                .into_iter()
                .flatten()
                .filter_map(|item| item["uri"].as_str())
        });
        let has_files = uris.filter(|uri| !uri.starts_with("data:")).count() > 0;
        let folder = |path: &Path| {
            let folder = path
                .parent()
                .filter(|folder| !folder.as_os_str().is_empty());
            folder.unwrap_or(Path::new(".")).canonicalize().ok()
        };
        !has_files || folder(path) == folder(&self.path)
    }
}

/// The parts of a file that is written.
struct DocumentContent {
    json: String,
    /// What comes after the binary chunk of the file.
    data: Vec<u8>,
    /// The length of the first buffer with the data.
    total: usize,
    /// Whether the first buffer is the binary chunk.
    has_chunk_buffer: bool,
}

/// A channel of an animation: the node it moves, and its keyframes.
#[derive(Clone, Debug)]
pub(crate) enum Channel {
    Rotation(usize, Vec<[f32; 4]>),
    Translation(usize, Vec<[f32; 3]>),
}

/// An animation to write: its name, the times of its keyframes, and its channels.
#[derive(Clone, Debug)]
pub(crate) struct AnimationData {
    pub(crate) name: String,
    pub(crate) copyright: Option<String>,
    /// What becomes of the travel, if it is not in the hips.
    pub(crate) notes: Option<String>,
    pub(crate) times: Vec<f32>,
    pub(crate) channels: Vec<Channel>,
}

impl AnimationData {
    /// Adds the animation to a document, and its keyframes to the data, which is in a buffer from `start` on.
    fn append(&self, root: &mut RawObject, buffer: usize, start: usize, data: &mut Vec<u8>) {
        let mut views = root.items("bufferViews");
        let mut accessors = root.items("accessors");
        let mut animations = root.items("animations");
        let raw = |value: &Value| to_raw_value(value).expect("an object is JSON");
        let mut add = |numbers: &mut dyn Iterator<Item = f32>,
                       kind: &str,
                       count,
                       bounds: Option<[f32; 2]>| {
            let before = data.len();
            data.extend(numbers.flat_map(f32::to_le_bytes));
            views.push(raw(&json!({
                "buffer": buffer, "byteOffset": start + before, "byteLength": data.len() - before,
            })));
            let mut accessor = json!({
                "bufferView": views.len() - 1, "componentType": 5126, "count": count, "type": kind,
            });
            if let Some([least, greatest]) = bounds {
                accessor["min"] = json!([least]);
                accessor["max"] = json!([greatest]);
            }
            accessors.push(raw(&accessor));
            accessors.len() - 1
        };
        let count = self.times.len();
        let mut times = |count: usize| {
            let bounds = [self.times[0], self.times[count - 1]];
            let numbers = &mut self.times[..count].iter().copied();
            add(numbers, "SCALAR", count, Some(bounds))
        };
        // What does not move has a single keyframe.
        let inputs = [times(1), times(count)];
        let (mut samplers, mut channels) = (Vec::new(), Vec::new());
        for channel in &self.channels {
            let (node, path, keyframes, output) = match channel {
                Channel::Rotation(node, values) => {
                    let moves = values.iter().any(|value| *value != values[0]);
                    let keyframes = if moves { count } else { 1 };
                    let numbers = &mut values[..keyframes].as_flattened().iter().copied();
                    (
                        node,
                        "rotation",
                        keyframes,
                        add(numbers, "VEC4", keyframes, None),
                    )
                }
                Channel::Translation(node, values) => {
                    let moves = values.iter().any(|value| *value != values[0]);
                    let keyframes = if moves { count } else { 1 };
                    let numbers = &mut values[..keyframes].as_flattened().iter().copied();
                    (
                        node,
                        "translation",
                        keyframes,
                        add(numbers, "VEC3", keyframes, None),
                    )
                }
            };
            let input = inputs[usize::from(keyframes == count)];
            samplers.push(json!({ "input": input, "output": output, "interpolation": "LINEAR" }));
            channels.push(json!({
                "sampler": samplers.len() - 1, "target": { "node": node, "path": path },
            }));
        }
        let mut animation = json!({
            "name": self.name, "channels": channels, "samplers": samplers,
        });
        if let Some(notes) = &self.notes {
            animation["extras"]["root_motion"] = json!(notes);
        }
        if let Some(copyright) = &self.copyright {
            animation["extras"]["copyright"] = json!(copyright);
        }
        animations.push(raw(&animation));
        root.set_items("bufferViews", &views);
        root.set_items("accessors", &accessors);
        root.set_items("animations", &animations);
    }
}
