//! The errors of characters.

use std::io;
use std::path::PathBuf;

use lamogen_files::SkeletonError;

/// The reason why a character cannot be read, animated or written.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum CharacterError {
    /// The file cannot be read.
    #[error("{path}: {reason}")]
    Io { path: PathBuf, reason: io::Error },
    /// The file cannot be written.
    #[error("{path}: {reason}")]
    Write { path: PathBuf, reason: io::Error },
    /// The file is not glTF 2.0, or is damaged.
    #[error("{path}: {reason}")]
    Format { path: PathBuf, reason: String },
    /// The text of a BVH is damaged.
    #[error(transparent)]
    Bvh(#[from] lamogen_files::bvh::BvhError),
    /// The file has no mesh that a skeleton moves.
    #[error("{path}: expected a character, which is a mesh with a skin, found none")]
    Skin { path: PathBuf },
    /// The joints of the skeleton are not found.
    #[error("{path}: {reason}")]
    Skeleton {
        path: PathBuf,
        reason: SkeletonError,
    },
    /// The file has no node of the requested name.
    #[error("{path}: expected a character in a node named {asked:?}, found no such node")]
    Node { path: PathBuf, asked: String },
    /// The body is not one: parts of it are missing or have no length.
    #[error("{path}: {problem}")]
    Body { path: PathBuf, problem: String },
    /// A joint or one of its parents is mirrored, or is scaled differently along its axes.
    #[error(
        "{path}: expected joints that are scaled alike along all axes and not mirrored, found the scale {found:?} of {node:?}"
    )]
    Scale {
        path: PathBuf,
        node: String,
        found: [f64; 3],
    },
    /// The travel shall go into a node above the pelvis, and there is none.
    #[error(
        "{path}: expected a node above the pelvis {pelvis:?} for the root motion, found none; leave the travel in the hips, or nowhere"
    )]
    Root { path: PathBuf, pelvis: String },
    /// A BVH shall have more animations than one, or none.
    #[error("{path}: expected one animation, as a BVH has, found {found}")]
    Animations { path: PathBuf, found: usize },
    /// The file to write has another container than the character's.
    #[error("{path}: expected a name that ends in {expected}, as the character {character} does")]
    Container {
        path: PathBuf,
        expected: &'static str,
        character: PathBuf,
    },
    /// The character's file refers to others beside it.
    #[error(
        "{path}: expected the folder of {character}, which refers to files beside it, found another"
    )]
    SideFiles { path: PathBuf, character: PathBuf },
}
