//! What other programs call the joints of a human.

use lamogen_motion::{JOINTS, Joint};

/// A way to name joints, as a whole. The same word means different joints in different schemes:
/// `LeftShoulder` is the collar in Mixamo and the upper arm in Biovision's.
///
/// Names are compared as [`key`] reduces them, and may all have one prefix. `%` stands for the side; of
/// alternatives, parted by `|`, the first that a skeleton has counts. The spine is not named: it is
/// what lies between pelvis and neck.
pub(crate) struct Scheme {
    pub(crate) name: &'static str,
    /// Left and right.
    sides: [&'static str; 2],
    /// Pelvis, neck, head.
    middle: [&'static str; 3],
    /// Hip, knee, ankle, foot.
    leg: [&'static str; 4],
    /// Collar, shoulder, elbow, wrist.
    arm: [&'static str; 4],
    /// A name that tells it from a scheme with the same other names.
    pub(crate) mark: Option<&'static str>,
}

impl Scheme {
    /// What a joint may be called, reduced to keys; nothing for the spine.
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

/// A name without case, prefix up to a colon, blanks and other signs: `mixamorig:LeftUpLeg` becomes
/// `leftupleg`, `upper_arm.L` becomes `upperarml`.
pub(crate) fn key(name: &str) -> String {
    let name = name.rsplit(':').next().unwrap_or(name);
    let letters = name.chars().filter(|c| c.is_alphanumeric());
    letters.flat_map(char::to_lowercase).collect()
}

/// The joints that a skeleton must have, besides head or neck.
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

/// Which nodes of a file are which joints.
pub(crate) type Nodes = [Option<usize>; JOINTS];

const LEFT_RIGHT: [&str; 2] = ["Left", "Right"];
const L_R: [&str; 2] = ["L", "R"];

/// The schemes that are known; of two that fit alike the first counts.
pub(crate) const SCHEMES: &[Scheme] = &[
    Scheme {
        name: "HumanML3D",
        sides: LEFT_RIGHT,
        middle: ["pelvis", "neck", "head"],
        leg: ["%_hip", "%_knee", "%_ankle", "%_foot"],
        arm: ["%_collar", "%_shoulder", "%_elbow", "%_wrist"],
        mark: None,
    },
    Scheme {
        name: "SMPL",
        sides: L_R,
        middle: ["Pelvis", "Neck", "Head"],
        leg: ["%_Hip", "%_Knee", "%_Ankle", "%_Foot|%_Toe"],
        arm: ["%_Collar|%_Thorax", "%_Shoulder", "%_Elbow", "%_Wrist"],
        mark: None,
    },
    Scheme {
        name: "CMU (cgspeed)",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%UpLeg", "%Leg", "%Foot", "%ToeBase|%ForeFoot"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        mark: Some("LHipJoint"),
    },
    Scheme {
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
        mark: None,
    },
    Scheme {
        name: "Mixamo, MotionBuilder, LAFAN1",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%UpLeg", "%Leg", "%Foot", "%ToeBase|%Toe|%ForeFoot"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        mark: None,
    },
    Scheme {
        // The thigh is called what Mixamo calls the shin.
        name: "SOMA (Kimodo)",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck1|Neck", "Head"],
        leg: ["%Leg", "%Shin", "%Foot", "%ToeBase|%Toe"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        mark: None,
    },
    Scheme {
        name: "MakeHuman",
        sides: L_R,
        middle: ["root|pelvis", "neck01|neck", "head"],
        leg: ["upperleg01.%", "lowerleg01.%", "foot.%", "toe1-1.%"],
        arm: ["clavicle.%", "upperarm01.%", "lowerarm01.%", "wrist.%"],
        mark: None,
    },
    Scheme {
        name: "Kinect",
        sides: LEFT_RIGHT,
        middle: ["HipCenter|SpineBase", "ShoulderCenter|Neck", "Head"],
        leg: ["Hip%", "Knee%", "Ankle%", "Foot%"],
        arm: ["", "Shoulder%", "Elbow%", "Wrist%"],
        mark: None,
    },
    Scheme {
        name: "OpenNI",
        sides: LEFT_RIGHT,
        middle: ["WAIST|TORSO", "NECK", "HEAD"],
        leg: ["%_HIP", "%_KNEE", "%_FOOT", ""],
        arm: ["%_COLLAR", "%_SHOULDER", "%_ELBOW", "%_HAND"],
        mark: None,
    },
    Scheme {
        name: "Rokoko",
        sides: LEFT_RIGHT,
        middle: ["Hips|Hip", "Neck", "Head"],
        leg: ["%Thigh", "%Shin", "%Foot", "%Toe"],
        arm: ["%Shoulder", "%Arm", "%ForeArm", "%Hand"],
        mark: None,
    },
    Scheme {
        name: "Bandai-Namco",
        sides: L_R,
        middle: ["Hips", "Neck", "Head"],
        leg: ["UpperLeg_%", "LowerLeg_%", "Foot_%", "Toes_%|Toe_%"],
        arm: ["Shoulder_%", "UpperArm_%", "LowerArm_%", "Hand_%"],
        mark: None,
    },
    Scheme {
        name: "Biovision, 3ds Max-friendly",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%Hip", "%Knee", "%Ankle", "%Toe|%Foot"],
        arm: ["%Collar", "%Shoulder", "%Elbow", "%Wrist"],
        mark: None,
    },
    Scheme {
        name: "Biovision, first files",
        sides: LEFT_RIGHT,
        middle: ["Hips", "Neck", "Head"],
        leg: ["%UpLeg", "%LowLeg", "%Foot", "%Toe"],
        arm: ["%Collar", "%UpArm", "%LowArm", "%Hand"],
        mark: None,
    },
    Scheme {
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
        mark: None,
    },
    Scheme {
        name: "Xsens",
        sides: LEFT_RIGHT,
        middle: ["Pelvis|Hips", "Neck", "Head"],
        leg: ["%UpperLeg", "%LowerLeg", "%Foot", "%Toe"],
        arm: ["%Shoulder", "%UpperArm", "%ForeArm", "%Hand"],
        mark: None,
    },
    Scheme {
        name: "Unreal",
        sides: ["l", "r"],
        middle: ["pelvis", "neck_01", "head"],
        leg: ["thigh_%", "calf_%", "foot_%", "ball_%"],
        arm: ["clavicle_%", "upperarm_%", "lowerarm_%", "hand_%"],
        mark: None,
    },
    Scheme {
        name: "Unity, VRM",
        sides: LEFT_RIGHT,
        middle: ["hips", "neck", "head"],
        leg: ["%UpperLeg", "%LowerLeg", "%Foot", "%Toes|%Toe"],
        arm: ["%Shoulder", "%UpperArm", "%LowerArm", "%Hand"],
        mark: None,
    },
    Scheme {
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
        mark: None,
    },
    Scheme {
        name: "Blender Rigify",
        sides: L_R,
        middle: ["hips|spine", "neck|spine.004", "head|spine.006|spine.005"],
        leg: ["thigh.%", "shin.%", "foot.%", "toe.%"],
        arm: ["shoulder.%", "upper_arm.%", "forearm.%", "hand.%"],
        mark: None,
    },
    Scheme {
        name: "3ds Max Biped, Reallusion",
        sides: L_R,
        middle: ["Pelvis|Hip", "Neck|NeckTwist01", "Head"],
        leg: ["% Thigh", "% Calf", "% Foot", "% Toe0|% ToeBase"],
        arm: ["% Clavicle", "% UpperArm", "% Forearm", "% Hand"],
        mark: None,
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
