//! The forms of a data set on disk.

use std::path::Path;

use crate::error::DataError;
use crate::split::Split;
use crate::{humanml3d, packed};

/// How a data set lies in a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    /// `motions.safetensors` and `captions.jsonl`.
    Packed,
    /// `new_joint_vecs`, `texts` and lists of names.
    HumanMl3d,
}

impl Form {
    /// The form of a folder.
    ///
    /// # Errors
    ///
    /// If there is no such folder, or it has none of the forms; the error names what was looked for.
    pub fn of(folder: &Path) -> Result<Form, DataError> {
        Form::recognise(folder)?.ok_or_else(|| {
            let lists = Split::ALL.map(humanml3d::list);
            let parts = [
                packed::MOTIONS,
                packed::CAPTIONS,
                humanml3d::VECTORS,
                humanml3d::TEXTS,
            ];
            let there: Vec<&str> = { parts.into_iter().chain(lists) }
                .filter(|part| folder.join(part).exists())
                .collect();
            DataError::Form {
                folder: folder.to_owned(),
                found: match there.is_empty() {
                    true => "none of these".into(),
                    false => format!("only {}", there.join(", ")),
                },
            }
        })
    }

    /// The same, where a folder of another kind is no error.
    pub fn recognise(folder: &Path) -> Result<Option<Form>, DataError> {
        // A missing folder should be said so, not that files are missing in it.
        std::fs::read_dir(folder).map_err(DataError::read(folder))?;
        let there = |parts: &[&str]| parts.iter().all(|part| folder.join(part).exists());
        let listed = Split::ALL
            .iter()
            .any(|split| there(&[humanml3d::list(*split)]));
        if there(&[packed::MOTIONS, packed::CAPTIONS]) {
            return Ok(Some(Form::Packed));
        }
        let humanml3d = listed && there(&[humanml3d::VECTORS, humanml3d::TEXTS]);
        Ok(humanml3d.then_some(Form::HumanMl3d))
    }
}
