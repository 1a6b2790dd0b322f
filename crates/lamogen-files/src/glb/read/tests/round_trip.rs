//! Files that lamogen writes are read back.

use super::*;
use crate::glb;
use crate::glb::body::t_pose_on_ground;

#[test]
fn written_files_read_back_to_a_tenth_of_a_millimetre() {
    for body in [true, false] {
        let clip = write_and_read(&GlbOptions {
            body,
            ..GlbOptions::default()
        });
        assert_eq!(clip.frames, 40);
        assert!((clip.seconds_per_frame - 0.05).abs() < 1e-7);
        let gap = largest_gap(&clip, &example::rotations().joints());
        assert!(gap < 1e-4, "{gap}");
    }
}

#[test]
fn a_long_motion_keeps_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.glb");
    let rotations = lamogen_motion::Rotations::of(&example::motion(12_000));
    write(&path, &rotations.clone().into(), &GlbOptions::default()).unwrap();
    let (clip, ..) = read_file(&path, None).unwrap();
    assert_eq!(clip.frames, 12_000);
    let gap = largest_gap(&clip, &rotations.joints());
    assert!(gap < 1e-4, "{gap}");
}

#[test]
fn the_rest_pose_is_the_t_pose_on_the_ground() {
    let clip = write_and_read(&GlbOptions::default());
    let rest = example::rotations().rest().clone();
    for node in &clip.nodes {
        match Joint::from_name(&node.name) {
            Some(Joint::Pelvis) => assert!(node.rest.distance(t_pose_on_ground(&rest)[0]) < 1e-6),
            Some(joint) => {
                let offset = DVec3::from(rest.offset(joint).map(f64::from));
                assert!(node.rest.distance(offset) < 1e-6);
            }
            None => assert_eq!(node.rest, DVec3::ZERO),
        }
    }
}

#[test]
fn buffers_may_be_in_separate_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.gltf");
    let bytes = glb::bytes(&example::rotations().into(), &GlbOptions::default()).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut json: Json = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    json["buffers"][0]["uri"] = json!("the%20numbers.bin");
    std::fs::write(&path, json.to_string()).unwrap();
    let error = read_file(&path, None).err().unwrap().to_string();
    assert!(error.contains("the numbers.bin"), "{error}");
    std::fs::write(folder.path().join("the numbers.bin"), &bytes[28 + length..]).unwrap();
    let (clip, ..) = read_file(&path, None).unwrap();
    assert!(largest_gap(&clip, &example::rotations().joints()) < 1e-4);
    // Folders, devices and pipes are not read, and no file outside the folder of the glTF file.
    for (uri, part) in [
        (".", "not a regular file"),
        ("..", "beside this one or in a folder below"),
        ("a/../../secret.bin", "beside this one or in a folder below"),
        ("%2e%2e/secret.bin", "beside this one or in a folder below"),
        ("/etc/passwd", "beside this one or in a folder below"),
    ] {
        json["buffers"][0]["uri"] = json!(uri);
        std::fs::write(&path, json.to_string()).unwrap();
        let error = read_file(&path, None).err().unwrap().to_string();
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn animations_are_chosen_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.glb");
    let options = GlbOptions {
        name: "jump".into(),
        ..GlbOptions::default()
    };
    write(&path, &example::rotations().into(), &options).unwrap();
    assert!(read_file(&path, Some("jump")).is_ok());
    let error = read_file(&path, Some("walk")).err().unwrap().to_string();
    assert!(
        error.contains("\"walk\"") && error.contains("\"jump\""),
        "{error}"
    );
}
