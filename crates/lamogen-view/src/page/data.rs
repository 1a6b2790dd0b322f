//! The data that the script of the page reads: motions and curves, as JSON with numbers in base64.

use lamogen_laban::{Component, Tag};
use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, Motion, TimedCaption};
use serde_json::{Value, json};

use super::PageFigure;
use super::markup::escape_json;
use crate::LabanCurve;
use crate::text::printable;

/// The unit of the embedded integers, in metres.
const STEP: f64 = 1e-4;

/// Returns the data of a page as JSON for a `script` element.
///
/// - `joints`: the names in the order of indices; `rate`: frames per second
/// - `motions`: `label`, `colour`, `frames`, and
///   - `pelvis`: base64 of little-endian `f32`, frames × 3, metres
///   - `others`: base64 of little-endian `i16`, frames × 21 × 3: the other joints relative to the pelvis, in units of
///     `step` metres
/// - `components`: `name`, `unit`, `less` and `more` (the words for low and high values)
/// - `curves`: `label`, `colour`, `dashed`, `values`: base64 of little-endian `f32`, frames × 4
/// - `captions`: `text`, `from` and `until`: frames, the second one past the end
pub(super) fn page_data(
    figures: &[PageFigure<'_>],
    curves: &[LabanCurve<'_>],
    captions: &[TimedCaption],
) -> String {
    let motions = figures.iter().map(|figure| {
        let mut encoded = encode_motion(figure.motion);
        encoded["label"] = printable(figure.label).into();
        encoded["colour"] = json!(figure.colour);
        encoded
    });
    let components = Component::ALL.map(|component| {
        let mut words = Tag::ALL.into_iter().filter(|tag| tag.component() == component);
        let mut word = || words.next().map(|tag| tag.to_string());
        json!({ "name": component.to_string(), "unit": component.unit(), "less": word(), "more": word() })
    });
    let curves = curves.iter().map(|curve| {
        json!({
            "label": printable(curve.label),
            "colour": curve.colour,
            "dashed": curve.dashed,
            "values": base64_floats(curve.series.frames().as_flattened()),
        })
    });
    let captions = captions.iter().map(|caption| {
        let (from, until) = (caption.frames.start, caption.frames.end);
        json!({ "text": printable(&caption.text), "from": from, "until": until })
    });
    let data = json!({
        "rate": FRAMES_PER_SECOND,
        "joints": Joint::ALL.map(Joint::name),
        "motions": motions.collect::<Vec<Value>>(),
        "components": components,
        "curves": curves.collect::<Vec<Value>>(),
        "captions": captions.collect::<Vec<Value>>(),
    });
    escape_json(&data.to_string())
}

/// Encodes the joint positions of a motion.
fn encode_motion(motion: &Motion) -> Value {
    let pelvis = Joint::Pelvis.index();
    let from_pelvis = motion.joints().iter().flat_map(|pose| {
        let others = (0..JOINTS).filter(move |&joint| joint != pelvis);
        others.flat_map(move |joint| {
            (0..3).map(move |axis| f64::from(pose[joint][axis]) - f64::from(pose[pelvis][axis]))
        })
    });
    let farthest = from_pelvis
        .clone()
        .fold(0.0, |largest: f64, x| largest.max(x.abs()));
    // Positions farther away than 16-bit integers of this unit can hold are embedded less precisely.
    let step = STEP.max(farthest / f64::from(i16::MAX));
    let others = from_pelvis.flat_map(|x| ((x / step).round() as i16).to_le_bytes());
    let path: Vec<f32> = motion
        .joints()
        .iter()
        .flat_map(|pose| pose[pelvis])
        .collect();
    json!({
        "frames": motion.frames(),
        "step": step,
        "pelvis": base64_floats(&path),
        "others": base64(&others.collect::<Vec<u8>>()),
    })
}

/// Encodes little-endian floats as base64.
fn base64_floats(values: &[f32]) -> String {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    base64(&bytes)
}

/// Encodes bytes as base64 (RFC 4648, section 4).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let number = (0..3).fold(0, |n, i| {
            n << 8 | u32::from(group.get(i).copied().unwrap_or(0))
        });
        for place in 0..4 {
            match place <= group.len() {
                true => text.push(char::from(
                    LETTERS[(number >> (18 - 6 * place)) as usize & 63],
                )),
                false => text.push('='),
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Tensor;
    use lamogen_laban::LabanSeries;

    fn decode(value: &Value) -> Vec<u8> {
        let letters = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        let (mut bytes, mut bits, mut held) = (Vec::new(), 0u32, 0);
        for letter in value.as_str().unwrap().trim_end_matches('=').bytes() {
            bits = bits << 6 | letters.iter().position(|&l| l == letter).unwrap() as u32;
            held += 6;
            if held >= 8 {
                held -= 8;
                bytes.push((bits >> held) as u8);
            }
        }
        bytes
    }

    fn decode_floats(value: &Value) -> Vec<f32> {
        let bytes = decode(value);
        bytes
            .as_chunks()
            .0
            .iter()
            .map(|x| f32::from_le_bytes(*x))
            .collect()
    }

    /// Decodes the joints of an embedded motion like the script of the page.
    fn joints(encoded: &Value) -> Vec<[[f64; 3]; JOINTS]> {
        let step = encoded["step"].as_f64().unwrap();
        let pelvis = decode_floats(&encoded["pelvis"]);
        let others: Vec<i16> = decode(&encoded["others"])
            .as_chunks()
            .0
            .iter()
            .map(|x| i16::from_le_bytes(*x))
            .collect();
        let at = |frame: usize, joint: usize, axis: usize| {
            let root = f64::from(pelvis[3 * frame + axis]);
            match joint {
                0 => root,
                joint => {
                    root + f64::from(others[(frame * (JOINTS - 1) + joint - 1) * 3 + axis]) * step
                }
            }
        };
        let frames = encoded["frames"].as_u64().unwrap() as usize;
        (0..frames)
            .map(|t| std::array::from_fn(|j| std::array::from_fn(|axis| at(t, j, axis))))
            .collect()
    }

    /// Returns the largest error of an embedded coordinate in metres.
    fn largest_error(motion: &Motion, encoded: &Value) -> f64 {
        let decoded = joints(encoded);
        assert_eq!(decoded.len(), motion.frames());
        let pairs = decoded
            .iter()
            .flatten()
            .flatten()
            .zip(motion.joints().iter().flatten().flatten());
        pairs
            .map(|(a, b)| (a - f64::from(*b)).abs())
            .fold(0.0, f64::max)
    }

    fn walking_motion(reach: f32) -> Motion {
        let pose = |t: usize| {
            std::array::from_fn(|j| {
                let angle = (t * JOINTS + j) as f32;
                [
                    angle.sin() * reach + t as f32 * 0.3,
                    angle.cos().abs() * reach,
                    (1.7 * angle).cos() * reach,
                ]
            })
        };
        Motion::from_joints((0..50).map(pose).collect()).unwrap()
    }

    #[test]
    fn joints_are_decoded_to_a_twentieth_of_a_millimetre_wherever_they_are() {
        let motion = walking_motion(1.0);
        let error = largest_error(&motion, &encode_motion(&motion));
        assert!(error < 0.51e-4, "{error}");
    }

    #[test]
    fn bodies_of_huge_size_are_decoded_as_precisely_as_possible() {
        let motion = walking_motion(100.0);
        let error = largest_error(&motion, &encode_motion(&motion));
        assert!(error < 200.0 / 32767.0, "{error}");
        let huge = Motion::from_joints(vec![std::array::from_fn(|j| {
            [if j == 3 { f32::MAX } else { f32::MIN }; 3]
        })])
        .unwrap();
        assert!(encode_motion(&huge)["step"].as_f64().unwrap().is_finite());
    }

    #[test]
    fn curves_are_decoded_bit_for_bit_even_if_they_are_not_finite() {
        let rows = [[0.1, 1e-9, 3.0, f32::INFINITY], [0.2, -0.0, f32::MAX, 7.5]];
        let series = LabanSeries::from_tensor(Tensor::from(rows));
        let data: Value =
            serde_json::from_str(&page_data(&[], &[LabanCurve::target(&series)], &[])).unwrap();
        let curve = &data["curves"][0];
        assert_eq!(decode_floats(&curve["values"]), rows.as_flattened());
        assert_eq!(
            (curve["dashed"].as_bool(), &curve["label"]),
            (Some(true), &json!("target"))
        );
        assert_eq!(data["components"][1]["less"], "sustained");
        assert_eq!(data["components"][3]["more"], "far");
    }

    #[test]
    fn base64_is_that_of_the_standard() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }
}
