//! Reads NumPy's `.npy` files as `f32` and writes them whole or not at all.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};

use half::f16;
use npyz::{Deserialize, NpyFile, Order, WriterBuilder};

use lamogen_io::{placeholder, write_atomically};

/// Why a `.npy` file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file cannot be opened, read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// The file is not in the `.npy` format, or is cut short.
    #[error("{path}: not a readable .npy file: {reason}")]
    #[allow(missing_docs)]
    Format { path: PathBuf, reason: io::Error },
    /// The array has an element type that lamogen does not read.
    #[error("{path}: expected floats of 16, 32 or 64 bits, found {found}")]
    #[allow(missing_docs)]
    Type { path: PathBuf, found: String },
    /// The array holds Python objects, which only Python can read.
    #[error(
        "{path}: expected an array of numbers, found Python objects, which are never executed here; in Python: \
         a = numpy.load(\"{path}\", allow_pickle=True) of a file that you trust, then numpy.save(\"motion.npy\", \
         a.item()[\"motion\"]), or whatever key the array has"
    )]
    #[allow(missing_docs)]
    Objects { path: PathBuf },
    /// Something else is in the place of the file, such as a Git LFS pointer or a web page.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Placeholder {
        path: PathBuf,
        problem: &'static str,
    },
}

/// An array that was read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// The numbers in C order: the index of the last axis changes fastest.
    pub values: Vec<f32>,
    /// The length of each axis.
    pub shape: Vec<usize>,
    /// Whether the file holds integers.
    pub is_integer: bool,
}

/// Reads an array of floats of 16, 32 or 64 bits, or of integers, in C or Fortran order.
///
/// # Errors
///
/// If the file is missing, not `.npy`, cut short, or holds another type.
pub fn read(path: impl AsRef<Path>) -> Result<Array, NpyError> {
    let path = path.as_ref();
    let file = File::open(path).map_err(|reason| io_error(path, reason))?;
    read_from(BufReader::new(file), path)
}

/// Reads an array from bytes that are in memory; `name` stands in error messages.
///
/// # Errors
///
/// As [`read`].
pub fn read_bytes(bytes: &[u8], name: impl AsRef<Path>) -> Result<Array, NpyError> {
    read_from(bytes, name.as_ref())
}

/// Reads an array; `path` stands in error messages.
fn read_from(mut reader: impl BufRead, path: &Path) -> Result<Array, NpyError> {
    let malformed = |reason| NpyError::Format {
        path: path.to_owned(),
        reason,
    };
    let start = reader.fill_buf().map_err(|reason| io_error(path, reason))?;
    if let Some(problem) = placeholder(start) {
        return Err(NpyError::Placeholder {
            path: path.to_owned(),
            problem,
        });
    }
    let header = read_header(&mut reader).map_err(malformed)?;
    let npy = NpyFile::new(header.chain(reader)).map_err(malformed)?;
    let shape: Vec<usize> = npy.shape().iter().map(|&n| n as usize).collect();
    let order = npy.order();
    let (values, is_integer) = read_numbers(npy).map_err(|found| match found {
        NumbersError::Objects => NpyError::Objects {
            path: path.to_owned(),
        },
        NumbersError::Type(found) => NpyError::Type {
            path: path.to_owned(),
            found,
        },
        NumbersError::Io(reason) => malformed(reason),
    })?;
    let count = shape
        .iter()
        .try_fold(1usize, |n, &axis| n.checked_mul(axis));
    if count != Some(values.len()) {
        return Err(malformed(io::Error::new(
            io::ErrorKind::InvalidData,
            format!("the shape {shape:?} is too large"),
        )));
    }
    let values = match order {
        Order::C => values,
        Order::Fortran => to_c_order(&values, &shape),
    };
    Ok(Array {
        values,
        shape,
        is_integer,
    })
}

/// The length of the longest header that is read, in bytes. NumPy writes some 100 bytes.
const MAX_HEADER_LENGTH: usize = 1 << 16;

/// The deepest nesting of brackets in a header: a dictionary, a list of fields, a field, and its shape. The time that a header
/// takes to parse doubles with every level.
const MAX_HEADER_NESTING: usize = 4;

/// Reads the bytes before the numbers of an array, and checks that they can be parsed in a short time.
fn read_header(reader: &mut impl Read) -> io::Result<io::Cursor<Vec<u8>>> {
    let invalid = |problem: String| io::Error::new(io::ErrorKind::InvalidData, problem);
    // NumPy's format: a magic string of six bytes, two bytes of version, the length in two or four bytes, the header.
    let mut bytes = vec![0; 8];
    reader.read_exact(&mut bytes)?;
    let length_bytes = if bytes[6] == 1 { 2 } else { 4 };
    let mut length = [0; 4];
    reader.read_exact(&mut length[..length_bytes])?;
    bytes.extend(&length[..length_bytes]);
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_HEADER_LENGTH {
        return Err(invalid(format!(
            "expected a header of at most {MAX_HEADER_LENGTH} bytes, found one of {length}"
        )));
    }
    let start = bytes.len();
    bytes.resize(start + length, 0);
    reader.read_exact(&mut bytes[start..])?;
    let mut depth = 0usize;
    for byte in &bytes[start..] {
        match byte {
            b'{' | b'[' | b'(' => depth += 1,
            b'}' | b']' | b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > MAX_HEADER_NESTING {
            return Err(invalid(format!(
                "expected a header of at most {MAX_HEADER_NESTING} nested brackets, found more"
            )));
        }
    }
    if !has_countable_shape(&bytes[start..]) {
        return Err(invalid(
            "expected a shape whose elements can be counted, found a larger one".into(),
        ));
    }
    Ok(io::Cursor::new(bytes))
}

/// Returns whether the product of all numbers in brackets of a header, which include those of its shape, can be computed.
fn has_countable_shape(header: &[u8]) -> bool {
    let brackets = header.split(|byte| *byte == b'(').skip(1);
    let insides = brackets.filter_map(|part| part.split(|byte| *byte == b')').next());
    let numbers = insides.flat_map(|inside| inside.split(|byte| !byte.is_ascii_digit()));
    let mut numbers = numbers.filter(|digits| !digits.is_empty());
    let product = numbers.try_fold(1u64, |product, digits| {
        let number: u64 = std::str::from_utf8(digits).ok()?.parse().ok()?;
        product.checked_mul(number.max(1))
    });
    product.is_some()
}

/// Why the numbers of an array cannot be read.
enum NumbersError {
    /// They are Python objects.
    Objects,
    /// They have the given type, which is not supported.
    Type(String),
    /// The file is cut short or cannot be read.
    Io(io::Error),
}

/// Reads the numbers of a file in the order in which they are stored, and returns whether they are integers.
fn read_numbers<R: io::Read>(npy: NpyFile<R>) -> Result<(Vec<f32>, bool), NumbersError> {
    /// Reads the numbers as type `T`, or returns the file if they have another type.
    fn try_type<R: io::Read, T: Deserialize>(
        npy: NpyFile<R>,
        convert: impl Fn(T) -> f32,
    ) -> Result<io::Result<Vec<f32>>, NpyFile<R>> {
        let data = npy.try_data::<T>()?;
        Ok(data.map(|value| value.map(&convert)).collect())
    }
    macro_rules! try_types {
        ($npy:expr, $($type:ty => $convert:expr, $is_integer:expr;)*) => {{
            let npy = $npy;
            $(
                let npy = match try_type::<R, $type>(npy, $convert) {
                    Ok(values) => return values.map(|values| (values, $is_integer)).map_err(NumbersError::Io),
                    Err(npy) => npy,
                };
            )*
            npy
        }};
    }
    let npy = try_types!(npy,
        f32 => |value| value, false;
        f64 => |value| value as f32, false;
        f16 => f16::to_f32, false;
        i8 => f32::from, true;
        u8 => f32::from, true;
        i16 => f32::from, true;
        u16 => f32::from, true;
        i32 => |value| value as f32, true;
        u32 => |value| value as f32, true;
        i64 => |value| value as f32, true;
        u64 => |value| value as f32, true;
    );
    let found = npy.dtype().descr();
    Err(match found.contains('O') {
        true => NumbersError::Objects,
        false => NumbersError::Type(found),
    })
}

/// Reorders numbers from Fortran order (first axis fastest) to C order (last axis fastest).
fn to_c_order(values: &[f32], shape: &[usize]) -> Vec<f32> {
    let mut steps = vec![1; shape.len()];
    for axis in 1..shape.len() {
        steps[axis] = steps[axis - 1] * shape[axis - 1];
    }
    let mut position = vec![0; shape.len()];
    let mut ordered = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        let index: usize = position
            .iter()
            .zip(&steps)
            .map(|(at, step)| at * step)
            .sum();
        ordered.push(values[index]);
        for axis in (0..shape.len()).rev() {
            position[axis] += 1;
            if position[axis] < shape[axis] {
                break;
            }
            position[axis] = 0;
        }
    }
    ordered
}

/// Writes an array with the content of [`bytes()`]. The file is written under a temporary name and then renamed, so that no
/// reader sees half of it.
///
/// # Errors
///
/// If the folder is missing or not writable.
///
/// # Panics
///
/// If `values` does not fill `shape`.
pub fn write(path: impl AsRef<Path>, values: &[f32], shape: &[usize]) -> Result<(), NpyError> {
    write_bytes(path.as_ref(), &bytes(values, shape))
}

/// Returns the bytes of a `.npy` file with an array in C order.
///
/// # Panics
///
/// If `values` does not fill `shape`.
pub fn bytes(values: &[f32], shape: &[usize]) -> Vec<u8> {
    assert_eq!(
        values.len(),
        shape.iter().product::<usize>(),
        "the values must fill the shape {shape:?}"
    );
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut bytes = Vec::new();
    let written = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&shape)
        .writer(&mut bytes)
        .begin_nd()
        .and_then(|mut writer| {
            writer.extend(values)?;
            writer.finish()
        });
    written.expect("a vector takes all bytes");
    bytes
}

/// Writes the bytes of a `.npy` file.
pub(crate) fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), NpyError> {
    write_atomically(path, |file| file.write_all(bytes)).map_err(|reason| io_error(path, reason))
}

fn io_error(path: &Path, reason: io::Error) -> NpyError {
    NpyError::Io {
        path: path.to_owned(),
        reason,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("array.npy");
        write(&path, &[1.0, -2.5, 3.0, 4.0, 5.0, 6.0], &[3, 2]).unwrap();
        let array = read(&path).unwrap();
        assert_eq!(array.shape, [3, 2]);
        assert_eq!(array.values, [1.0, -2.5, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn headers_that_would_take_long_are_refused() {
        for (header, expected) in [
            (format!("{{'descr': {}", "{".repeat(60)), "nested brackets"),
            (
                "{'descr': '<i2', 'fortran_order': False, 'shape': (2, 9347760592976813170, 3)}"
                    .into(),
                "can be counted",
            ),
            (" ".repeat(70_000), "65536 bytes"),
        ] {
            let mut file = b"\x93NUMPY\x02\x00".to_vec();
            file.extend((header.len() as u32).to_le_bytes());
            file.extend(header.as_bytes());
            let message = read_bytes(&file, "a.npy").unwrap_err().to_string();
            assert!(
                message.contains("a.npy") && message.contains(expected),
                "{message}"
            );
        }
    }

    #[test]
    fn every_kind_of_number_is_read() {
        let doubles = read_bytes(&bytes(&[1.5f64, -2.0]), "doubles").unwrap();
        assert_eq!(
            (&doubles.values[..], doubles.is_integer),
            (&[1.5, -2.0][..], false)
        );
        let halves = [1.5, -2.0].map(f16::from_f64);
        assert_eq!(read_bytes(&bytes(&halves), "halves").unwrap(), doubles);
        for integers in [
            bytes(&[1i32, -2]),
            bytes(&[1i64, -2]),
            bytes(&[1i8, -2]),
            bytes(&[1i16, -2]),
        ] {
            let array = read_bytes(&integers, "integers").unwrap();
            assert_eq!(
                (&array.values[..], array.is_integer),
                (&[1.0, -2.0][..], true)
            );
        }
        let error = read_bytes(&bytes(&[true, false]), "flags.npy").unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("flags.npy") && message.contains("b1"),
            "{message}"
        );
    }

    /// Returns the bytes of a file with the given header entries and data.
    fn with_header(descr: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header =
            format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': ({shape}), }}\n");
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend((header.len() as u16).to_le_bytes());
        file.extend(header.as_bytes());
        file.extend(data);
        file
    }

    #[test]
    fn the_first_axis_may_be_the_fastest() {
        // The shape is [2, 3, 2], and the number at [i, j, k] is 100 i + 10 j + k.
        let mut data = Vec::new();
        for k in 0..2 {
            for j in 0..3 {
                for i in 0..2 {
                    data.extend((100.0 * i as f32 + 10.0 * j as f32 + k as f32).to_le_bytes());
                }
            }
        }
        let array = read_bytes(&with_header("'<f4'", "True", "2, 3, 2", &data), "f").unwrap();
        assert_eq!(array.shape, [2, 3, 2]);
        let expected = [
            0.0, 1.0, 10.0, 11.0, 20.0, 21.0, 100.0, 101.0, 110.0, 111.0, 120.0, 121.0,
        ];
        assert_eq!(array.values, expected);
    }

    #[test]
    fn what_is_no_array_is_called_by_its_name() {
        let objects = read_bytes(
            &with_header("'|O'", "False", "", b"\x80\x04."),
            "results.npy",
        );
        let message = objects.unwrap_err().to_string();
        assert!(
            message.contains("Python objects") && message.contains("allow_pickle=True"),
            "{message}"
        );
        let page = read_bytes(b"<!DOCTYPE html><html>", "mean.npy");
        let message = page.unwrap_err().to_string();
        assert!(
            message.contains("mean.npy: expected the file itself, found a web page"),
            "{message}"
        );
    }

    #[test]
    fn a_missing_a_foreign_and_a_truncated_file_are_named() {
        let error = read("no/such/mean.npy").unwrap_err();
        assert!(matches!(error, NpyError::Io { .. }));
        assert!(error.to_string().contains("no/such/mean.npy"));

        for damaged in [
            &b"PK\x03\x04 not an array"[..],
            &bytes(&[1.0f64; 8])[..100],
            b"",
        ] {
            let error = read_bytes(damaged, "mean.npy").unwrap_err();
            assert!(matches!(error, NpyError::Format { .. }), "{error}");
            assert!(error.to_string().contains("mean.npy"));
        }
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error() {
        let error = write("no/such/folder/out.npy", &[0.0], &[1]).unwrap_err();
        assert!(error.to_string().contains("no/such/folder/out.npy"));
    }

    #[test]
    fn damaged_files_never_panic() {
        let whole = bytes(&[1.0f32; 40]);
        for place in 0..whole.len() {
            for value in [0, 1, b'9', b'-', b'(', 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[place] = value;
                let _ = read_bytes(&damaged, "damaged.npy");
            }
            let _ = read_bytes(&whole[..place], "cut.npy").unwrap_err();
        }
        for shape in [
            "99999999999999,",
            "4,4294967296,4294967296,4294967296,",
            "-1,",
            "1e9,",
            "",
        ] {
            let header =
                format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}");
            let mut file = b"\x93NUMPY\x01\x00".to_vec();
            file.extend((header.len() as u16).to_le_bytes());
            file.extend(header.as_bytes());
            file.extend([0; 3]);
            let error = read_bytes(&file, "shape.npy").unwrap_err().to_string();
            assert!(error.contains("shape.npy"), "{error}");
        }
    }

    fn bytes<T: npyz::AutoSerialize + Copy>(values: &[T]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&[values.len() as u64])
            .writer(&mut bytes)
            .begin_nd()
            .unwrap();
        writer.extend(values).unwrap();
        writer.finish().unwrap();
        bytes
    }
}
