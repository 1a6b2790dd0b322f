//! The numbers of a glTF file that is written: one buffer, with a buffer view and an accessor for each array.

use serde_json::{Value, json};

use super::GlbError;

/// The target of a buffer view: vertex attributes, vertex indices, or neither.
#[derive(Clone, Copy)]
pub(crate) enum BufferViewTarget {
    Vertices,
    Indices,
    Other,
}

/// A buffer under construction. Its arrays follow one another at multiples of four bytes, each with a buffer view and an
/// accessor.
#[derive(Default)]
pub(crate) struct BufferBuilder {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// Whether a float that JSON cannot represent, such as infinity, was added.
    has_non_finite: bool,
}

const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const FLOAT: u32 = 5126;

impl BufferBuilder {
    /// Adds rows of floats with their smallest and largest values, which viewers need for times and positions. Returns the
    /// index of the accessor.
    pub(crate) fn push_floats<const N: usize>(
        &mut self,
        rows: &[[f32; N]],
        target: BufferViewTarget,
    ) -> usize {
        self.has_non_finite |= rows.iter().flatten().any(|x| !x.is_finite());
        let bytes = rows.iter().flatten().flat_map(|x| x.to_le_bytes());
        let accessor = self.push_array(bytes, FLOAT, N, rows.len(), target);
        let bound = |pick: fn(f32, f32) -> f32| -> Vec<f64> {
            (0..N)
                .filter_map(|axis| rows.iter().map(|row| row[axis]).reduce(pick))
                .map(f64::from)
                .collect()
        };
        self.accessors[accessor]["min"] = json!(bound(f32::min));
        self.accessors[accessor]["max"] = json!(bound(f32::max));
        accessor
    }

    /// Adds rows of four bytes. Returns the index of the accessor.
    pub(super) fn push_bytes(&mut self, rows: &[[u8; 4]], target: BufferViewTarget) -> usize {
        let bytes = rows.iter().flatten().copied();
        self.push_array(bytes, UNSIGNED_BYTE, 4, rows.len(), target)
    }

    /// Adds integers of 16 bits. Returns the index of the accessor.
    pub(super) fn push_shorts(&mut self, values: &[u16], target: BufferViewTarget) -> usize {
        let bytes = values.iter().flat_map(|x| x.to_le_bytes());
        self.push_array(bytes, UNSIGNED_SHORT, 1, values.len(), target)
    }

    /// Returns the bytes of a GLB file with a document and this buffer.
    ///
    /// # Errors
    ///
    /// If a number is not finite, or the file would be larger than 4 GiB.
    pub(crate) fn into_glb(self, mut document: Value) -> Result<Vec<u8>, GlbError> {
        if self.has_non_finite {
            return Err(GlbError::NotFinite);
        }
        document["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        document["bufferViews"] = Value::Array(self.views);
        document["accessors"] = Value::Array(self.accessors);
        glb_container(document.to_string().into_bytes(), self.bytes)
    }

    /// Adds the bytes of an array of `count` rows. Returns the index of the accessor.
    fn push_array(
        &mut self,
        bytes: impl Iterator<Item = u8>,
        component_type: u32,
        components: usize,
        count: usize,
        target: BufferViewTarget,
    ) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let mut view = json!({
            "buffer": 0,
            "byteOffset": offset,
            "byteLength": self.bytes.len() - offset,
        });
        match target {
            BufferViewTarget::Vertices => view["target"] = json!(34962),
            BufferViewTarget::Indices => view["target"] = json!(34963),
            BufferViewTarget::Other => {}
        }
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.accessors.push(json!({
            "bufferView": self.views.len(),
            "componentType": component_type,
            "count": count,
            "type": match components {
                1 => "SCALAR",
                3 => "VEC3",
                4 => "VEC4",
                16 => "MAT4",
                other => unreachable!("glTF has no arrays of {other} components here"),
            },
        }));
        self.views.push(view);
        self.accessors.len() - 1
    }
}

/// Joins the three parts of a GLB file: header, JSON padded with spaces, and bytes.
fn glb_container(mut json: Vec<u8>, bytes: Vec<u8>) -> Result<Vec<u8>, GlbError> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + bytes.len();
    let length = |n: usize| u32::try_from(n).map_err(|_| GlbError::TooLarge { bytes: total });
    let mut file = Vec::with_capacity(total);
    file.extend(b"glTF");
    file.extend(2u32.to_le_bytes());
    file.extend(length(total)?.to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bytes)] {
        file.extend(length(chunk.len())?.to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_start_at_multiples_of_four_and_floats_have_bounds() {
        let mut buffer = BufferBuilder::default();
        assert_eq!(buffer.push_shorts(&[1, 2, 3], BufferViewTarget::Indices), 0);
        let rows = [[0.1, -2.0, 3.0], [0.5, 4.0, -1.0]];
        assert_eq!(buffer.push_floats(&rows, BufferViewTarget::Vertices), 1);
        assert_eq!(buffer.views[0]["byteLength"], 6);
        assert_eq!(buffer.views[1]["byteOffset"], 8);
        assert_eq!(buffer.bytes.len(), 8 + 24);
        // The bounds are the values after rounding to 32 bits.
        assert_eq!(
            buffer.accessors[1]["min"],
            json!([f64::from(0.1f32), -2.0, -1.0])
        );
        assert_eq!(buffer.accessors[1]["max"], json!([0.5, 4.0, 3.0]));
        assert_eq!(buffer.accessors[1]["type"], "VEC3");
    }
}
