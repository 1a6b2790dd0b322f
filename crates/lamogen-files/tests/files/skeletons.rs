//! The skeletons of all programs are read as the same motion.

use crate::figure::{Figure, Stance, position_at};
use lamogen_files::{ImportedMotion, JointMapping, ReadError, ReadOptions, Unit, UpAxis, read};
use lamogen_motion::Joint;

const CENTIMETRE: f64 = 0.01;
const CMU: f64 = 0.0254 / 0.45;

/// Returns a hierarchy with legs below the pelvis and arms below the chest. The spine is given line by line; the names of
/// legs and arms follow a pattern.
fn tree(spine: &str, leg: [&str; 5], arm: [&str; 5]) -> String {
    let depth = |line: &str| line.len() - line.trim_start().len();
    let lines: Vec<&str> = spine
        .lines()
        .filter(|line| !line.trim().is_empty())
        .collect();
    let chain = |from: usize, places: [&str; 5], names: [&str; 5]| {
        let joints = places.iter().zip(names).filter(|(_, name)| *name != "-");
        let lines = joints.enumerate().map(|(level, (place, name))| {
            format!("{}{place} {name}", " ".repeat(from + level))
                .trim_end()
                .to_owned()
                + "\n"
        });
        lines.collect::<String>()
    };
    let mut text = String::new();
    for line in &lines {
        let name = line.trim_start();
        if name.starts_with("pelvis ") {
            text += line;
            text += "\n";
            let places = [
                "left_hip",
                "left_knee",
                "left_ankle",
                "left_foot",
                "left_toe",
            ];
            text += &chain(depth(line) + 1, places, leg);
        } else if let Some(name) = name.strip_prefix('*') {
            // The chest, which is the parent of the arms.
            text += &format!("{}{name}\n", " ".repeat(depth(line)));
            let places = [
                "left_collar",
                "left_shoulder",
                "left_elbow",
                "left_wrist",
                "left_fingers",
            ];
            text += &chain(depth(line) + 1, places, arm);
        } else {
            text += line;
            text += "\n";
        }
    }
    text
}

/// Reads the figure and compares all joints with their known positions. Placed joints have a larger tolerance.
fn check(figure: &Figure<'_>, options: &ReadOptions) -> Result<ImportedMotion, ReadError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("figure.bvh");
    std::fs::write(&path, figure.text()).unwrap();
    let imported = read(&path, options)?;
    let seconds = (figure.frames - 1) as f64 / figure.frames_per_second;
    let frames = (seconds * 20.0 + 1e-6) as usize + 1;
    assert_eq!(imported.motion.frames(), frames);
    for frame in 0..frames {
        for joint in Joint::ALL {
            let found = glam::Vec3::from(imported.motion.position(frame, joint)).as_dvec3();
            let far = found.distance(position_at(joint.name(), frame as f64 / 20.0));
            let most = if imported.placed.contains(&joint) {
                0.07
            } else {
                5e-4
            };
            assert!(
                far <= most,
                "{} of {:?} at frame {frame}: {far} m",
                joint.name(),
                imported.scheme
            );
        }
    }
    Ok(imported)
}

fn figure<'a>(tree: &'a str, sides: [&'a str; 2], unit: f64) -> Figure<'a> {
    Figure {
        tree,
        sides,
        unit,
        stance: Stance::YUp,
        frames_per_second: 30.0,
        frames: 31,
    }
}

/// The scheme, the hierarchy, the words for the sides, the unit in metres, and the joints that are placed.
type Case = (&'static str, String, [&'static str; 2], f64, Vec<Joint>);

fn cases() -> Vec<Case> {
    use Joint::*;
    const LEFT_RIGHT: [&str; 2] = ["Left", "Right"];
    const L_R: [&str; 2] = ["L", "R"];
    let spine = vec![Spine1, Spine2, Spine3];
    let mut collars_too = spine.clone();
    collars_too.extend([LeftCollar, RightCollar]);
    let mut feet_too = vec![Spine1, Spine2, Spine3];
    feet_too.extend([LeftFoot, RightFoot]);
    vec![
        (
            "HumanML3D",
            tree(
                "pelvis pelvis\n spine1 spine1\n  spine2 spine2\n   *spine3 spine3\n    neck neck\n     head head\n      crown",
                ["%_hip", "%_knee", "%_ankle", "%_foot", ""],
                ["%_collar", "%_shoulder", "%_elbow", "%_wrist", ""],
            ),
            ["left", "right"],
            1.0,
            vec![],
        ),
        (
            "SMPL",
            tree(
                "pelvis f_avg_Pelvis\n spine1 f_avg_Spine1\n  spine2 f_avg_Spine2\n   *spine3 f_avg_Spine3\n    neck f_avg_Neck\n     head f_avg_Head",
                [
                    "f_avg_%_Hip",
                    "f_avg_%_Knee",
                    "f_avg_%_Ankle",
                    "f_avg_%_Foot",
                    "-",
                ],
                [
                    "f_avg_%_Collar",
                    "f_avg_%_Shoulder",
                    "f_avg_%_Elbow",
                    "f_avg_%_Wrist",
                    "f_avg_%_Hand",
                ],
            ),
            L_R,
            1.0,
            vec![],
        ),
        (
            "Mixamo",
            tree(
                "pelvis mixamorig:Hips\n spine1 mixamorig:Spine\n  spine2 mixamorig:Spine1\n   *spine3 mixamorig:Spine2\n    neck mixamorig:Neck\n     head mixamorig:Head\n      crown mixamorig:HeadTop_End",
                [
                    "mixamorig:%UpLeg",
                    "mixamorig:%Leg",
                    "mixamorig:%Foot",
                    "mixamorig:%ToeBase",
                    "mixamorig:%Toe_End",
                ],
                [
                    "mixamorig:%Shoulder",
                    "mixamorig:%Arm",
                    "mixamorig:%ForeArm",
                    "mixamorig:%Hand",
                    "mixamorig:%HandIndex1",
                ],
            ),
            LEFT_RIGHT,
            CENTIMETRE,
            vec![],
        ),
        (
            "CMU (cgspeed)",
            // Hips, collars and the lower neck are handles at the positions of their parents.
            "pelvis Hips
 pelvis LHipJoint
  left_hip %UpLeg
   left_knee %Leg
    left_ankle %Foot
     left_foot %ToeBase
      left_toe
 pelvis LowerBack
  belly Spine
   chest Spine1
    chest Neck
     neck Neck1
      head Head
       crown
    chest LeftShoulder
     left_shoulder %Arm
      left_elbow %ForeArm
       left_wrist %Hand
        left_wrist %FingerBase
         left_fingers
    chest RightShoulder"
                .into(),
            LEFT_RIGHT,
            CMU,
            collars_too.clone(),
        ),
        (
            "CMU (Acclaim)",
            tree(
                "pelvis hip\n pelvis lowerback\n  belly upperback\n   chest thorax\n    *chest lowerneck\n     neck upperneck\n      head head",
                ["%femur", "%tibia", "%foot", "%toes", ""],
                ["%clavicle", "%humerus", "%radius", "%wrist", "%hand"],
            ),
            ["l", "r"],
            CMU,
            spine.clone(),
        ),
        (
            "Rokoko",
            tree(
                "pelvis Hips\n spine1 Spine1\n  belly Spine2\n   spine3 Spine3\n    *chest Spine4\n     neck Neck\n      head Head",
                ["%Thigh", "%Shin", "%Foot", "%Toe", "%ToeTip"],
                ["%Shoulder", "%Arm", "%ForeArm", "%Hand", "%HandTip"],
            ),
            LEFT_RIGHT,
            CENTIMETRE,
            spine.clone(),
        ),
        (
            "Bandai-Namco",
            tree(
                "ground joint_Root\n pelvis Hips\n  belly Spine\n   *chest Chest\n    neck Neck\n     head Head\n      head",
                ["UpperLeg_%", "LowerLeg_%", "Foot_%", "Toes_%", ""],
                ["Shoulder_%", "UpperArm_%", "LowerArm_%", "Hand_%", ""],
            ),
            L_R,
            CENTIMETRE,
            spine.clone(),
        ),
        (
            "Biovision, 3ds Max",
            tree(
                "pelvis Hips\n *chest Chest\n  neck Neck\n   head Head\n    crown",
                ["%Hip", "%Knee", "%Ankle", "%Toe", ""],
                ["%Collar", "%Shoulder", "%Elbow", "%Wrist", ""],
            ),
            LEFT_RIGHT,
            0.0254,
            spine.clone(),
        ),
        (
            "Biovision, first",
            tree(
                "pelvis Hips\n *chest Chest\n  neck Neck\n   head Head\n    crown",
                ["%UpLeg", "%LowLeg", "%Foot", "-", ""],
                ["%Collar", "%UpArm", "%LowArm", "%Hand", ""],
            ),
            LEFT_RIGHT,
            0.0254,
            feet_too,
        ),
        (
            "Daz, Poser",
            tree(
                "pelvis hip\n belly abdomen\n  *chest chest\n   neck neck\n    head head\n     crown leftEye",
                ["%Thigh", "%Shin", "%Foot", "%Toe", "%BigToe"],
                ["%Collar", "%Shldr", "%ForeArm", "%Hand", "%Mid1"],
            ),
            ["l", "r"],
            CENTIMETRE,
            spine.clone(),
        ),
        (
            "Xsens",
            tree(
                "pelvis Pelvis\n spine1 L5\n  belly L3\n   spine3 T12\n    *chest T8\n     neck Neck\n      head Head",
                ["%UpperLeg", "%LowerLeg", "%Foot", "%Toe", ""],
                ["%Shoulder", "%UpperArm", "%ForeArm", "%Hand", ""],
            ),
            LEFT_RIGHT,
            CENTIMETRE,
            spine.clone(),
        ),
        (
            "Unreal",
            tree(
                "ground root\n pelvis pelvis\n  spine1 spine_01\n   spine2 spine_02\n    *spine3 spine_03\n     neck neck_01\n      head head",
                ["thigh_%", "calf_%", "foot_%", "ball_%", ""],
                [
                    "clavicle_%",
                    "upperarm_%",
                    "lowerarm_%",
                    "hand_%",
                    "middle_01_%",
                ],
            ),
            ["l", "r"],
            CENTIMETRE,
            vec![],
        ),
        (
            "Unity, VRM",
            tree(
                "pelvis hips\n belly spine\n  *chest chest\n   neck neck\n    head head",
                ["%UpperLeg", "%LowerLeg", "%Foot", "%Toes", ""],
                ["%Shoulder", "%UpperArm", "%LowerArm", "%Hand", ""],
            ),
            ["left", "right"],
            1.0,
            spine.clone(),
        ),
        (
            "VRoid",
            tree(
                "ground Root\n pelvis J_Bip_C_Hips\n  belly J_Bip_C_Spine\n   *chest J_Bip_C_Chest\n    neck J_Bip_C_Neck\n     head J_Bip_C_Head",
                [
                    "J_Bip_%_UpperLeg",
                    "J_Bip_%_LowerLeg",
                    "J_Bip_%_Foot",
                    "J_Bip_%_ToeBase",
                    "",
                ],
                [
                    "J_Bip_%_Shoulder",
                    "J_Bip_%_UpperArm",
                    "J_Bip_%_LowerArm",
                    "J_Bip_%_Hand",
                    "",
                ],
            ),
            L_R,
            1.0,
            spine.clone(),
        ),
        (
            "Blender Rigify",
            tree(
                "pelvis DEF-spine\n spine1 DEF-spine.001\n  spine2 DEF-spine.002\n   *spine3 DEF-spine.003\n    neck DEF-spine.004\n     throat DEF-spine.005\n      head DEF-spine.006",
                ["DEF-thigh.%", "DEF-shin.%", "DEF-foot.%", "DEF-toe.%", ""],
                [
                    "DEF-shoulder.%",
                    "DEF-upper_arm.%",
                    "DEF-forearm.%",
                    "DEF-hand.%",
                    "",
                ],
            ),
            L_R,
            1.0,
            vec![],
        ),
        (
            "Quaternius",
            tree(
                "ground Root\n belly Belly\n  pelvis Hips\n   spine1 Abdomen\n    *chest Torso\n     neck Neck\n      head Head",
                ["UpperLeg.%", "LowerLeg.%", "Foot.%", "Toe.%", ""],
                ["Shoulder.%", "UpperArm.%", "LowerArm.%", "Fist.%", ""],
            ),
            L_R,
            1.0,
            spine.clone(),
        ),
        (
            "Blender, Mixamo's words",
            tree(
                "pelvis hips\n belly spine\n  *chest chest\n   neck neck\n    head head",
                ["upleg.%", "leg.%", "foot.%", "toe.%", ""],
                ["shoulder.%", "arm.%", "forearm.%", "hand.%", ""],
            ),
            L_R,
            1.0,
            spine.clone(),
        ),
        (
            "3ds Max Biped",
            tree(
                "pelvis Bip01\n pelvis Bip01 Pelvis\n  belly Bip01 Spine\n   *chest Bip01 Spine1\n    neck Bip01 Neck\n     head Bip01 Head",
                [
                    "Bip01 % Thigh",
                    "Bip01 % Calf",
                    "Bip01 % Foot",
                    "Bip01 % Toe0",
                    "",
                ],
                [
                    "Bip01 % Clavicle",
                    "Bip01 % UpperArm",
                    "Bip01 % Forearm",
                    "Bip01 % Hand",
                    "",
                ],
            ),
            L_R,
            0.0254,
            spine.clone(),
        ),
        (
            "3ds Max Biped, Reallusion",
            tree(
                "ground CC_Base_BoneRoot\n pelvis CC_Base_Hip\n  spine1 CC_Base_Waist\n   spine2 CC_Base_Spine01\n    *spine3 CC_Base_Spine02\n     neck CC_Base_NeckTwist01\n      throat CC_Base_NeckTwist02\n       head CC_Base_Head",
                [
                    "CC_Base_%_Thigh",
                    "CC_Base_%_Calf",
                    "CC_Base_%_Foot",
                    "CC_Base_%_ToeBase",
                    "",
                ],
                [
                    "CC_Base_%_Clavicle",
                    "CC_Base_%_Upperarm",
                    "CC_Base_%_Forearm",
                    "CC_Base_%_Hand",
                    "",
                ],
            ),
            L_R,
            CENTIMETRE,
            vec![],
        ),
    ]
}

#[test]
fn every_scheme_is_recognised_with_its_unit_and_gives_the_same_motion() {
    for (scheme, tree, sides, unit, placed) in cases() {
        let figure = figure(&tree, sides, unit);
        let imported = check(&figure, &ReadOptions::default())
            .unwrap_or_else(|error| panic!("{scheme}: {error}"));
        assert!(
            imported.scheme.unwrap().starts_with(scheme),
            "{scheme}: {:?}",
            imported.scheme
        );
        assert!(
            (imported.unit.metres() - unit).abs() < 1e-9,
            "{scheme}: {}",
            imported.unit
        );
        assert_eq!(imported.up, UpAxis::Y, "{scheme}");
        assert_eq!(imported.source_frames_per_second, 30.0);
        assert_eq!(
            (imported.source_frames, imported.announced_frames),
            (31, None)
        );
        assert_eq!(imported.placed, placed, "{scheme}");
    }
}

fn mixamo() -> Case {
    cases().swap_remove(2)
}

#[test]
fn axes_and_rest_pose_do_not_matter() {
    for (stance, up) in [
        (Stance::YUp, UpAxis::Y),
        (Stance::ZUp, UpAxis::Z),
        (Stance::Lying, UpAxis::Y),
        (Stance::RestYUp, UpAxis::Z),
    ] {
        let (_, tree, sides, _, _) = mixamo();
        for unit in [1.0, 0.01, 0.001, 0.0254, CMU] {
            let figure = Figure {
                stance,
                ..figure(&tree, sides, unit)
            };
            let imported = check(&figure, &ReadOptions::default()).unwrap();
            assert_eq!(imported.up, up, "{stance:?}");
            assert!((imported.unit.metres() - unit).abs() < 1e-9);
        }
    }
}

#[test]
fn motions_of_any_frame_rate_and_length_are_read_at_twenty_frames_a_second() {
    let (_, tree, sides, unit, _) = mixamo();
    for (frames_per_second, frames, rate) in [
        (120.0, 121, 120.0),
        (120.0, 13, 120.0),
        (24.0, 49, 24.0),
        (20.0, 40, 20.0),
        (12.5, 26, 12.5),
        (60.0, 2, 60.0),
        (30.0, 1, 30.0),
    ] {
        let figure = Figure {
            frames_per_second,
            frames,
            ..figure(&tree, sides, unit)
        };
        let imported = check(&figure, &ReadOptions::default()).unwrap();
        assert!((imported.source_frames_per_second - rate).abs() < 1e-3);
    }
}

#[test]
fn options_replace_guesses() {
    let (_, tree, sides, _, _) = mixamo();
    // A figure in feet does not have human size in any of the units that are tried.
    let feet = figure(&tree, sides, 0.3048);
    let message = check(&feet, &ReadOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("figure.bvh") && message.contains("unit"),
        "{message}"
    );
    let unit = Some(Unit::Metres(0.3048));
    let options = ReadOptions {
        unit,
        ..ReadOptions::default()
    };
    assert_eq!(check(&feet, &options).unwrap().unit, Unit::Metres(0.3048));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("figure.bvh");
    std::fs::write(&path, figure(&tree, sides, 0.01).text()).unwrap();
    let up = Some(UpAxis::Z);
    let imported = read(
        &path,
        &ReadOptions {
            up,
            ..ReadOptions::default()
        },
    )
    .unwrap();
    assert_eq!(imported.up, UpAxis::Z);
    let [_, head_y, _] = imported.motion.position(0, Joint::Head);
    assert!(head_y.abs() < 0.1, "the body lies: {head_y}");
}

#[test]
fn a_mapping_file_names_the_joints_of_an_unknown_skeleton() {
    let tree = tree(
        "pelvis Becken\n belly Bauch\n  *chest Brust\n   neck Hals\n    head Kopf",
        ["Hüfte %", "Knie %", "Knöchel %", "Ballen %", ""],
        ["-", "Schulter %", "Ellbogen %", "Handgelenk %", ""],
    );
    let figure = figure(&tree, ["links", "rechts"], 0.01);
    let message = check(&figure, &ReadOptions::default())
        .unwrap_err()
        .to_string();
    for part in ["Knöchel links", "mapping file", "left_hip"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let mut json = String::from("{\"pelvis\": \"Becken\", \"neck\": \"Hals\", \"head\": \"Kopf\"");
    for (joint, name) in [
        ("hip", "Hüfte"),
        ("knee", "Knie"),
        ("ankle", "Knöchel"),
        ("foot", "Ballen"),
        ("shoulder", "Schulter"),
        ("elbow", "Ellbogen"),
        ("wrist", "Handgelenk"),
    ] {
        json +=
            &format!(", \"left_{joint}\": \"{name} links\", \"right_{joint}\": \"{name} rechts\"");
    }
    json.push('}');
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mapping.json");
    std::fs::write(&path, &json).unwrap();
    let mapping = JointMapping::read(&path).unwrap();
    let options = ReadOptions {
        mapping: Some(mapping),
        ..ReadOptions::default()
    };
    let imported = check(&figure, &options).unwrap();
    assert_eq!(imported.scheme, Some("mapping file"));
    assert_eq!(imported.placed.len(), 5);
}

#[test]
fn head_or_neck_is_enough() {
    for (spine, placed) in [
        ("pelvis Hips\n *chest Chest\n  head Head", Joint::Neck),
        (
            "pelvis Hips\n *chest Chest\n  neck Neck\n   head",
            Joint::Head,
        ),
        ("pelvis Hips\n *chest Chest\n  neck Neck", Joint::Head),
    ] {
        let tree = tree(
            spine,
            ["%UpLeg", "%Leg", "%Foot", "%Toe", ""],
            ["%Shoulder", "%Arm", "%ForeArm", "%Hand", ""],
        );
        let figure = figure(&tree, ["Left", "Right"], 0.01);
        let imported = check(&figure, &ReadOptions::default()).unwrap();
        assert!(imported.placed.contains(&placed), "{:?}", imported.placed);
    }
}

#[test]
fn feet_without_an_end_point_forward() {
    let tree = tree(
        "pelvis Hips\n *chest Chest\n  neck Neck\n   head Head",
        ["%UpLeg", "%Leg", "%Foot", "-", "-"],
        ["%Shoulder", "%Arm", "%ForeArm", "%Hand", ""],
    );
    let figure = figure(&tree, ["Left", "Right"], 0.01);
    let imported = check(&figure, &ReadOptions::default()).unwrap();
    assert!(imported.placed.contains(&Joint::LeftFoot));
}

#[test]
fn a_motion_of_more_than_an_hour_is_an_error() {
    let (_, tree, sides, unit, _) = mixamo();
    let text = Figure {
        frames: 500,
        frames_per_second: 0.1,
        ..figure(&tree, sides, unit)
    }
    .text();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.bvh");
    std::fs::write(&path, text).unwrap();
    let message = read(&path, &ReadOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("hour") && message.contains("4990"),
        "{message}"
    );
}

#[test]
fn damaged_files_are_errors_or_motions_but_never_panics() {
    let (_, tree, sides, unit, _) = mixamo();
    let text = Figure {
        frames: 3,
        ..figure(&tree, sides, unit)
    }
    .text();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.bvh");
    let junk = [
        "",
        "0",
        "-",
        "1e300",
        "}",
        "{",
        "\n",
        "End Site {",
        "mixamorig:Hips",
        "\u{fffd}",
    ];
    let places = (0..text.len() - 3).step_by(17);
    for (place, junk) in places.zip(junk.into_iter().cycle()) {
        std::fs::write(
            &path,
            format!("{}{junk}{}", &text[..place], &text[place + 3..]),
        )
        .unwrap();
        let _ = read(&path, &ReadOptions::default());
    }
    // Offsets of zero, and offsets that overflow or underflow.
    for number in ["0", "1e308", "-1e308", "1e-308"] {
        let lines = text.lines().map(|line| match line.starts_with("OFFSET") {
            true => format!("OFFSET {number} {number} {number}\n"),
            false => format!("{line}\n"),
        });
        std::fs::write(&path, lines.collect::<String>()).unwrap();
        assert!(read(&path, &ReadOptions::default()).is_err());
        let unit = Some(Unit::Metre);
        let _ = read(
            &path,
            &ReadOptions {
                unit,
                ..ReadOptions::default()
            },
        );
    }
}
