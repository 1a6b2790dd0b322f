//! Reading of glTF files as clips.

mod clip;
mod nodes;
mod tracks;

use std::path::Path;

use super::GlbError;
use super::container::{FormatProblem, GltfFile};
use super::reduction::DocumentPart;
use crate::clip::Clip;
use crate::schemes::JointNodes;
use crate::vrma::{self, human_joints};
use clip::build_clip;

/// The most keyframes in all curves together, and the most values of a clip. A motion of half an hour needs this many.
const MAX_VALUES: u64 = 1 << 24;

/// An animation that was read from a glTF file.
pub(crate) struct GltfMotion {
    pub(crate) clip: Clip,
    /// The nodes of the joints in the clip, if the file is a VRM animation, or what is wrong with its bones.
    pub(crate) human_joints: Option<Result<JointNodes, FormatProblem>>,
    /// The names of the animations that were not read.
    pub(crate) other_animations: Vec<String>,
    pub(crate) copyright: Option<String>,
}

/// Reads an animation from the bytes of a `.glb` or `.gltf` file: the one of the given name, or the first one.
///
/// All nodes are read; those without a name are called, for example, `node 7`. The clip starts at the first keyframe. Its
/// frames are the keyframes if these lie on a regular grid, and otherwise 120 frames per second; if a curve is not linear,
/// there are at least 60 frames per second. The `rest` of each node is rotated and scaled by the rest pose of its parents,
/// so that the sum from the node to the root is the position of the node.
///
/// # Errors
///
/// If another file cannot be read, or the file is not glTF 2, is damaged or has no animation, or needs a feature that is not supported:
/// compressed keyframes, buffers from a network, child nodes of a node that changes its size.
pub(crate) fn read(
    bytes: &[u8],
    path: &Path,
    folder: Option<&Path>,
    animation: Option<&str>,
) -> Result<GltfMotion, GlbError> {
    let file = GltfFile::parse(bytes, path, folder, DocumentPart::Animation(animation))?;
    let format_error = |reason| GlbError::Format {
        path: path.to_owned(),
        reason,
    };
    let animations = &file.root.animations;
    let chosen = match animation {
        None => animations
            .first()
            .ok_or_else(|| format_error("expected an animation, found none".into()))?,
        Some(name) => animations
            .iter()
            .find(|animation| animation.name.as_deref() == Some(name))
            .ok_or_else(|| GlbError::Animation {
                path: path.to_owned(),
                asked: name.to_owned(),
                found: animations.iter().filter_map(|a| a.name.clone()).collect(),
            })?,
    };
    let other_animations = animations
        .iter()
        .filter(|animation| !std::ptr::eq(*animation, chosen))
        .map(|animation| animation.name.clone().unwrap_or("without a name".into()))
        .collect();
    let (clip, clip_index) = build_clip(&file, chosen).map_err(format_error)?;
    let extension = file.document["extensions"].get(vrma::EXTENSION);
    let human_joints = extension.map(|extension| {
        let joints = human_joints(extension, clip_index.len())?;
        Ok(joints.map(|node| node.map(|node| clip_index[node])))
    });
    Ok(GltfMotion {
        clip,
        human_joints,
        other_animations,
        copyright: file.root.asset.copyright,
    })
}

#[cfg(test)]
mod tests;
