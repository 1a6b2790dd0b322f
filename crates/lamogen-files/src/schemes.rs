//! The names of the joints in the files of other programs.

use lamogen_motion::{JOINTS, Joint};

/// The names of all joints in the files of one program. A scheme is matched as a whole, because the same word means
/// different joints in different schemes: `LeftShoulder` is the collar in Mixamo and the upper arm in Biovision.
///
/// Names are compared by their [`key`], and all may have the same prefix. `%` stands for the side. Alternatives are
/// separated by `|`; the first one that a skeleton has is used. The spine has no names: it consists of the nodes between
/// pelvis and neck.
pub(crate) struct NamingScheme {
    pub(crate) name: &'static str,
    /// The words for left and right.
    sides: [&'static str; 2],
    /// The names of pelvis, neck and head.
    middle: [&'static str; 3],
    /// The names of hip, knee, ankle and foot.
    leg: [&'static str; 4],
    /// The names of collar, shoulder, elbow and wrist.
    arm: [&'static str; 4],
    /// The name of a node that distinguishes the scheme from another one with the same joint names.
    pub(crate) marker: Option<&'static str>,
}

impl NamingScheme {
    /// Returns the keys of the names that a joint may have; none for the spine.
    pub(crate) fn keys(&self, joint: Joint) -> Vec<String> {
        use Joint::*;
        let (pattern, side) = match joint {
            Pelvis => (self.middle[0], ""),
            Neck => (self.middle[1], ""),
            Head => (self.middle[2], ""),
            Spine1 | Spine2 | Spine3 => return Vec::new(),
            LeftHip => (self.leg[0], self.sides[0]),
            LeftKnee => (self.leg[1], self.sides[0]),
            LeftAnkle => (self.leg[2], self.sides[0]),
            LeftFoot => (self.leg[3], self.sides[0]),
            LeftCollar => (self.arm[0], self.sides[0]),
            LeftShoulder => (self.arm[1], self.sides[0]),
            LeftElbow => (self.arm[2], self.sides[0]),
            LeftWrist => (self.arm[3], self.sides[0]),
            RightHip => (self.leg[0], self.sides[1]),
            RightKnee => (self.leg[1], self.sides[1]),
            RightAnkle => (self.leg[2], self.sides[1]),
            RightFoot => (self.leg[3], self.sides[1]),
            RightCollar => (self.arm[0], self.sides[1]),
            RightShoulder => (self.arm[1], self.sides[1]),
            RightElbow => (self.arm[2], self.sides[1]),
            RightWrist => (self.arm[3], self.sides[1]),
        };
        let names = pattern.split('|').map(|name| key(&name.replace('%', side)));
        names.filter(|name| !name.is_empty()).collect()
    }
}

/// Returns a name in lower case without its prefix up to the last colon, spaces and punctuation: `mixamorig:LeftUpLeg`
/// becomes `leftupleg`, `upper_arm.L` becomes `upperarml`.
pub(crate) fn key(name: &str) -> String {
    let name = name.rsplit(':').next().unwrap_or(name);
    let letters = name.chars().filter(|c| c.is_alphanumeric());
    letters.flat_map(char::to_lowercase).collect()
}

/// The joints that a skeleton must have. In addition, it must have a head or a neck.
pub(crate) const REQUIRED: [Joint; 13] = [
    Joint::Pelvis,
    Joint::LeftHip,
    Joint::RightHip,
    Joint::LeftKnee,
    Joint::RightKnee,
    Joint::LeftAnkle,
    Joint::RightAnkle,
    Joint::LeftShoulder,
    Joint::RightShoulder,
    Joint::LeftElbow,
    Joint::RightElbow,
    Joint::LeftWrist,
    Joint::RightWrist,
];

/// The node of each joint in a file, if it has one.
pub(crate) type JointNodes = [Option<usize>; JOINTS];

const LEFT_RIGHT: [&str; 2] = ["Left", "Right"];
const L_R: [&str; 2] = ["L", "R"];

/// The known schemes. If two fit equally well, the first one is used.
pub(crate) const SCHEMES: &[NamingScheme] = &[
    NamingScheme {
        name: "HumanML3D",
        sides: LEFT_RIGHT,
        middle: ["pelvis", "neck", "head"],
        leg: ["%_hip", "%_knee", "%_ankle", "%_foot"],
        arm: ["%_collar", "%_shoulder", "%_elbow", "%_wrist"],
        marker: None,
    },
    NamingScheme {
        name: "SMPL",
        sides: L_R,
        middle: ["Pelvis", "Neck", "Head"],
        leg: ["%_Hip", "%_Knee", "%_Ankle", "%_Foot|%_Toe"],
        arm: ["%_Collar|%_Thorax", "%_Shoulder", "%_Elbow", "%_Wrist"],
        marker: None,
    },
    NamingScheme {
        name: "CMU (cgspeed)",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%UpLeg", "%Leg", "%Foot", "%ToeBase|%ForeFoot"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        marker: Some("LHipJoint"),
    },
    NamingScheme {
        name: "CMU (Acclaim)",
        sides: L_R,
        middle: ["hip|hips|root", "lowerneck", "head"],
        leg: ["%femur", "%tibia", "%foot|%ankle", "%toes|%toe"],
        arm: [
            "%clavicle|%collar",
            "%humerus|%shoulder",
            "%radius|%elbow",
            "%wrist|%hand",
        ],
        marker: None,
    },
    NamingScheme {
        name: "Mixamo, MotionBuilder, LAFAN1",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%UpLeg", "%Leg", "%Foot", "%ToeBase|%Toe|%ForeFoot"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        marker: None,
    },
    NamingScheme {
        // The thigh has the name that the shin has in Mixamo.
        name: "SOMA (Kimodo)",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck1|Neck", "Head"],
        leg: ["%Leg", "%Shin", "%Foot", "%ToeBase|%Toe"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        marker: None,
    },
    NamingScheme {
        name: "MakeHuman",
        sides: L_R,
        middle: ["root|pelvis", "neck01|neck", "head"],
        leg: ["upperleg01.%", "lowerleg01.%", "foot.%", "toe1-1.%"],
        arm: ["clavicle.%", "upperarm01.%", "lowerarm01.%", "wrist.%"],
        marker: None,
    },
    NamingScheme {
        name: "Kinect",
        sides: LEFT_RIGHT,
        middle: ["HipCenter|SpineBase", "ShoulderCenter|Neck", "Head"],
        leg: ["Hip%", "Knee%", "Ankle%", "Foot%"],
        arm: ["", "Shoulder%", "Elbow%", "Wrist%"],
        marker: None,
    },
    NamingScheme {
        name: "OpenNI",
        sides: LEFT_RIGHT,
        middle: ["WAIST|TORSO", "NECK", "HEAD"],
        leg: ["%_HIP", "%_KNEE", "%_FOOT", ""],
        arm: ["%_COLLAR", "%_SHOULDER", "%_ELBOW", "%_HAND"],
        marker: None,
    },
    NamingScheme {
        name: "Rokoko",
        sides: LEFT_RIGHT,
        middle: ["Hips|Hip", "Neck", "Head"],
        leg: ["%Thigh", "%Shin", "%Foot", "%Toe"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        marker: None,
    },
    NamingScheme {
        name: "Bandai-Namco",
        sides: L_R,
        middle: ["Hips", "Neck", "Head"],
        leg: ["UpperLeg_%", "LowerLeg_%", "Foot_%", "Toes_%|Toe_%"],
        arm: ["Shoulder_%", "UpperArm_%", "LowerArm_%", "Hand_%"],
        marker: None,
    },
    NamingScheme {
        name: "Biovision, 3ds Max-friendly",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%Hip", "%Knee", "%Ankle", "%Toe|%Foot"],
        arm: ["%Collar", "%Shoulder", "%Elbow", "%Wrist"],
        marker: None,
    },
    NamingScheme {
        name: "Biovision, first files",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%UpLeg", "%LowLeg", "%Foot", "%Toe"],
        arm: ["%Collar", "%UpArm", "%LowArm", "%Hand"],
        marker: None,
    },
    NamingScheme {
        name: "Daz, Poser",
        sides: ["l", "r"],
        middle: ["hip|pelvis", "neck|neckLower", "head"],
        leg: [
            "%Thigh|%ThighBend",
            "%Shin",
            "%Foot",
            "%Toe|%Toes|%Metatarsals",
        ],
        arm: [
            "%Collar",
            "%Shldr|%ShldrBend|%Shoulder",
            "%ForeArm|%ForearmBend",
            "%Hand",
        ],
        marker: None,
    },
    NamingScheme {
        name: "Xsens",
        sides: LEFT_RIGHT,
        middle: ["Pelvis|Hips", "Neck", "Head"],
        leg: ["%UpperLeg", "%LowerLeg", "%Foot", "%Toe"],
        arm: ["%Shoulder", "%UpperArm", "%ForeArm", "%Hand"],
        marker: None,
    },
    NamingScheme {
        name: "Unreal",
        sides: ["l", "r"],
        middle: ["pelvis", "neck_01", "head"],
        leg: ["thigh_%", "calf_%", "foot_%", "ball_%"],
        arm: ["clavicle_%", "upperarm_%", "lowerarm_%", "hand_%"],
        marker: None,
    },
    NamingScheme {
        name: "Unity, VRM",
        sides: LEFT_RIGHT,
        middle: ["hips", "neck", "head"],
        leg: ["%UpperLeg", "%LowerLeg", "%Foot", "%Toes|%Toe"],
        arm: ["%Shoulder", "%UpperArm", "%LowerArm", "%Hand"],
        marker: None,
    },
    NamingScheme {
        name: "VRoid",
        sides: L_R,
        middle: ["J_Bip_C_Hips", "J_Bip_C_Neck", "J_Bip_C_Head"],
        leg: [
            "J_Bip_%_UpperLeg",
            "J_Bip_%_LowerLeg",
            "J_Bip_%_Foot",
            "J_Bip_%_ToeBase",
        ],
        arm: [
            "J_Bip_%_Shoulder",
            "J_Bip_%_UpperArm",
            "J_Bip_%_LowerArm",
            "J_Bip_%_Hand",
        ],
        marker: None,
    },
    NamingScheme {
        name: "Blender Rigify",
        sides: L_R,
        middle: ["hips|spine", "neck|spine.004", "head|spine.006|spine.005"],
        leg: ["thigh.%", "shin.%", "foot.%", "toe.%"],
        arm: ["shoulder.%", "upper_arm.%", "forearm.%", "hand.%"],
        marker: None,
    },
    NamingScheme {
        name: "Quaternius",
        sides: L_R,
        middle: ["Hips", "Neck", "Head"],
        leg: ["UpperLeg.%", "LowerLeg.%", "Foot.%", "Toes.%|Toe.%"],
        arm: ["Shoulder.%", "UpperArm.%", "LowerArm.%", "Fist.%|Palm.%"],
        marker: None,
    },
    NamingScheme {
        name: "Blender, Mixamo's words",
        sides: L_R,
        middle: ["hips", "neck", "head"],
        leg: ["upleg.%", "leg.%", "foot.%", "toe.%|toebase.%"],
        arm: ["shoulder.%", "arm.%", "forearm.%", "hand.%"],
        marker: None,
    },
    NamingScheme {
        name: "3ds Max Biped, Reallusion",
        sides: L_R,
        middle: ["Pelvis|Hip", "Neck|NeckTwist01", "Head"],
        leg: ["% Thigh", "% Calf", "% Foot", "% Toe0|% ToeBase"],
        arm: ["% Clavicle", "% UpperArm", "% Forearm", "% Hand"],
        marker: None,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_forget_prefix_case_and_signs() {
        assert_eq!(key("mixamorig:LeftUpLeg"), "leftupleg");
        assert_eq!(key("Bip01 L Thigh"), "bip01lthigh");
        assert_eq!(key("upper_arm.L"), "upperarml");
    }

    #[test]
    fn every_scheme_names_what_is_required_and_no_name_twice() {
        for scheme in SCHEMES {
            let mut seen = Vec::new();
            for joint in Joint::ALL {
                let keys = scheme.keys(joint);
                assert!(
                    !keys.is_empty() || !REQUIRED.contains(&joint),
                    "{}",
                    scheme.name
                );
                for key in keys {
                    assert!(!seen.contains(&key), "{} has {key} twice", scheme.name);
                    seen.push(key);
                }
            }
        }
    }
}
