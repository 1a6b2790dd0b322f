//! The container of a glTF file: its checked JSON document and its buffers.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Component, Path};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gltf_json::accessor::{Accessor, ComponentType};
use gltf_json::buffer::View;
use gltf_json::validation::{Checked, Validate};
use gltf_json::{Index, Root};
use serde::Deserialize;
use serde_json::Value;

use super::GlbError;
use super::meshopt::{self, CompressedView, MAX_DECODED_BYTES};
use super::reduction::{CompressedViews, DocumentPart, reduce};
use crate::vrma;

/// The parts of a glTF file that are read.
pub(super) struct GltfFile<'a> {
    pub(super) root: Root,
    /// The whole document, for what `root` leaves out.
    pub(super) document: Value,
    buffers: Vec<Cow<'a, [u8]>>,
    /// The bytes of compressed views, by the index of the view.
    decoded: HashMap<usize, Vec<u8>>,
}

/// A description of what is wrong with a file, without the path of the file.
pub(super) type FormatProblem = String;

/// The most bytes of all buffers together.
const MAX_BYTES: u64 = 1 << 30;

/// The prefixes of the names of extensions that change the appearance or the storage of surfaces, but not the movement of
/// nodes.
const SURFACE_EXTENSIONS: [&str; 9] = [
    "KHR_materials_",
    "KHR_texture_",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "KHR_lights_punctual",
    "EXT_texture_",
    "EXT_mesh_gpu_instancing",
    "EXT_lights_",
    "MSFT_texture_dds",
];

impl<'a> GltfFile<'a> {
    /// Parses the bytes of a `.glb` or `.gltf` file, as far as a part of it needs them. The bytes themselves show which of the two
    /// kinds of files it is.
    ///
    /// Buffers may be in the file itself or, if there is a `folder`, in other files of it, but not in a network. `path` is
    /// used only in error messages.
    pub(super) fn parse(
        bytes: &'a [u8],
        path: &Path,
        folder: Option<&Path>,
        part: DocumentPart<'_>,
    ) -> Result<GltfFile<'a>, GlbError> {
        let format_error = |reason| GlbError::Format {
            path: path.to_owned(),
            reason,
        };
        let (json, chunk) = split_chunks(bytes).map_err(format_error)?;
        let Document {
            root,
            document,
            compressed,
        } = parse_document(json, part).map_err(format_error)?;
        let mut file = GltfFile {
            root,
            document,
            buffers: Vec::new(),
            decoded: HashMap::new(),
        };
        file.load_buffers(path, folder, chunk)?;
        file.decode_views(&compressed).map_err(format_error)?;
        Ok(file)
    }

    /// Decodes all compressed views.
    fn decode_views(&mut self, compressed: &CompressedViews) -> Result<(), FormatProblem> {
        let lengths = compressed.values().map(CompressedView::decoded_length);
        let total = lengths.sum::<Option<usize>>();
        if total.is_none_or(|total| total > MAX_DECODED_BYTES) {
            return Err(format!(
                "expected at most {MAX_DECODED_BYTES} bytes in all decompressed buffer views, found more"
            ));
        }
        for (&index, view) in compressed {
            let buffer = self.buffers.get(view.buffer);
            let bytes = buffer.and_then(|bytes| {
                bytes.get(view.byte_offset..view.byte_offset.checked_add(view.byte_length)?)
            });
            let decoded = bytes
                .ok_or_else(|| {
                    String::from("expected its buffer to be longer, found it to end before")
                })
                .and_then(|bytes| view.decode(bytes))
                .map_err(|problem| format!("bufferViews[{index}]: {problem}"))?;
            self.decoded.insert(index, decoded);
        }
        Ok(())
    }

    /// Loads the bytes of all buffers. `chunk` is the binary chunk of a GLB file.
    fn load_buffers(
        &mut self,
        path: &Path,
        folder: Option<&Path>,
        chunk: Option<&'a [u8]>,
    ) -> Result<(), GlbError> {
        let mut remaining = MAX_BYTES;
        for (index, buffer) in self.root.buffers.iter().enumerate() {
            let format_error = |reason| GlbError::Format {
                path: path.to_owned(),
                reason: format!("buffer {index}: {reason}"),
            };
            let length = buffer.byte_length.0;
            remaining = remaining.checked_sub(length).ok_or_else(|| {
                format_error(format!(
                    "expected at most {MAX_BYTES} bytes in all buffers, found more"
                ))
            })?;
            let bytes = match &buffer.uri {
                None if index == 0 => chunk.map(Cow::Borrowed).ok_or_else(|| {
                    format_error("expected the binary chunk of a GLB file, found none".into())
                })?,
                None => return Err(format_error("expected a URI, found none".into())),
                Some(uri) => match uri.strip_prefix("data:") {
                    Some(data) => Cow::Owned(decode_data_uri(data).map_err(format_error)?),
                    None => {
                        let relative = relative_path(uri).map_err(format_error)?;
                        let folder = folder.ok_or_else(|| {
                            format_error(format!(
                                "expected its bytes in this file, found the other file {uri:?}"
                            ))
                        })?;
                        let side = folder.join(relative);
                        let bytes = read_side_file(&side, length)
                            .map_err(|reason| GlbError::Io { path: side, reason })?;
                        Cow::Owned(bytes)
                    }
                },
            };
            if (bytes.len() as u64) < length {
                let found = bytes.len();
                return Err(format_error(format!(
                    "expected {length} bytes, found {found}"
                )));
            }
            self.buffers.push(bytes);
        }
        Ok(())
    }

    /// Returns the number of rows of an accessor, or 0 if there is no such accessor.
    pub(super) fn count(&self, accessor: Index<Accessor>) -> u64 {
        self.root
            .get(accessor)
            .map_or(0, |accessor| accessor.count.0)
    }

    /// Returns the rows of an accessor as floats. Normalised integers are converted to fractions.
    pub(super) fn floats<const N: usize>(
        &self,
        accessor: Index<Accessor>,
    ) -> Result<Vec<[f64; N]>, FormatProblem> {
        let index = accessor.value();
        self.rows(accessor)
            .map_err(|problem| format!("accessor {index}: {problem}"))
    }

    /// Returns the rows of an accessor as floats; errors do not name the accessor.
    fn rows<const N: usize>(
        &self,
        accessor: Index<Accessor>,
    ) -> Result<Vec<[f64; N]>, FormatProblem> {
        let accessor = self
            .root
            .get(accessor)
            .ok_or("expected an accessor, found none")?;
        let (Checked::Valid(component), Checked::Valid(kind)) =
            (accessor.component_type, accessor.type_)
        else {
            return Err("expected a known type, found another".into());
        };
        if kind.multiplicity() != N {
            let found = kind.multiplicity();
            return Err(format!("expected {N} numbers a row, found {found}"));
        }
        let component = component.0;
        let count = usize::try_from(accessor.count.0).map_err(|_| "its count is too large")?;
        if count == 0 {
            return Err("expected at least one row, found none".into());
        }
        let read = |bytes: &[u8]| component_value(bytes, component, accessor.normalized);
        let row = |bytes: &[u8]| -> [f64; N] {
            let mut numbers = bytes.chunks_exact(component.size()).map(read);
            std::array::from_fn(|_| numbers.next().expect("a row of N numbers"))
        };
        let size = component.size() * N;
        let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
        let mut rows: Vec<[f64; N]> = match (accessor.buffer_view, &accessor.sparse) {
            (Some(view), _) => self
                .strided_rows(view, offset, size, count)?
                .map(row)
                .collect(),
            // Values that are not stored are zero (glTF 2.0, section 3.6.2.3).
            (None, Some(_)) => vec![[0.0; N]; count],
            (None, None) => return Err("expected a buffer view, found none".into()),
        };
        if let Some(sparse) = &accessor.sparse {
            let in_sparse = |problem: FormatProblem| format!("sparse: {problem}");
            let sparse_count =
                usize::try_from(sparse.count.0).map_err(|_| "its count is too large")?;
            let Checked::Valid(kind) = sparse.indices.component_type else {
                return Err("sparse: expected indices of a known type, found another".into());
            };
            let kind = kind.0;
            let (indices, values) = (&sparse.indices, &sparse.values);
            let indices_bytes = self
                .strided_rows(
                    indices.buffer_view,
                    indices.byte_offset.0,
                    kind.size(),
                    sparse_count,
                )
                .map_err(in_sparse)?;
            let numbers = self
                .strided_rows(values.buffer_view, values.byte_offset.0, size, sparse_count)
                .map_err(in_sparse)?;
            for (index, bytes) in indices_bytes.zip(numbers) {
                let index = component_value(index, kind, false) as usize;
                *rows.get_mut(index).ok_or_else(|| {
                    format!("sparse: expected an index below {count}, found {index}")
                })? = row(bytes);
            }
        }
        match rows.as_flattened().iter().position(|x| !x.is_finite()) {
            Some(index) => Err(format!(
                "row {}: found a number that is not finite",
                index / N
            )),
            None => Ok(rows),
        }
    }

    /// Returns the bytes of a buffer view that is not compressed.
    pub(super) fn view(&self, view: Index<View>) -> Result<&[u8], FormatProblem> {
        let view = self.root.get(view);
        let view = view.ok_or("expected a buffer view, found none")?;
        let offset = view.byte_offset.map_or(0, |offset| offset.0);
        let bytes = &self.buffers[view.buffer.value()];
        slice(bytes, offset, Some(view.byte_length.0))
            .ok_or_else(|| "expected its buffer to be longer, found it to end before".into())
    }

    /// Returns `count` rows of `row` bytes each in a buffer view, from `offset` on.
    fn strided_rows(
        &self,
        view: Index<View>,
        offset: u64,
        row: usize,
        count: usize,
    ) -> Result<impl Iterator<Item = &[u8]>, FormatProblem> {
        let decoded = self.decoded.get(&view.value());
        let view = self.root.get(view);
        let view = view.ok_or("expected a buffer view, found none")?;
        let stride = view.byte_stride.map_or(row, |stride| stride.0.max(row));
        let stored = || {
            slice(
                &self.buffers[view.buffer.value()],
                view.byte_offset.map_or(0, |offset| offset.0),
                Some(view.byte_length.0),
            )
        };
        let bytes = { decoded.map(Vec::as_slice).or_else(stored) }
            .and_then(|view| slice(view, offset, None))
            .ok_or("expected its buffer to be longer, found it to end before")?;
        let end = match count.checked_sub(1) {
            None => Some(0),
            Some(last) => { last.checked_mul(stride) }.and_then(|start| start.checked_add(row)),
        };
        if end.is_none_or(|end| end > bytes.len()) {
            let found = bytes.len();
            return Err(format!(
                "expected {count} rows of {row} bytes, found {found} bytes"
            ));
        }
        Ok((0..count).map(move |index| &bytes[index * stride..][..row]))
    }
}

/// Returns the bytes from `offset` on, up to `length` bytes or to the end; `None` if there are too few.
fn slice(bytes: &[u8], offset: u64, length: Option<u64>) -> Option<&[u8]> {
    let rest = bytes.get(usize::try_from(offset).ok()?..)?;
    match length {
        Some(length) => rest.get(..usize::try_from(length).ok()?),
        None => Some(rest),
    }
}

/// Converts one component of an accessor to a float. If `normalized`, integers are converted to fractions as animations
/// use them (glTF 2.0, section 3.11).
fn component_value(bytes: &[u8], component: ComponentType, normalized: bool) -> f64 {
    let (value, one) = match component {
        ComponentType::I8 => (f64::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => (f64::from(bytes[0]), 255.0),
        ComponentType::I16 => (f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        ComponentType::U16 => (f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        ComponentType::U32 => {
            let value = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            (f64::from(value), f64::from(u32::MAX))
        }
        ComponentType::F32 => {
            let value = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            return f64::from(value);
        }
    };
    match normalized {
        true => (value / one).max(-1.0),
        false => value,
    }
}

/// Splits the bytes of a glTF file into its JSON and, if it is GLB, its binary chunk.
///
/// # Errors
///
/// If the bytes are neither JSON nor GLB of version 2, or are cut short. The text of the error does not name the file.
pub fn split_chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    if !bytes.starts_with(b"glTF") {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        return match text.trim_ascii_start().first() {
            Some(b'{') => Ok((text, None)),
            _ => Err("expected glTF, binary or JSON, found something else".into()),
        };
    }
    let cut_short = || String::from("expected a whole GLB file, found it cut short");
    let word = |offset: usize| -> Result<usize, FormatProblem> {
        let word = bytes.get(offset..offset + 4).ok_or_else(cut_short)?;
        let word = u32::from_le_bytes(word.try_into().expect("four bytes"));
        usize::try_from(word).map_err(|_| cut_short())
    };
    match word(4)? {
        2 => {}
        version => return Err(format!("expected GLB of version 2, found {version}")),
    }
    let file = bytes.get(..word(8)?).ok_or_else(cut_short)?;
    let (mut json, mut binary, mut offset) = (None, None, 12);
    while offset < file.len() {
        let start = offset + 8;
        let end = start.checked_add(word(offset)?).ok_or_else(cut_short)?;
        let chunk = file.get(start..end).ok_or_else(cut_short)?;
        match &file[offset + 4..start] {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            // Readers must ignore other chunks (glTF 2.0, section 4.4.3).
            _ => {}
        }
        offset = end;
    }
    let json = json.ok_or("expected a JSON chunk, found none")?;
    Ok((json, binary))
}

/// The parts of a document that are read.
struct Document {
    root: Root,
    document: Value,
    compressed: CompressedViews,
}

/// Parses and checks a part of the document, and ignores all that only changes the appearance.
fn parse_document(json: &[u8], part: DocumentPart<'_>) -> Result<Document, FormatProblem> {
    #[derive(Deserialize)]
    struct DocumentVersion {
        asset: Asset,
    }
    #[derive(Deserialize)]
    struct Asset {
        version: String,
    }
    let unreadable = |error: serde_json::Error| format!("its JSON is not glTF's: {error}");
    // Some programs write names in other encodings than UTF-8.
    let document: Value =
        serde_json::from_str(&String::from_utf8_lossy(json)).map_err(unreadable)?;
    let DocumentVersion { asset } = DocumentVersion::deserialize(&document).map_err(unreadable)?;
    if asset.version.split('.').next() != Some("2") {
        return Err(format!("expected glTF 2, found version {}", asset.version));
    }
    let (reduced, compressed) = reduce(&document, part)?;
    let mut root = Root::deserialize(reduced).map_err(unreadable)?;
    root.extensions_required.retain(|name| {
        !SURFACE_EXTENSIONS
            .iter()
            .any(|start| name.starts_with(start))
            && !meshopt::EXTENSIONS.contains(&&**name)
            && name != vrma::EXTENSION
    });
    let mut problems = Vec::new();
    root.validate(&root, gltf_json::Path::new, &mut |path, error| {
        problems.push(format!("{}: {error}", path()));
    });
    match problems.into_iter().next() {
        Some(problem) => Err(problem),
        None => Ok(Document {
            root,
            document,
            compressed,
        }),
    }
}

/// Decodes the bytes of a `data:` URI.
pub(super) fn decode_data_uri(data: &str) -> Result<Vec<u8>, FormatProblem> {
    let (_, text) = data
        .split_once(";base64,")
        .ok_or("expected base64 in its data URI, found another coding")?;
    STANDARD
        .decode(text.trim_ascii())
        .map_err(|error| format!("its data URI is no base64: {error}"))
}

/// Returns the path of the file that a relative URI names.
fn relative_path(uri: &str) -> Result<std::path::PathBuf, FormatProblem> {
    let refused =
        || format!("expected a file beside this one or in a folder below, found the URI {uri:?}");
    let mut name = Vec::with_capacity(uri.len());
    let mut bytes = uri.bytes();
    while let Some(byte) = bytes.next() {
        name.push(match byte {
            b'%' => {
                let digits = [bytes.next(), bytes.next()];
                let digit = |byte: Option<u8>| char::from(byte?).to_digit(16);
                let [Some(high), Some(low)] = digits.map(digit) else {
                    return Err(refused());
                };
                (16 * high + low) as u8
            }
            byte => byte,
        });
    }
    let name = String::from_utf8(name).map_err(|_| refused())?;
    let path = std::path::PathBuf::from(&name);
    // Never a file above this folder: an untrusted glTF file must not make other files be read.
    let is_plain =
        { path.components() }.all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    match is_plain && !name.is_empty() && !name.contains([':', '\0']) {
        true => Ok(path),
        false => Err(refused()),
    }
}

/// Reads at most `length` bytes of a regular file. Devices and pipes are errors.
fn read_side_file(path: &Path, length: u64) -> io::Result<Vec<u8>> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "not a regular file",
        ));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_name_files_beside_the_gltf_file_and_no_others() {
        assert_eq!(
            relative_path("a%20b/walk.bin").unwrap(),
            Path::new("a b/walk.bin")
        );
        for uri in [
            "",
            "/etc/hostname",
            "https://example.org/walk.bin",
            "file:///etc/hostname",
            "C:\\walk.bin",
            "walk%2",
            "walk%zz.bin",
            "%ff",
            "%2Fetc%2Fhostname",
            "walk%00.bin",
        ] {
            assert!(relative_path(uri).is_err(), "{uri}");
        }
    }

    #[test]
    fn normalised_integers_are_fractions() {
        assert_eq!(component_value(&[0x80], ComponentType::I8, true), -1.0);
        assert_eq!(component_value(&[0xff], ComponentType::U8, true), 1.0);
        assert_eq!(
            component_value(&[0xff, 0x7f], ComponentType::I16, true),
            1.0
        );
        assert_eq!(component_value(&[2, 1], ComponentType::U16, false), 258.0);
        assert_eq!(
            component_value(&1.5f32.to_le_bytes(), ComponentType::F32, true),
            1.5
        );
    }
}
