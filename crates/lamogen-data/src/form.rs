//! The forms that a data set can have on disk.

use std::path::Path;

use crate::error::DataError;
use crate::split::Split;
use crate::{humanml3d, packed};

/// The form of a data set's folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FolderFormat {
    /// `motions.safetensors` and `captions.jsonl`.
    Packed,
    /// `new_joint_vecs`, `texts` and the lists of names of the splits.
    HumanMl3d,
}

impl FolderFormat {
    /// Returns the form of a folder.
    ///
    /// # Errors
    ///
    /// If there is no such folder, or it has none of the forms; the error names the files that were looked for.
    pub fn of(folder: &Path) -> Result<FolderFormat, DataError> {
        FolderFormat::recognise(folder)?.ok_or_else(|| {
            let lists = Split::ALL.map(humanml3d::list_file);
            let parts = [
                packed::MOTIONS,
                packed::CAPTIONS,
                humanml3d::VECTORS,
                humanml3d::TEXTS,
            ];
            let present: Vec<&str> = { parts.into_iter().chain(lists) }
                .filter(|part| folder.join(part).exists())
                .collect();
            DataError::Form {
                folder: folder.to_owned(),
                found: match present.is_empty() {
                    true => "none of these".into(),
                    false => format!("only {}", present.join(", ")),
                },
            }
        })
    }

    /// Returns the form of a folder, or `None` if the folder exists but has none of the forms.
    ///
    /// # Errors
    ///
    /// If the folder cannot be read.
    pub fn recognise(folder: &Path) -> Result<Option<FolderFormat>, DataError> {
        // If the folder itself is missing, the error should say so, not that files are missing in it.
        std::fs::read_dir(folder).map_err(DataError::read(folder))?;
        let has_all = |parts: &[&str]| parts.iter().all(|part| folder.join(part).exists());
        let has_list = Split::ALL
            .iter()
            .any(|split| has_all(&[humanml3d::list_file(*split)]));
        if has_all(&[packed::MOTIONS, packed::CAPTIONS]) {
            return Ok(Some(FolderFormat::Packed));
        }
        let is_humanml3d = has_list && has_all(&[humanml3d::VECTORS, humanml3d::TEXTS]);
        Ok(is_humanml3d.then_some(FolderFormat::HumanMl3d))
    }
}
