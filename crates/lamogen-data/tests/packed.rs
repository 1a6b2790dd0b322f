//! Tests of the packed form: written, read and damaged.

mod common;

use std::collections::HashSet;
use std::path::Path;

use common::{clip, error, open, rows, write};
use lamogen_data::{Dataset, Entry, MotionVariation, PackOptions, ProblemKind, Split, pack};
use lamogen_motion::{FeatureGroup, POSE_FEATURES};
use safetensors::tensor::{Dtype, TensorView};

/// Writes a small data set in HumanML3D's form.
fn humanml3d(folder: &Path) {
    let text = "he walks left.#he/PRON walk/VERB left/ADV#0.0#0.0\nhe jumps##1.0#4.0\n";
    clip(folder, "000001", &rows(1, 120), text);
    clip(
        folder,
        "000002",
        &rows(2, 60),
        "a man sits#a/DET man/NOUN#0.0#0.0\nhe rises##1.0#3.0",
    );
    clip(
        folder,
        "M000002",
        &rows(3, 60),
        "a man sits##0.0#0.0\nhe rises##1.0#3.0",
    );
    // 000003 is too short, but its mirror image is not.
    clip(folder, "000003", &rows(4, 30), "he runs##0.0#0.0\n");
    clip(folder, "M000003", &rows(6, 50), "he runs##0.0#0.0\n");
    clip(
        folder,
        "000004",
        &rows(5, 70),
        "he turns clockwise##0.0#0.0\n",
    );
    write(
        folder,
        "train.txt",
        "000001\n000002\nM000002\n000003\nM000003",
    );
    write(folder, "val.txt", "000004");
}

fn packed(source: &Path, out: &Path, options: &PackOptions) -> Dataset {
    pack(source, out, options, &mut |_| {}).unwrap()
}

fn features(data: &Dataset, entry: &Entry) -> Vec<f32> {
    let mut features = Vec::new();
    data.features(entry, 0..entry.frames, &mut features);
    features
}

#[test]
fn what_is_packed_reads_back_and_has_mirror_images() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("source"), folder.path().join("out"));
    std::fs::create_dir(&source).unwrap();
    humanml3d(&source);
    let written = packed(&source, &out, &PackOptions::default());
    let read = open(&out);
    assert_eq!((read.mean(), read.std()), (written.mean(), written.std()));
    assert_eq!(read.mirror(), written.mirror());
    assert!(read.problems().is_empty(), "{:?}", read.problems());
    assert_eq!(written.problems().len(), 1);
    let names: Vec<&str> = read.entries().iter().map(|entry| &*entry.name).collect();
    // 000002 and its part have mirror images of their own, M000003 is one, 000004 is not for training.
    let expected =
        "000001 A_000001 000002 A_000002 M000002 MA_000002 M000003 000004 M000001 MA_000001";
    assert_eq!(names.join(" "), expected);
    // A mirror image is of the same recording as its original.
    for image in ["M000002", "MA_000002", "M000001"] {
        let entry = read.entries().iter().find(|entry| entry.name == image);
        let trial = entry.unwrap().trial.as_deref();
        assert_eq!(trial, Some(&image[image.len() - 6..]), "{image}");
    }
    for (written, read_entry) in written.entries().iter().zip(read.entries()) {
        assert_eq!(written.captions, read_entry.captions);
        assert_eq!(
            (written.split, &written.trial),
            (read_entry.split, &read_entry.trial)
        );
    }
    let (original, image) = (&read.entries()[0], &read.entries()[8]);
    assert_eq!(image.captions[0].text, "he walks right.");
    let tokens = image.captions[0].tokens.as_deref();
    assert_eq!(tokens, Some("he/PRON walk/VERB right/ADV"));
    assert!(image.mirror && image.split == Split::Train);
    let (rows, mirrored) = (features(&read, original), features(&read, image));
    let pairs = rows.as_chunks().0.iter().zip(mirrored.as_chunks().0);
    for (row, mirrored) in pairs {
        assert_eq!(read.mirror().apply(row), *mirrored);
    }
    assert_eq!(
        features(&written, &written.entries()[9]),
        features(&read, &read.entries()[9])
    );

    // A packed data set can be packed again, without rows that no entry uses.
    let again = folder.path().join("again");
    let long = PackOptions {
        min_frames: 100,
        ..PackOptions::default()
    };
    packed(&out, &again, &long);
    let names = open(&again)
        .entries()
        .iter()
        .map(|entry| entry.name.clone())
        .collect::<Vec<_>>();
    assert_eq!(names, ["000001", "M000001"]);
    let size = |folder: &Path| folder.join("motions.safetensors").metadata().unwrap().len();
    assert!(size(&again) < size(&out) / 2);

    let plain = PackOptions {
        mirror: false,
        force: true,
        ..PackOptions::default()
    };
    packed(&source, &again, &plain);
    assert_eq!(open(&again).entries().len(), 8);
}

#[test]
fn a_folder_that_is_not_free_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("source"), folder.path().join("out"));
    std::fs::create_dir(&source).unwrap();
    humanml3d(&source);
    std::fs::create_dir(&out).unwrap();
    packed(&source, &out, &PackOptions::default());
    let pack = |force: bool| {
        let options = PackOptions {
            force,
            ..PackOptions::default()
        };
        pack(&source, &out, &options, &mut |_| {}).map_err(|error| error.to_string())
    };
    assert!(pack(false).unwrap_err().contains("a packed data set"));
    assert!(pack(true).is_ok());
    write(&out, "notes.txt", "mine");
    assert!(pack(true).unwrap_err().contains("notes.txt"));
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 3);
    #[cfg(unix)]
    for name in ["motions.safetensors", "captions.jsonl"] {
        use std::os::unix::fs::PermissionsExt;
        let mode = |name: &str| out.join(name).metadata().unwrap().permissions().mode() & 0o644;
        assert_eq!(mode(name), mode("notes.txt"), "{name}");
    }
    // No temporary folder is left.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// The type, shape and bytes of a tensor.
type StoredTensor = (Dtype, Vec<usize>, Vec<u8>);
/// A function that damages the tensors, and the parts of the expected error message.
type DamageCase<'a> = (&'a dyn Fn(&mut PackedTensors), &'a [&'a str]);

/// The tensors of a packed data set, which tests damage.
struct PackedTensors {
    features: Vec<f32>,
    offsets: Vec<i32>,
    extra: Vec<(&'static str, Vec<f32>)>,
}

impl PackedTensors {
    fn new() -> PackedTensors {
        PackedTensors {
            features: rows(1, 100),
            offsets: vec![0, 60, 100],
            extra: Vec::new(),
        }
    }

    fn write(&self, folder: &Path, lines: &str) {
        let bytes = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect();
        let floats = |shape: &[usize], values: &[f32]| (Dtype::F32, shape.to_vec(), bytes(values));
        let wide = [self.features.len() / POSE_FEATURES, POSE_FEATURES];
        let mut tensors: Vec<(&str, StoredTensor)> =
            vec![("features", floats(&wide, &self.features))];
        let offsets = self.offsets.iter().flat_map(|x| x.to_le_bytes()).collect();
        tensors.push(("offsets", (Dtype::I32, vec![self.offsets.len()], offsets)));
        for (name, values) in &self.extra {
            tensors.push((name, floats(&[values.len()], values)));
        }
        let views = { tensors.iter() }.map(|(name, (dtype, shape, bytes))| {
            (
                *name,
                TensorView::new(*dtype, shape.clone(), bytes).unwrap(),
            )
        });
        let path = folder.join("motions.safetensors");
        safetensors::serialize_to_file(views, None, &path).unwrap();
        write(folder, "captions.jsonl", lines);
    }
}

const LINE: &str = r#"{"name": "a", "split": "train", "clip": 0, "start": 0, "frames": 60, "captions": ["x"], "more": 1}"#;

#[test]
fn numbers_of_32_bits_and_missing_statistics_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let tensors = PackedTensors::new();
    let image = LINE
        .replace("\"a\"", "\"b\"")
        .replace("\"captions\"", "\"mirror\": true, \"captions\"");
    tensors.write(folder, &format!("{LINE}\n\n{image}\n"));
    let data = open(folder);
    let found = features(&data, &data.entries()[0]);
    for (found, expected) in found.iter().zip(&tensors.features) {
        assert!((found - expected).abs() < 1e-3);
    }
    // Over a motion and its mirror image, features that change their sign have the mean 0.
    for feature in [0, 1, 193] {
        assert!(data.mean()[feature].abs() < 1e-6, "{feature}");
    }
    let rotations = FeatureGroup::Rotations.range();
    assert!(
        data.std()[rotations]
            .windows(2)
            .all(|pair| pair[0] == pair[1])
    );
}

#[test]
fn invalid_lines_are_left_out_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut tensors = PackedTensors::new();
    tensors.features[70 * POSE_FEATURES + 1] = f32::NAN;
    let cases = [
        (
            "\"frames\": 60",
            "\"frames\": 61",
            ProblemKind::Line,
            "within 0..60",
        ),
        (
            "\"frames\": 60",
            "\"frames\": 18446744073709551615",
            ProblemKind::Line,
            "within",
        ),
        (
            "\"clip\": 0",
            "\"clip\": 2",
            ProblemKind::Line,
            "one of 2 clips",
        ),
        (
            "\"start\": 0",
            "\"start\": 60",
            ProblemKind::Line,
            "found 60 rows from 60",
        ),
        (
            "\"frames\": 60",
            "\"frames\": 39",
            ProblemKind::TooShort,
            "found 39",
        ),
        ("[\"x\"]", "[]", ProblemKind::NoCaption, "none"),
        ("[\"x\"]", "[\" \"]", ProblemKind::Line, "empty"),
        (
            "\"more\"",
            "\"tokens\": [\"x/X\", null], \"more\"",
            ProblemKind::Line,
            "1 captions, found 2",
        ),
        ("train", "dev", ProblemKind::Line, "dev"),
        ("\"split\"", "\"spilt\"", ProblemKind::Line, "split"),
        ("}", "", ProblemKind::Line, "EOF"),
        (
            "\"clip\": 0, \"start\": 0, \"frames\": 60",
            "\"clip\": 1, \"start\": 60, \"frames\": 40",
            ProblemKind::NotFinite,
            "frame 10, feature 1",
        ),
        ("x", "x", ProblemKind::Twice, "same name"),
    ];
    let lines = cases.iter().enumerate().map(|(i, (from, to, kind, _))| {
        assert!(LINE.contains(from), "{from}");
        let line = LINE.replace(from, to);
        match kind {
            ProblemKind::Twice => line,
            _ => line.replace("\"a\"", &format!("\"a{i}\"")),
        }
    });
    let text: Vec<String> = [LINE.to_owned()].into_iter().chain(lines).collect();
    tensors.write(folder, &text.join("\n"));
    let data = open(folder);
    assert_eq!(data.entries().len(), 1);
    assert_eq!(data.problems().len(), cases.len());
    for (problem, (_, to, kind, part)) in data.problems().iter().zip(cases) {
        assert_eq!(problem.kind, kind, "{to}: {problem:?}");
        assert!(problem.reason.contains(part), "{to}: {problem:?}");
    }
}

#[test]
fn damaged_files_are_errors_that_name_the_tensor() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let full = |value: f32| vec![value; POSE_FEATURES];
    let cases: [DamageCase; 7] = [
        (&|t| t.offsets[2] = 99, &["`offsets`", "0 to 100"]),
        (&|t| t.offsets[1] = 101, &["`offsets`", "101 before 100"]),
        (&|t| t.offsets.clear(), &["`offsets`"]),
        (&|t| t.extra = vec![("mean", full(0.0))], &["`std`", "both"]),
        (
            &|t| t.extra = vec![("mean", full(0.0)), ("std", full(0.0))],
            &["`std`", "root yaw", "above 0"],
        ),
        (
            &|t| t.extra = vec![("mean", vec![0.0]), ("std", full(1.0))],
            &["`mean`", "[263]", "[1]"],
        ),
        (
            &|t| t.extra = vec![("mirror_perm", full(0.0)), ("mirror_sign", full(1.0))],
            &["`mirror_perm`", "I32"],
        ),
    ];
    for (damage, parts) in cases {
        let mut tensors = PackedTensors::new();
        damage(&mut tensors);
        tensors.write(folder, LINE);
        let message = error(folder);
        for part in parts {
            assert!(message.contains(part), "{part}: {message}");
        }
    }
    PackedTensors::new().write(folder, LINE);
    let path = folder.join("motions.safetensors");
    let whole = std::fs::read(&path).unwrap();
    for end in [0, 5, 20, whole.len() - 1] {
        std::fs::write(&path, &whole[..end]).unwrap();
        assert!(error(folder).contains("the file ends within"), "{end}");
    }
    std::fs::write(&path, [&8u64.to_le_bytes()[..], b"no json!"].concat()).unwrap();
    assert!(error(folder).contains("no safetensors"));
}

#[test]
fn several_data_sets_become_one() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other, out] = ["one", "other", "out"].map(|name| folder.path().join(name));
    for source in [&one, &other] {
        std::fs::create_dir(source).unwrap();
        humanml3d(source);
    }
    let options = PackOptions::default();
    let single = packed(&one, &folder.path().join("single"), &options);
    let joined = lamogen_data::pack_all(&[&one, &other], &out, &options, &mut |_| {}).unwrap();
    assert_eq!(joined.entries().len(), 2 * single.entries().len());
    let read = open(&out);
    let by_name = |name: &str| {
        let mut entries = read.entries().iter();
        entries.find(|entry| entry.name == name).unwrap()
    };
    for entry in single.entries() {
        let renamed = match entry.name.strip_prefix('M').filter(|_| entry.mirror) {
            Some(name) => format!("Mother_{name}"),
            None => format!("other_{}", entry.name),
        };
        let second = by_name(&renamed);
        assert_eq!(second.captions, entry.captions);
        assert_ne!(second.clip(), by_name(&entry.name).clip());
        for copy in [by_name(&entry.name), second] {
            assert_eq!(features(&read, copy), features(&single, entry));
        }
    }
    // The statistics are those of all entries, including mirror images.
    for (found, expected) in read.mean().iter().zip(joined.mean()) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
    let files = folder.path().join("files");
    std::fs::create_dir(&files).unwrap();
    std::fs::write(files.join("a.bvh"), "HIERARCHY").unwrap();
    let refused = lamogen_data::pack_all(
        &[&one, &files],
        folder.path().join("no"),
        &options,
        &mut |_| {},
    );
    assert!(refused.unwrap_err().to_string().contains("files"));
}

#[test]
fn further_captions_reach_motions_and_their_mirror_images() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["source", "out"].map(|name| folder.path().join(name));
    std::fs::create_dir(&source).unwrap();
    humanml3d(&source);
    write(
        folder.path(),
        "more.jsonl",
        "{\"name\": \"000001\", \"captions\": [\"go left\", \"a boy goes\"]}\n{\"name\": \"000003\", \"captions\": [\"x\"]}\n\
         {\"name\": \"zorb\", \"captions\": [\"x\"]}\n",
    );
    let options = PackOptions {
        more_captions: Some(folder.path().join("more.jsonl")),
        ..PackOptions::default()
    };
    let data = packed(&source, &out, &options);
    let captions_of = |name: &str| -> Vec<String> {
        let entry = data.entries().iter().find(|entry| entry.name == name);
        let captions = entry.unwrap().captions.iter();
        captions.map(|caption| caption.text.clone()).collect()
    };
    assert_eq!(
        captions_of("000001"),
        ["he walks left.", "go left", "a boy goes"]
    );
    assert_eq!(
        captions_of("M000001"),
        ["he walks right.", "go right", "a boy goes"]
    );
    // Only a motion that does not exist is missing; the third motion is listed as too short.
    let missing = { data.problems().iter() }
        .filter(|problem| problem.kind == ProblemKind::Missing)
        .map(|problem| &*problem.name);
    assert_eq!(missing.collect::<Vec<_>>(), ["zorb"]);
    assert_eq!(open(&out).entries(), data.entries());

    write(
        folder.path(),
        "more.jsonl",
        "{\"name\": \"zorb\", \"captions\": [\"x\"]}\n",
    );
    let again = folder.path().join("again");
    let failed = pack(&source, &again, &options, &mut |_| {}).unwrap_err();
    assert!(failed.to_string().contains("none of these"), "{failed}");
    assert!(!again.exists());
}

#[test]
fn variations_are_entries_of_their_own_and_do_not_count_in_the_statistics() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out, varied] = ["source", "out", "varied"].map(|name| folder.path().join(name));
    std::fs::create_dir(&source).unwrap();
    humanml3d(&source);
    let data = packed(&source, &out, &PackOptions::default());
    let of = |value: f32| MotionVariation {
        entry: 0,
        rows: vec![[value; POSE_FEATURES]; data.entries()[0].frames],
        note: "Weight times 2".into(),
    };
    let with = data.clone().with_variations([of(2.0), of(1e30), of(3.0)]);
    let names = with.entries()[data.entries().len()..].iter();
    let names: Vec<&str> = names.map(|entry| &*entry.name).collect();
    // The second has numbers beyond 16 bits. Another entry is a part of the original and gets no variation.
    assert_eq!(names, ["000001~1", "M000001~1", "000001~3", "M000001~3"]);
    let left_out = with.problems().iter().last().unwrap();
    assert_eq!(
        (&*left_out.name, left_out.kind),
        ("000001~2", ProblemKind::NotFinite)
    );
    with.save(&varied, false).unwrap();
    let read = open(&varied);
    assert_eq!(read.entries().len(), with.entries().len());
    let found = { read.entries().iter() }
        .find(|entry| entry.name == "M000001~3")
        .unwrap();
    assert_eq!(found.variation_of.as_deref(), Some("M000001"));
    assert_eq!(found.note.as_deref(), Some("Weight times 2"));
    assert!(found.mirror && found.split == Split::Train && found.captions.len() == 1);
    let sign = read.mirror().sign();
    assert_eq!(
        features(&read, found)[..POSE_FEATURES],
        sign.map(|sign| 3.0 * sign)
    );
    assert_eq!((read.mean(), read.std()), (data.mean(), data.std()));
    // Computed again, the statistics are still those of the originals.
    let [with, without] = [read, data].map(|data| Dataset::join(vec![data]).unwrap());
    assert_eq!((with.mean(), with.std()), (without.mean(), without.std()));
}

#[test]
fn data_sets_with_the_same_names_are_joined_and_variations_keep_their_originals() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out, varied] = ["source", "out", "varied"].map(|name| folder.path().join(name));
    std::fs::create_dir(&source).unwrap();
    humanml3d(&source);
    let data = packed(&source, &out, &PackOptions::default());
    let variation = MotionVariation {
        entry: 0,
        rows: vec![[2.0; POSE_FEATURES]; data.entries()[0].frames],
        note: "Weight times 2".into(),
    };
    data.with_variations([variation])
        .save(&varied, false)
        .unwrap();
    // Three data sets whose folders and entries have the same names.
    let joined = Dataset::join(vec![open(&varied), open(&varied), open(&varied)]).unwrap();
    let names: HashSet<&str> = joined.entries().iter().map(|e| &*e.name).collect();
    assert_eq!(names.len(), joined.entries().len());
    assert!(names.contains("varied_000001~1") && names.contains("Mvaried2_000001~1"));
    for entry in joined.entries() {
        let original = entry.variation_of.as_deref();
        assert!(
            original.is_none_or(|original| names.contains(original)),
            "{}",
            entry.name
        );
        if entry.name == "varied2_000001~1" {
            assert_eq!(original, Some("varied2_000001"));
        }
    }
    // Recordings of different data sets are different ones.
    let trials: HashSet<&str> = { joined.entries().iter() }
        .filter_map(|entry| entry.trial.as_deref())
        .collect();
    let alone = open(&varied);
    let own: HashSet<String> = { alone.entries().iter() }
        .filter_map(|entry| entry.trial.clone())
        .collect();
    assert_eq!(trials.len(), 3 * own.len());
}

#[test]
fn a_part_that_is_the_whole_clip_is_copied_once() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source");
    std::fs::create_dir(&source).unwrap();
    let texts = "somebody swings the arms##0.0#0.0\nthe arms swing##0.0#4.0\n\
                 the arms swing quickly##0.0#4.0\n";
    clip(&source, "000001", &swinging(80, false), texts);
    write(&source, "train.txt", "000001");
    let data = packed(&source, &folder.path().join("out"), &PackOptions::default());
    let names: Vec<&str> = data.entries().iter().map(|e| &*e.name).collect();
    assert!(names.contains(&"A_000001"), "{names:?}");
    let copies = data
        .clone()
        .with_speeds(&[0.8], &lamogen_data::LoadOptions::default());
    let copied = copies.entries()[data.entries().len()..].iter();
    let copied: Vec<&str> = copied.map(|entry| &*entry.name).collect();
    let distinct: HashSet<&&str> = copied.iter().collect();
    assert_eq!(distinct.len(), copied.len(), "{copied:?}");
    assert!(copied.contains(&"000001@0.8"), "{copied:?}");
    for entry in &copies.entries()[data.entries().len()..] {
        assert!(
            !entry.captions[0].text.contains("quickly"),
            "{}",
            entry.name
        );
    }

    let of = |entry: usize| MotionVariation {
        entry,
        rows: vec![[2.0; POSE_FEATURES]; data.entries()[entry].frames],
        note: "Weight times 2".into(),
    };
    let same_rows: Vec<usize> = (0..data.entries().len())
        .filter(|&place| {
            let entry = &data.entries()[place];
            !entry.mirror && entry.frames == data.entries()[0].frames
        })
        .collect();
    assert!(same_rows.len() > 1, "{names:?}");
    let with = data.clone().with_variations(same_rows.into_iter().map(of));
    let all: HashSet<&str> = with.entries().iter().map(|e| &*e.name).collect();
    assert_eq!(all.len(), with.entries().len());
}

/// Returns HumanML3D's rows of somebody who stands on both feet and swings the arms.
fn swinging(frames: usize, off_the_ground: bool) -> Vec<f32> {
    use lamogen_motion::{FRAMES_PER_SECOND, JOINTS, Joint, RestPose, Rotations, encode_canonical};
    let pose = |frame: usize| {
        let mut local = [[0.0, 0.0, 0.0, 1.0]; JOINTS];
        let half = 0.6 * (0.3 * frame as f32).sin();
        for joint in [Joint::LeftShoulder, Joint::RightShoulder] {
            local[joint.index()] = [0.0, 0.0, half.sin(), half.cos()];
        }
        local
    };
    let rest = RestPose::humanml3d();
    let height = |frame: usize| match off_the_ground && (20..30).contains(&frame) {
        true => 1.2 + 0.1 * (frame - 20) as f32,
        false => 1.0,
    };
    let root = (0..=frames)
        .map(|frame| [0.0, height(frame), 0.0])
        .collect();
    let local = (0..=frames).map(pose).collect();
    let joints = Rotations::new(rest, root, local, FRAMES_PER_SECOND).joints();
    encode_canonical(&joints).as_flattened().to_vec()
}

#[test]
fn motions_become_faster_and_slower_but_for_those_that_gravity_or_words_time() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["source", "out"].map(|name| folder.path().join(name));
    std::fs::create_dir(&source).unwrap();
    for (name, rows, text) in [
        ("000001", swinging(100, false), "he swings##0.0#0.0"),
        ("000002", swinging(100, true), "he swings##0.0#0.0"),
        ("000003", swinging(100, false), "he swings quickly##0.0#0.0"),
        ("000004", swinging(45, false), "he swings##0.0#0.0"),
        ("000005", swinging(60, false), "he swings##0.0#0.0"),
    ] {
        clip(&source, name, &rows, text);
    }
    write(&source, "train.txt", "000001\n000002\n000003\n000004");
    write(&source, "val.txt", "000005");
    let options = PackOptions {
        speeds: vec![0.8, 1.25],
        ..PackOptions::default()
    };
    let data = packed(&source, &out, &options);
    let names: Vec<&str> = { data.entries().iter() }
        .map(|entry| &*entry.name)
        .filter(|name| name.contains('@'))
        .collect();
    // 45 frames at speed 1.25 would be fewer than 40.
    let expected = [
        "000001@0.8",
        "M000001@0.8",
        "000001@1.25",
        "M000001@1.25",
        "000004@0.8",
        "M000004@0.8",
    ];
    assert_eq!(names, expected);
    let of = |name: &str| {
        data.entries()
            .iter()
            .find(|entry| entry.name == name)
            .unwrap()
    };
    let [own, slow, fast] = ["000001", "000001@0.8", "000001@1.25"].map(of);
    assert_eq!((own.frames, slow.frames, fast.frames), (100, 125, 80));
    assert_eq!(slow.captions, own.captions);
    // The same pose comes later: frame 40 of the original is frame 50 of the slow copy.
    let row = |entry, frame| {
        let rows = features(&data, entry);
        rows[frame * POSE_FEATURES..][4..67].to_vec()
    };
    let apart = |a: Vec<f32>, b: Vec<f32>| {
        let pairs = a.into_iter().zip(b);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(apart(row(own, 40), row(slow, 50)) < 0.01);
    assert!(apart(row(own, 40), row(fast, 32)) < 0.01);
    assert!(apart(row(own, 40), row(own, 50)) > 0.1);
}
