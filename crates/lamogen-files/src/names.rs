//! Recognition of the joints of a file by the names of its nodes.

use std::cmp::Reverse;
use std::collections::HashMap;

use lamogen_motion::{JOINTS, Joint};

use crate::clip::{Clip, END_SITE};
use crate::schemes::{JointNodes, NamingScheme, REQUIRED, SCHEMES, key};

/// The error of a skeleton that follows no known naming scheme.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected a skeleton of a known scheme ({known}), found joints called {found}{closest}. For another \
     skeleton write a mapping file, such as {{\"pelvis\": \"Root\", \"left_hip\": \"Thigh_L\", …}}: each of \
     lamogen's joints with its name in the file; needed are {needed}, and head or neck",
    known = SCHEMES.iter().map(|scheme| scheme.name).collect::<Vec<_>>().join("; "),
    needed = joint_names(&REQUIRED),
)]
pub struct UnknownSkeleton {
    /// The names of the file's joints.
    pub found: String,
    /// The scheme that fits best, and the joints that the file lacks for it.
    pub closest: String,
}

/// The nodes of a file, by the [`key`] of their names.
struct NodeIndex<'a> {
    clip: &'a Clip,
    /// How many nodes move at or below each node.
    moving: Vec<usize>,
    nodes: HashMap<String, Vec<usize>>,
}

/// The nodes of a file that have the names of a scheme.
struct SchemeMatch {
    scheme: &'static NamingScheme,
    nodes: JointNodes,
    /// Joints of limbs that have nodes elsewhere than below the joints before them.
    misplaced: Vec<Joint>,
    /// The number of joints that have a node.
    count: usize,
    /// The number of nodes that move at or below the pelvis.
    moving: usize,
}

impl SchemeMatch {
    /// Returns what orders matches, the best last.
    fn rank(&self) -> (usize, usize) {
        (self.count, self.moving)
    }
}

/// What the error says of joints that are there, but not where they belong.
const MISPLACED: &str =
    "elsewhere than below the joint before, as bones are that follow targets of inverse kinematics";

/// The most prefixes that are tried for a scheme. Every node whose name ends like a pelvis gives a prefix.
const MAX_PREFIXES: usize = 32;

/// Recognises the naming scheme of a skeleton and returns its name and the nodes of the joints.
///
/// Of the schemes for which the file has all required joints, the one with the most joints is chosen; of several characters with as many joints, the one
/// that the animation moves most. If there is none and most names end with a number, as those of Sketchfab's files do, the names without
/// these numbers are looked at.
pub(crate) fn recognise(clip: &Clip) -> Result<(&'static str, JointNodes), UnknownSkeleton> {
    let found = recognise_names(clip, &|name| name);
    match found {
        Err(_) if has_numbered_names(clip) => {
            recognise_names(clip, &|name| without_number(name).unwrap_or(name)).or(found)
        }
        found => found,
    }
}

/// Returns a name without the number at its end: `LeftLeg_57` becomes `LeftLeg`; `None` if there is no number.
fn without_number(name: &str) -> Option<&str> {
    let (name, number) = name.rsplit_once('_')?;
    let is_number = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then_some(name)
}

/// Whether most nodes have names that end with a number.
fn has_numbered_names(clip: &Clip) -> bool {
    let names = clip.nodes.iter().map(|node| &*node.name);
    let numbered = names.filter(|name| without_number(name).is_some());
    2 * numbered.count() > clip.nodes.len()
}

/// Recognises the naming scheme by the names of the nodes, of which `shorten` returns the part that counts.
fn recognise_names(
    clip: &Clip,
    shorten: &dyn Fn(&str) -> &str,
) -> Result<(&'static str, JointNodes), UnknownSkeleton> {
    let index = NodeIndex::new(clip, shorten);
    let mut best: Option<SchemeMatch> = None;
    let mut closest: Option<SchemeMatch> = None;
    for scheme in SCHEMES {
        for prefix in index.prefixes(scheme) {
            let found = index.find(scheme, &prefix);
            let slot = match missing_joints(&found.nodes).is_empty() {
                true => &mut best,
                false => &mut closest,
            };
            if slot.as_ref().is_none_or(|best| found.rank() > best.rank()) {
                *slot = Some(found);
            }
        }
    }
    match best {
        Some(found) => Ok((found.scheme.name, found.nodes)),
        None => Err(UnknownSkeleton {
            found: node_names(clip),
            closest: closest
                .filter(|found| found.count >= REQUIRED.len() / 2)
                .map(|found| {
                    let missing = missing_joints(&found.nodes);
                    let keys = |joints: &[Joint]| {
                        let key = |joint: &Joint| found.scheme.keys(*joint).into_iter().next();
                        joints.iter().filter_map(key).collect::<Vec<_>>().join(", ")
                    };
                    let mut misplaced = found.misplaced;
                    misplaced.retain(|joint| missing.contains(joint));
                    let reason = match &misplaced[..] {
                        [] => String::new(),
                        joints => format!(", of which the file has {} {MISPLACED}", keys(joints)),
                    };
                    let name = found.scheme.name;
                    format!("; {name} comes closest, but for {}{reason}", keys(&missing))
                })
                .unwrap_or_default(),
        }),
    }
}

/// Returns the required joints that have no node. The head is one of them if neither the head nor the neck has a node.
pub(crate) fn missing_joints(nodes: &JointNodes) -> Vec<Joint> {
    let has = |joint: Joint| nodes[joint.index()].is_some();
    let mut missing: Vec<Joint> = REQUIRED.into_iter().filter(|&joint| !has(joint)).collect();
    if !has(Joint::Head) && !has(Joint::Neck) {
        missing.push(Joint::Head);
    }
    missing
}

/// Lists the names of joints for a message.
pub(crate) fn joint_names(joints: &[Joint]) -> String {
    let names: Vec<&str> = joints.iter().map(|joint| joint.name()).collect();
    names.join(", ")
}

/// Lists the names of a file's nodes for a message.
pub(crate) fn node_names(clip: &Clip) -> String {
    const MAX_NAMES: usize = 80;
    let named = || clip.nodes.iter().filter(|node| node.name != END_SITE);
    let names: Vec<String> = named()
        .take(MAX_NAMES)
        .map(|node| node.name.chars().take(60).collect())
        .collect();
    match named().count() - names.len() {
        0 => names.join(", "),
        more => format!("{} and {more} more", names.join(", ")),
    }
}

impl<'a> NodeIndex<'a> {
    fn new(clip: &'a Clip, shorten: &dyn Fn(&str) -> &str) -> Self {
        let mut nodes: HashMap<String, Vec<usize>> = HashMap::new();
        for (index, node) in clip.nodes.iter().enumerate() {
            if node.name != END_SITE {
                let key = key(shorten(&node.name));
                nodes.entry(key).or_default().push(index);
            }
        }
        let moves = clip
            .nodes
            .iter()
            .map(|node| usize::from(node.translations.len() > 1 || node.rotations.len() > 1));
        let mut moving: Vec<usize> = moves.collect();
        // Parents come before their children.
        for (index, node) in clip.nodes.iter().enumerate().rev() {
            if let Some(parent) = node.parent {
                moving[parent] += moving[index];
            }
        }
        NodeIndex {
            clip,
            moving,
            nodes,
        }
    }

    /// Returns the prefixes that all names of a scheme may have in the file, the shortest first. They are what precedes
    /// the scheme's name of the pelvis in the names of nodes.
    fn prefixes(&self, scheme: &NamingScheme) -> Vec<String> {
        let pelvis = scheme.keys(Joint::Pelvis);
        let mut prefixes: Vec<String> = pelvis
            .iter()
            .flat_map(|pelvis| {
                self.nodes
                    .keys()
                    .filter_map(|key| key.strip_suffix(&**pelvis))
            })
            .map(str::to_owned)
            .collect();
        prefixes.sort_by_key(|prefix| (prefix.len(), prefix.clone()));
        prefixes.dedup();
        prefixes.truncate(MAX_PREFIXES);
        prefixes
    }

    /// Finds the joints of a scheme. A knee is accepted only below its hip, and so on: elsewhere the same word means
    /// something else.
    fn find(&self, scheme: &'static NamingScheme, prefix: &str) -> SchemeMatch {
        let mut nodes: JointNodes = [None; JOINTS];
        let mut misplaced = Vec::new();
        let has_marker = |marker| self.nodes.contains_key(&format!("{prefix}{}", key(marker)));
        if scheme.marker.is_none_or(has_marker) {
            for joint in Joint::ALL {
                let ancestor = match is_limb_joint(joint) {
                    true => joint.parent().and_then(|parent| nodes[parent.index()]),
                    false => nodes[Joint::Pelvis.index()],
                };
                let candidates = scheme.keys(joint).into_iter().enumerate();
                let candidates = candidates.flat_map(|(rank, key)| {
                    let found = self.nodes.get(&format!("{prefix}{key}"));
                    found.into_iter().flatten().map(move |&node| (rank, node))
                });
                let is_inside = |node| {
                    ancestor.is_some_and(|ancestor| self.clip.is_at_or_below(node, ancestor))
                };
                let is_named = candidates.clone().next().is_some();
                nodes[joint.index()] = candidates
                    .filter(|&(_, node)| !is_limb_joint(joint) || is_inside(node))
                    // Of several nodes with the same name, such as a bone and a mesh, prefer one inside the skeleton; of those
                    // of several characters, the one that the animation moves.
                    .min_by_key(|&(rank, node)| {
                        (!is_inside(node), rank, Reverse(self.moving[node]))
                    })
                    .map(|(_, node)| node);
                if is_named && ancestor.is_some() && nodes[joint.index()].is_none() {
                    misplaced.push(joint);
                }
            }
        }
        SchemeMatch {
            scheme,
            nodes,
            misplaced,
            count: nodes.iter().flatten().count(),
            moving: nodes[Joint::Pelvis.index()].map_or(0, |pelvis| self.moving[pelvis]),
        }
    }
}

/// Returns whether a joint is below its parent in the skeletons of all programs.
pub(crate) fn is_limb_joint(joint: Joint) -> bool {
    use Joint::*;
    matches!(
        joint,
        LeftKnee
            | RightKnee
            | LeftAnkle
            | RightAnkle
            | LeftFoot
            | RightFoot
            | LeftElbow
            | RightElbow
            | LeftWrist
            | RightWrist
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::Node;
    use glam::{DQuat, DVec3};

    /// Returns a clip of nodes without movement, each given as `name` or `name<parent`.
    fn clip(nodes: &[&str]) -> Clip {
        let names: Vec<&str> = nodes
            .iter()
            .map(|node| node.split('<').next().unwrap())
            .collect();
        let nodes = nodes.iter().map(|node| Node {
            name: node.split('<').next().unwrap().into(),
            parent: node
                .split_once('<')
                .map(|(_, parent)| names.iter().position(|name| *name == parent).unwrap()),
            rest: DVec3::Y,
            translations: vec![DVec3::Y],
            rotations: vec![DQuat::IDENTITY],
            scales: vec![DVec3::ONE],
        });
        Clip {
            nodes: nodes.collect(),
            frames: 1,
            seconds_per_frame: 0.0,
        }
    }

    const MIXAMO: [&str; 14] = [
        "Hips",
        "LeftUpLeg<Hips",
        "LeftLeg<LeftUpLeg",
        "LeftFoot<LeftLeg",
        "RightUpLeg<Hips",
        "RightLeg<RightUpLeg",
        "RightFoot<RightLeg",
        "Head<Hips",
        "LeftArm<Head",
        "LeftForeArm<LeftArm",
        "LeftHand<LeftForeArm",
        "RightArm<Head",
        "RightForeArm<RightArm",
        "RightHand<RightForeArm",
    ];

    #[test]
    fn any_common_prefix_is_ignored() {
        for prefix in [
            "",
            "mixamorig:",
            "mixamorig",
            "Character1_",
            "a:b:",
            "Hips_",
        ] {
            let names: Vec<String> = MIXAMO
                .iter()
                .map(|name| format!("{prefix}{}", name.replace('<', &format!("<{prefix}"))))
                .collect();
            let names: Vec<&str> = names.iter().map(|name| &**name).collect();
            let (scheme, nodes) = recognise(&clip(&names)).unwrap();
            assert!(scheme.starts_with("Mixamo"), "{prefix}: {scheme}");
            assert_eq!(nodes[Joint::RightWrist.index()], Some(13));
            assert_eq!(nodes[Joint::Neck.index()], None);
        }
    }

    #[test]
    fn feet_that_are_elsewhere_are_said_to_be() {
        let names = MIXAMO.map(|name| match name {
            "LeftFoot<LeftLeg" => "LeftFoot<Hips",
            "RightFoot<RightLeg" => "RightFoot<Hips",
            name => name,
        });
        let message = recognise(&clip(&names)).unwrap_err().to_string();
        assert!(
            message.contains(
                "but for leftfoot, rightfoot, of which the file has leftfoot, rightfoot elsewhere"
            ),
            "{message}"
        );
        let message = recognise(&clip(&names[..13])).unwrap_err().to_string();
        assert!(
            message.contains("righthand, of which the file has leftfoot, rightfoot elsewhere"),
            "{message}"
        );
        let message = recognise(&clip(&MIXAMO[..13])).unwrap_err().to_string();
        assert!(
            message.contains("but for righthand. For another"),
            "{message}"
        );
    }

    #[test]
    fn numbers_at_the_end_of_all_names_are_ignored() {
        let numbered = |name: &str| {
            let number = MIXAMO
                .iter()
                .position(|other| other.split('<').next() == Some(name));
            format!("mixamorig{name}_{:02}", 65 - number.unwrap())
        };
        let names: Vec<String> = MIXAMO
            .iter()
            .map(|name| match name.split_once('<') {
                Some((name, parent)) => format!("{}<{}", numbered(name), numbered(parent)),
                None => numbered(name),
            })
            .collect();
        let mut names: Vec<&str> = names.iter().map(|name| &**name).collect();
        names.push("Sketchfab_model");
        let (scheme, nodes) = recognise(&clip(&names)).unwrap();
        assert!(scheme.starts_with("Mixamo"), "{scheme}");
        assert_eq!(nodes[Joint::RightWrist.index()], Some(13));
        // A skeleton that lacks a hand is none with its numbers and none without.
        names[13] = "Hook_1<mixamorigRightForeArm_53";
        assert!(recognise(&clip(&names)).is_err());
    }

    #[test]
    fn of_two_characters_the_one_that_moves_is_taken() {
        // Of the same names below two armatures, and of two prefixes.
        for second in ["", "B_"] {
            let first: Vec<String> = MIXAMO.iter().map(|name| (*name).to_owned()).collect();
            let other = first.iter().map(|name| match name.split_once('<') {
                Some((name, parent)) => format!("{second}{name}<{second}{parent}"),
                None => format!("{second}{name}"),
            });
            let names: Vec<String> = first.iter().cloned().chain(other).collect();
            let names: Vec<&str> = names.iter().map(|name| &**name).collect();
            for moving in [0, MIXAMO.len()] {
                let mut clip = clip(&names);
                for (place, node) in clip.nodes.iter_mut().enumerate() {
                    if place >= MIXAMO.len() {
                        // `clip` finds parents by their names, which are those of the first character.
                        let own = names[place].split_once('<');
                        node.parent = own.map(|(_, parent)| {
                            let names = &names[MIXAMO.len()..];
                            let found = names
                                .iter()
                                .position(|name| name.split('<').next() == Some(parent));
                            MIXAMO.len() + found.unwrap()
                        });
                    }
                }
                clip.frames = 2;
                for node in &mut clip.nodes[moving..][..MIXAMO.len()] {
                    node.rotations = vec![DQuat::IDENTITY; 2];
                }
                let (_, nodes) = recognise(&clip).unwrap();
                assert_eq!(nodes[Joint::Pelvis.index()], Some(moving));
                assert_eq!(nodes[Joint::RightWrist.index()], Some(moving + 13));
                assert_eq!(nodes[Joint::Head.index()], Some(moving + 7));
            }
        }
    }

    #[test]
    fn a_mesh_called_like_a_bone_is_not_taken_for_it() {
        let mut names = vec!["Armature", "head"];
        names.extend(MIXAMO.map(|name| {
            if name == "Hips" {
                "Hips<Armature"
            } else {
                name
            }
        }));
        let (_, nodes) = recognise(&clip(&names)).unwrap();
        assert_eq!(nodes[Joint::Head.index()], Some(9));
    }

    #[test]
    fn the_error_of_an_unknown_skeleton_says_what_it_has_what_it_lacks_and_what_to_do() {
        let mut names = MIXAMO.to_vec();
        names[13] = "Hook<RightForeArm";
        let message = recognise(&clip(&names)).unwrap_err().to_string();
        for part in [
            "LeftForeArm",
            "Hook",
            "Mixamo",
            "righthand",
            "mapping file",
            "left_hip",
        ] {
            assert!(message.contains(part), "{part} is not in {message}");
        }
        let message = recognise(&clip(&["Tail", "Fin<Tail"]))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("Tail, Fin") && !message.contains("closest"),
            "{message}"
        );
    }

    #[test]
    fn a_knee_that_is_not_below_a_hip_is_not_accepted() {
        let mut names = MIXAMO.to_vec();
        names[2] = "LeftLeg<Hips";
        assert!(recognise(&clip(&names)).is_err());
    }
}
