//! The bind poses of the skins of glTF files.

use std::path::Path;

use gltf_json::Index;

use super::GlbError;
use super::container::GltfFile;
use super::reduction::{DocumentPart, bind_matrix_accessors};

/// Returns the inverse bind matrices of every skin of a `.glb` or `.gltf` file, which are 16 numbers each, column by column. A skin
/// without them has `None`.
///
/// `path` is used only in error messages. Buffers beside the file are read from `folder`.
///
/// # Errors
///
/// If the file is not glTF 2 or is damaged, or another file cannot be read.
pub fn inverse_bind_matrices(
    bytes: &[u8],
    path: &Path,
    folder: Option<&Path>,
) -> Result<Vec<Option<Vec<[f64; 16]>>>, GlbError> {
    let file = GltfFile::parse(bytes, path, folder, DocumentPart::BindMatrices)?;
    let accessors = bind_matrix_accessors(&file.document).into_iter();
    let matrices = accessors.map(|accessor| {
        let rows = accessor.map(|accessor| file.floats(Index::new(accessor as u32)));
        rows.transpose().map_err(|reason| GlbError::Format {
            path: path.to_owned(),
            reason,
        })
    });
    matrices.collect()
}
