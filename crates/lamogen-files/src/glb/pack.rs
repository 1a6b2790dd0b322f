//! The numbers of a glTF file: one buffer, and what says where in it each array lies.

use serde_json::{Value, json};

/// What a buffer view is for: vertices, their order, or anything else.
#[derive(Clone, Copy)]
pub(super) enum Purpose {
    Vertices,
    Indices,
    Other,
}

/// Arrays laid one behind the other, each in a buffer view and an accessor of its own, at multiples of
/// four bytes.
#[derive(Default)]
pub(super) struct Pack {
    pub(super) bytes: Vec<u8>,
    pub(super) views: Vec<Value>,
    pub(super) accessors: Vec<Value>,
    /// Whether a float was added that JSON cannot hold.
    pub(super) is_broken: bool,
}

const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const FLOAT: u32 = 5126;

impl Pack {
    /// Adds rows of floats with their smallest and largest values, which viewers need of times and
    /// positions. Answers with the accessor's index.
    pub(super) fn floats<const N: usize>(&mut self, rows: &[[f32; N]], purpose: Purpose) -> usize {
        self.is_broken |= rows.iter().flatten().any(|x| !x.is_finite());
        let bytes = rows.iter().flatten().flat_map(|x| x.to_le_bytes());
        let accessor = self.push(bytes, FLOAT, N, rows.len(), purpose);
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

    /// Adds rows of four bytes.
    pub(super) fn bytes(&mut self, rows: &[[u8; 4]], purpose: Purpose) -> usize {
        let bytes = rows.iter().flatten().copied();
        self.push(bytes, UNSIGNED_BYTE, 4, rows.len(), purpose)
    }

    /// Adds whole numbers of 16 bits.
    pub(super) fn shorts(&mut self, values: &[u16], purpose: Purpose) -> usize {
        let bytes = values.iter().flat_map(|x| x.to_le_bytes());
        self.push(bytes, UNSIGNED_SHORT, 1, values.len(), purpose)
    }

    fn push(
        &mut self,
        bytes: impl Iterator<Item = u8>,
        component_type: u32,
        components: usize,
        count: usize,
        purpose: Purpose,
    ) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let mut view = json!({
            "buffer": 0,
            "byteOffset": offset,
            "byteLength": self.bytes.len() - offset,
        });
        match purpose {
            Purpose::Vertices => view["target"] = json!(34962),
            Purpose::Indices => view["target"] = json!(34963),
            Purpose::Other => {}
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_lie_at_multiples_of_four_and_floats_know_their_bounds() {
        let mut pack = Pack::default();
        assert_eq!(pack.shorts(&[1, 2, 3], Purpose::Indices), 0);
        let rows = [[0.1, -2.0, 3.0], [0.5, 4.0, -1.0]];
        assert_eq!(pack.floats(&rows, Purpose::Vertices), 1);
        assert_eq!(pack.views[0]["byteLength"], 6);
        assert_eq!(pack.views[1]["byteOffset"], 8);
        assert_eq!(pack.bytes.len(), 8 + 24);
        // As 32-bit numbers are, not as they were written in the source.
        assert_eq!(
            pack.accessors[1]["min"],
            json!([f64::from(0.1f32), -2.0, -1.0])
        );
        assert_eq!(pack.accessors[1]["max"], json!([0.5, 4.0, 3.0]));
        assert_eq!(pack.accessors[1]["type"], "VEC3");
    }
}
