//! Decompression of buffer views (`EXT_meshopt_compression`, `KHR_meshopt_compression`), after the specification of the bitstream in
//! the appendices of `KHR_meshopt_compression`.
//!
//! ```text
//! bytes ──mode: attributes, indices──▶ elements ──filter: quaternion, exponential──▶ elements as the accessors read them
//! ```
//!
//! What only meshes use (triangles, the octahedral and the colour filter) is not decoded.

use serde::Deserialize;

use super::container::FormatProblem;

/// The names of the extension.
pub(super) const EXTENSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// The compressed storage of a buffer view, as its extension describes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct CompressedView {
    /// The buffer with the compressed bytes.
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    byte_stride: usize,
    count: usize,
    mode: String,
    #[serde(default)]
    filter: Option<String>,
}

/// The most bytes that all views of a file may have when they are decoded: keyframes of a hundred joints over an hour.
pub(super) const MAX_DECODED_BYTES: usize = 1 << 28;

/// The elements of a group, whose deltas are stored with the same number of bits.
const GROUP: usize = 16;

impl CompressedView {
    /// Returns the number of bytes of the view when it is decoded; `None` if these are too many.
    pub(super) fn decoded_length(&self) -> Option<usize> {
        let length = self.byte_stride.checked_mul(self.count);
        length.filter(|length| *length <= MAX_DECODED_BYTES)
    }

    /// Decodes the bytes of the view.
    pub(super) fn decode(&self, bytes: &[u8]) -> Result<Vec<u8>, FormatProblem> {
        let length = self.decoded_length().ok_or_else(|| {
            format!(
                "expected at most {MAX_DECODED_BYTES} bytes when it is decompressed, found {} elements of {} bytes",
                self.count, self.byte_stride
            )
        })?;
        let stride = self.byte_stride;
        let mut elements = match &*self.mode {
            "ATTRIBUTES" if (4..=256).contains(&stride) && stride.is_multiple_of(4) => {
                decode_attributes(bytes, stride, self.count)
            }
            "INDICES" if stride == 2 || stride == 4 => decode_indices(bytes, stride, self.count),
            "ATTRIBUTES" | "INDICES" => {
                let mode = &self.mode;
                return Err(format!("found a stride of {stride} bytes, which the compression mode {mode} does not have"));
            }
            mode => return Err(format!("expected keyframes in the compression mode ATTRIBUTES, found {mode}")),
        }
        .ok_or("its compressed data are damaged")?;
        debug_assert_eq!(elements.len(), length);
        match self.filter.as_deref() {
            None | Some("NONE") => {}
            Some("QUATERNION") if stride == 8 => {
                elements.chunks_exact_mut(8).for_each(unfilter_quaternion)
            }
            Some("EXPONENTIAL") => elements.chunks_exact_mut(4).for_each(unfilter_exponential),
            Some(filter) => {
                return Err(format!(
                    "expected keyframes with the filter QUATERNION or EXPONENTIAL or none, found {filter} with a stride of {stride} bytes"
                ));
            }
        }
        Ok(elements)
    }
}

/// Reads bytes from the front of a slice.
struct Reader<'b>(&'b [u8]);

impl<'b> Reader<'b> {
    fn take(&mut self, count: usize) -> Option<&'b [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|bytes| bytes[0])
    }

    /// Reads an unsigned LEB128 number of at most five bytes.
    fn leb128(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= u32::from(byte & 127).wrapping_shl(shift);
            if byte < 128 {
                return Some(value);
            }
        }
        None
    }
}

/// Decodes the mode "attributes": deltas to the previous element, byte by byte.
fn decode_attributes(bytes: &[u8], stride: usize, count: usize) -> Option<Vec<u8>> {
    let version = match bytes.first()? {
        0xa0 => 0,
        0xa1 => 1,
        _ => return None,
    };
    let channels = if version == 1 { stride / 4 } else { 0 };
    let least_tail = if version == 1 { 24 } else { 32 };
    let body_end = bytes
        .len()
        .checked_sub((stride + channels).max(least_tail))?;
    let mut reader = Reader(bytes.get(1..body_end)?);
    let (baseline, modes) = bytes[bytes.len() - stride - channels..].split_at(stride);
    let mode = |channel: usize| modes.get(channel).copied().unwrap_or(0);
    let is_known = |mode: u8| mode < 2 || mode & 15 == 2;
    if !(0..stride / 4).all(|channel| is_known(mode(channel))) {
        return None;
    }

    let mut elements = Vec::with_capacity(stride * count);
    let mut previous = baseline.to_vec();
    let most = ((8192 / stride) & !(GROUP - 1)).min(256);
    let mut deltas = vec![0; stride * most];
    let mut remaining = count;
    while remaining > 0 {
        let block = remaining.min(most);
        let groups = block.div_ceil(GROUP);
        let rows = groups * GROUP;
        let controls = reader.take(channels)?;
        for (position, deltas) in deltas.chunks_exact_mut(most).enumerate() {
            let deltas = &mut deltas[..rows];
            let control = controls.get(position / 4);
            match control.map(|byte| byte >> (2 * (position % 4)) & 3) {
                None => decode_deltas(&mut reader, deltas, [0, 2, 4, 8])?,
                Some(0) => decode_deltas(&mut reader, deltas, [0, 1, 2, 4])?,
                Some(1) => decode_deltas(&mut reader, deltas, [1, 2, 4, 8])?,
                Some(2) => deltas.fill(0),
                // Only as many as there are elements, not whole groups.
                Some(_) => deltas[..block].copy_from_slice(reader.take(block)?),
            }
        }
        for row in 0..block {
            for channel in 0..stride / 4 {
                let delta = std::array::from_fn(|byte| deltas[(4 * channel + byte) * most + row]);
                let value = &mut previous[4 * channel..][..4];
                let before = value.try_into().expect("four bytes");
                value.copy_from_slice(&add_delta(before, delta, mode(channel)));
            }
            elements.extend_from_slice(&previous);
        }
        remaining -= block;
    }
    reader
        .0
        .iter()
        .all(|padding| *padding == 0)
        .then_some(elements)
}

/// Decodes the deltas of one byte of all elements of a block: for each group of 16 two bits that choose one of four numbers of bits, then
/// the groups.
fn decode_deltas(reader: &mut Reader<'_>, deltas: &mut [u8], widths: [u32; 4]) -> Option<()> {
    let groups = deltas.len() / GROUP;
    let headers = reader.take(groups.div_ceil(4))?;
    for (group, deltas) in deltas.chunks_exact_mut(GROUP).enumerate() {
        let width = widths[usize::from(headers[group / 4] >> (2 * (group % 4)) & 3)];
        match width {
            0 => deltas.fill(0),
            8 => deltas.copy_from_slice(reader.take(GROUP)?),
            width => {
                let packed = reader.take(2 * width as usize)?;
                let (sentinel, per_byte) = ((1 << width) - 1, 8 / width as usize);
                for (place, delta) in deltas.iter_mut().enumerate() {
                    let within = (place % per_byte) as u32 * width;
                    // Single bits begin with the lowest, others with the highest.
                    let shift = if width == 1 {
                        within
                    } else {
                        8 - width - within
                    };
                    *delta = packed[place / per_byte] >> shift & sentinel;
                }
                for delta in deltas.iter_mut().filter(|delta| **delta == sentinel) {
                    *delta = reader.byte()?;
                }
            }
        }
    }
    Some(())
}

/// Adds a delta to the four bytes of a channel.
fn add_delta(before: [u8; 4], delta: [u8; 4], mode: u8) -> [u8; 4] {
    match mode & 15 {
        0 => std::array::from_fn(|byte| {
            let delta = delta[byte];
            before[byte].wrapping_add((delta >> 1) ^ (delta & 1).wrapping_neg())
        }),
        1 => {
            let half = |place: usize| {
                let [before, delta] = [before, delta]
                    .map(|bytes| u16::from_le_bytes([bytes[place], bytes[place + 1]]));
                before
                    .wrapping_add((delta >> 1) ^ (delta & 1).wrapping_neg())
                    .to_le_bytes()
            };
            let ([a, b], [c, d]) = (half(0), half(2));
            [a, b, c, d]
        }
        _ => {
            let delta = u32::from_le_bytes(delta).rotate_left(u32::from(mode >> 4));
            (u32::from_le_bytes(before) ^ delta).to_le_bytes()
        }
    }
}

/// Decodes the mode "indices": deltas to one of two baselines.
fn decode_indices(bytes: &[u8], stride: usize, count: usize) -> Option<Vec<u8>> {
    let end = bytes.len().checked_sub(4)?;
    let (0xd1, mut reader) = (*bytes.first()?, Reader(bytes.get(1..end)?)) else {
        return None;
    };
    let mut elements = Vec::with_capacity(stride * count);
    let mut last = [0_u32; 2];
    for _ in 0..count {
        let value = reader.leb128()?;
        let delta = (value >> 2) ^ (value >> 1 & 1).wrapping_neg();
        let last = &mut last[(value & 1) as usize];
        *last = last.wrapping_add(delta);
        elements.extend_from_slice(&last.to_le_bytes()[..stride]);
    }
    reader.0.is_empty().then_some(elements)
}

/// Decodes a quaternion of which the largest component was left out; the result has four normalised 16-bit integers.
fn unfilter_quaternion(element: &mut [u8]) {
    let number = |place: usize| i16::from_le_bytes([element[2 * place], element[2 * place + 1]]);
    let one = f32::from(number(3) | 3);
    let [x, y, z] =
        [0, 1, 2].map(|place| f32::from(number(place)) / one * std::f32::consts::FRAC_1_SQRT_2);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let largest = usize::from(number(3) as u16 & 3);
    for (step, value) in [w, x, y, z].into_iter().enumerate() {
        let place = (largest + step) % 4;
        let value = (value * 32767.0).round() as i16;
        element[2 * place..][..2].copy_from_slice(&value.to_le_bytes());
    }
}

/// Decodes a number of an exponent of 8 bits and a mantissa of 24 bits; the result is a 32-bit float.
fn unfilter_exponential(element: &mut [u8]) {
    let value = i32::from_le_bytes(element.try_into().expect("four bytes"));
    let (exponent, mantissa) = (value >> 24, value << 8 >> 8);
    let float = (f64::from(mantissa) * f64::from(exponent).exp2()) as f32;
    element.copy_from_slice(&float.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A compressed view, and the hash of what it is when it is decoded.
    #[derive(Deserialize)]
    struct Case {
        name: String,
        bytes: String,
        fnv: String,
        /// What it is when it is decoded, where decoders may round differently.
        #[serde(default)]
        decoded: String,
        #[serde(flatten)]
        view: serde_json::Value,
    }

    impl Case {
        fn view(&self) -> (CompressedView, Vec<u8>) {
            let byte =
                |place: usize| u8::from_str_radix(&self.bytes[place..place + 2], 16).unwrap();
            let bytes: Vec<u8> = (0..self.bytes.len()).step_by(2).map(byte).collect();
            let mut view = self.view.clone();
            view["buffer"] = 0.into();
            view["byteLength"] = bytes.len().into();
            (CompressedView::deserialize(&view).unwrap(), bytes)
        }
    }

    fn from_hex(text: &str) -> Vec<u8> {
        let byte = |place: usize| u8::from_str_radix(&text[place..place + 2], 16).unwrap();
        (0..text.len()).step_by(2).map(byte).collect()
    }

    /// Keyframes of ours as the encoder of meshoptimizer 1.3.0 compresses them, with what its decoder makes of them.
    fn cases() -> Vec<Case> {
        serde_json::from_str(include_str!("meshopt-cases.json")).unwrap()
    }

    fn fnv(bytes: &[u8]) -> String {
        let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        });
        format!("{hash:016x}")
    }

    #[test]
    fn views_are_decoded_as_by_meshoptimizer() {
        let cases = cases();
        assert!(cases.len() > 15);
        for case in cases {
            let (view, bytes) = case.view();
            let decoded = view
                .decode(&bytes)
                .unwrap_or_else(|error| panic!("{}: {error}", case.name));
            match view.filter.as_deref() {
                // Its results are specified to one unit in the last place.
                Some("QUATERNION") => {
                    let numbers = |bytes: &[u8]| -> Vec<i16> {
                        let (pairs, _) = bytes.as_chunks();
                        pairs.iter().copied().map(i16::from_le_bytes).collect()
                    };
                    let (found, expected) = (numbers(&decoded), numbers(&from_hex(&case.decoded)));
                    assert_eq!(found.len(), expected.len());
                    let mut pairs = found.iter().zip(&expected);
                    assert!(pairs.all(|(a, b)| (a - b).abs() <= 1), "{}", case.name);
                }
                _ => assert_eq!(fnv(&decoded), case.fnv, "{}", case.name),
            }
        }
    }

    #[test]
    fn damage_is_an_error_or_other_numbers_and_never_a_panic() {
        let mut state = 7_u64;
        for case in cases() {
            let (view, bytes) = case.view();
            for cut in 0..bytes.len() {
                assert!(view.decode(&bytes[..cut]).is_err() || view.mode == "ATTRIBUTES");
            }
            for _ in 0..300 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let mut damaged = bytes.clone();
                let place = (state >> 33) as usize % damaged.len();
                damaged[place] ^= (state >> 20) as u8;
                let _ = view.decode(&damaged);
            }
            let large = CompressedView {
                count: usize::MAX / 2,
                ..view.clone()
            };
            assert!(large.decode(&bytes).unwrap_err().contains("at most"));
            let other = CompressedView {
                mode: "TRIANGLES".into(),
                ..view.clone()
            };
            assert!(other.decode(&bytes).unwrap_err().contains("TRIANGLES"));
            let odd = CompressedView {
                byte_stride: 7,
                ..view
            };
            assert!(odd.decode(&bytes).unwrap_err().contains("stride of 7"));
        }
    }
}
