//! NumPy's `.npy` files: read as `f32`, written whole or not at all.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use npyz::{NpyFile, Order, WriterBuilder};

use crate::atomic::write_atomically;

/// What can go wrong with a `.npy` file.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file cannot be opened, read or written.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// The file is not `.npy`, or is cut short.
    #[error("{path}: not a readable .npy file: {reason}")]
    #[allow(missing_docs)]
    Format { path: PathBuf, reason: io::Error },
    /// The numbers are of a type that lamogen does not read.
    #[error("{path}: expected 32- or 64-bit floats in C order, found {found}")]
    #[allow(missing_docs)]
    Type { path: PathBuf, found: String },
}

/// An array read from a file: its numbers in C order and its shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// The numbers, last axis fastest.
    pub values: Vec<f32>,
    /// Length of each axis.
    pub shape: Vec<usize>,
}

/// Reads an array of 32- or 64-bit floats.
///
/// # Errors
///
/// If the file is missing, not `.npy`, cut short, or holds another type or Fortran order.
pub fn read(path: impl AsRef<Path>) -> Result<Array, NpyError> {
    let path = path.as_ref();
    let file = File::open(path).map_err(|reason| io_error(path, reason))?;
    read_from(BufReader::new(file), path)
}

/// Reads an array from bytes that are already in memory; `name` stands in error messages.
///
/// # Errors
///
/// As [`read`].
pub fn read_bytes(bytes: &[u8], name: impl AsRef<Path>) -> Result<Array, NpyError> {
    read_from(bytes, name.as_ref())
}

fn read_from(reader: impl io::Read, path: &Path) -> Result<Array, NpyError> {
    let malformed = |reason| NpyError::Format {
        path: path.to_owned(),
        reason,
    };
    let npy = NpyFile::new(reader).map_err(malformed)?;
    let shape: Vec<usize> = npy.shape().iter().map(|&n| n as usize).collect();
    let several_axes = shape.iter().filter(|&&n| n > 1).count() > 1;
    if npy.order() == Order::Fortran && several_axes {
        return Err(NpyError::Type {
            path: path.to_owned(),
            found: "Fortran order".into(),
        });
    }
    let values: io::Result<Vec<f32>> = match npy.try_data::<f32>() {
        Ok(data) => data.collect(),
        Err(npy) => match npy.try_data::<f64>() {
            Ok(data) => data.map(|value| Ok(value? as f32)).collect(),
            Err(npy) => {
                return Err(NpyError::Type {
                    path: path.to_owned(),
                    found: npy.dtype().descr(),
                });
            }
        },
    };
    let values = values.map_err(malformed)?;
    let count = shape
        .iter()
        .try_fold(1usize, |n, &axis| n.checked_mul(axis));
    match count == Some(values.len()) {
        true => Ok(Array { values, shape }),
        false => Err(malformed(io::Error::new(
            io::ErrorKind::InvalidData,
            format!("the shape {shape:?} is too large"),
        ))),
    }
}

/// Writes an array in C order under a temporary name, then renames it: a reader never sees half.
///
/// # Errors
///
/// If the folder is missing or not writable.
///
/// # Panics
///
/// If `values` does not fill `shape`.
pub fn write(path: impl AsRef<Path>, values: &[f32], shape: &[usize]) -> Result<(), NpyError> {
    assert_eq!(
        values.len(),
        shape.iter().product::<usize>(),
        "the values must fill the shape {shape:?}"
    );
    let path = path.as_ref();
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    write_atomically(path, |file| {
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&shape)
            .writer(file)
            .begin_nd()?;
        writer.extend(values)?;
        writer.finish()
    })
    .map_err(|reason| io_error(path, reason))
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
    fn sixty_four_bit_floats_are_read_and_integers_refused() {
        let array = read_bytes(&bytes(&[1.5f64, -2.0]), "doubles").unwrap();
        assert_eq!(array.values, [1.5, -2.0]);

        let error = read_bytes(&bytes(&[1i32, 2]), "numbers.npy").unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("numbers.npy") && message.contains("i4"),
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
