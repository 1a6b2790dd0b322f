//! Mapping files, which give the names of the joints in a file of an unknown skeleton.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use lamogen_motion::{JOINTS, Joint};

use crate::clip::Clip;
use crate::names::{joint_names, missing_joints, node_names};
use crate::schemes::JointNodes;
use crate::similar_names::similar_names;

/// The names of the joints in a file.
///
/// A mapping file is a JSON object from lamogen's joint names ([`Joint::name`]) to the names in the file:
/// `{"pelvis": "Root", "left_hip": "Thigh_L", …}`. Joints that are left out are placed by the rules of
/// [`ImportedMotion::placed`](crate::ImportedMotion::placed).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JointMapping {
    names: BTreeMap<&'static str, (Joint, String)>,
}

/// The reason why a mapping cannot be read or does not fit a file.
#[derive(Debug, thiserror::Error)]
pub enum MappingError {
    /// The mapping file cannot be opened or read.
    #[error("{path}: {reason}")]
    #[allow(missing_docs)]
    Io { path: PathBuf, reason: io::Error },
    /// The mapping file is not a JSON object of names.
    #[error("{path}: expected a JSON object such as {{\"pelvis\": \"Root\", …}}: {reason}")]
    #[allow(missing_docs)]
    Json {
        path: PathBuf,
        reason: serde_json::Error,
    },
    /// A key is not the name of one of lamogen's joints.
    #[error("{path}: expected one of lamogen's joints ({known}), found {found:?}{near}", known = joint_names(&Joint::ALL))]
    #[allow(missing_docs)]
    Joint {
        path: PathBuf,
        found: String,
        near: String,
    },
    /// The mapping lacks joints that no rule can place.
    #[error(
        "the mapping leaves out {missing}; only the spine, collars, feet, and either head or neck may be left out"
    )]
    #[allow(missing_docs)]
    Incomplete { missing: String },
    /// Two joints are mapped to the same name.
    #[error("{first} and {second} are both mapped to {found:?}; expected a node for each", first = .first.name(), second = .second.name())]
    #[allow(missing_docs)]
    Twice {
        first: Joint,
        second: Joint,
        found: String,
    },
    /// The motion's file has no node of the name that a joint is mapped to.
    #[error("{joint} is mapped to {found:?}, which the file lacks{near}; it has {known}", joint = .joint.name())]
    #[allow(missing_docs)]
    Node {
        joint: Joint,
        found: String,
        near: String,
        known: String,
    },
}

impl JointMapping {
    /// Reads a mapping file.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, is not a JSON object of strings, or has a key that is not a joint.
    pub fn read(path: impl AsRef<Path>) -> Result<JointMapping, MappingError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|reason| MappingError::Io {
            path: path.to_owned(),
            reason,
        })?;
        JointMapping::parse(&text, path)
    }

    /// Parses a mapping from JSON text. `path` is used only in error messages.
    ///
    /// # Errors
    ///
    /// The same as for [`read`](Self::read), except that no file is read.
    pub fn parse(json: &str, path: &Path) -> Result<JointMapping, MappingError> {
        let entries: BTreeMap<String, String> =
            serde_json::from_str(json).map_err(|reason| MappingError::Json {
                path: path.to_owned(),
                reason,
            })?;
        let mut mapping = JointMapping::default();
        for (found, name) in entries {
            let joint = Joint::from_name(&found).ok_or_else(|| MappingError::Joint {
                path: path.to_owned(),
                near: suggestion(&similar_names(
                    &found,
                    Joint::ALL.iter().map(|joint| joint.name()),
                )),
                found: found.clone(),
            })?;
            mapping = mapping.with(joint, name);
        }
        Ok(mapping)
    }

    /// Returns the mapping with one more joint, or with a new name for a joint that it already has.
    #[must_use]
    pub fn with(mut self, joint: Joint, name: impl Into<String>) -> JointMapping {
        self.names.insert(joint.name(), (joint, name.into()));
        self
    }

    /// Finds the nodes of a clip that the joints are mapped to.
    pub(crate) fn nodes(&self, clip: &Clip) -> Result<JointNodes, MappingError> {
        let mut nodes: JointNodes = [None; JOINTS];
        for (joint, name) in self.names.values() {
            let earlier = self.names.values().take_while(|(other, _)| other != joint);
            if let Some((first, _)) = { earlier }.find(|(_, other)| other == name) {
                return Err(MappingError::Twice {
                    first: *first,
                    second: *joint,
                    found: name.clone(),
                });
            }
            let node = clip.nodes.iter().position(|node| node.name == *name);
            nodes[joint.index()] = Some(node.ok_or_else(|| MappingError::Node {
                joint: *joint,
                found: name.clone(),
                near: suggestion(&similar_names(
                    name,
                    clip.nodes.iter().map(|node| &*node.name),
                )),
                known: node_names(clip),
            })?);
        }
        match missing_joints(&nodes).as_slice() {
            [] => Ok(nodes),
            missing => Err(MappingError::Incomplete {
                missing: joint_names(missing),
            }),
        }
    }
}

/// Formats similar names as the end of an error message.
fn suggestion(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        names => format!(" (meant was perhaps {})", names.join(" or ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::Node;
    use glam::{DQuat, DVec3};

    fn clip(names: &[&str]) -> Clip {
        Clip {
            nodes: names
                .iter()
                .map(|name| Node {
                    name: (*name).into(),
                    parent: None,
                    rest: DVec3::ZERO,
                    translations: vec![DVec3::ZERO],
                    rotations: vec![DQuat::IDENTITY],
                    scales: vec![DVec3::ONE],
                })
                .collect(),
            frames: 1,
            seconds_per_frame: 0.0,
        }
    }

    fn parse(json: &str) -> Result<JointMapping, String> {
        JointMapping::parse(json, Path::new("map.json")).map_err(|error| error.to_string())
    }

    #[test]
    fn errors_name_the_mistake_and_similar_names() {
        let message = parse(r#"{"left_hipp": "Thigh_L"}"#).unwrap_err();
        assert!(
            message.contains("map.json") && message.contains("perhaps left_hip"),
            "{message}"
        );
        for json in ["", "[]", r#"{"pelvis": 3}"#, "{"] {
            let message = parse(json).unwrap_err();
            assert!(
                message.contains("JSON object") && message.contains("line"),
                "{message}"
            );
        }
        let mapping = parse(r#"{"pelvis": "root", "left_hip": "Thigh.L"}"#).unwrap();
        let message = mapping
            .nodes(&clip(&["Root", "Thigh.L"]))
            .unwrap_err()
            .to_string();
        for part in ["pelvis", "\"root\"", "perhaps Root", "Thigh.L"] {
            assert!(message.contains(part), "{part}: {message}");
        }
        let message = mapping
            .nodes(&clip(&["root", "Thigh.L"]))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("right_hip") && !message.contains("pelvis"),
            "{message}"
        );
    }
}
