//! Tests of reading HumanML3D's folder, complete and damaged.

mod common;

use common::{clip, error, open, rows, write};
use lamogen_data::{BenchmarkSplit, Dataset, LoadOptions, ProblemKind, Progress, Split};
use lamogen_motion::{FeatureGroup, POSE_FEATURES, npy};

const TEXT: &str = "a person walks.#a/DET person/NOUN walk/VERB#0.0#0.0\n";

#[test]
fn clips_have_their_captions_splits_and_rows() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let first = rows(1, 120);
    let text = "he walks left.#he/PRON walk/VERB left/ADV#0.0#0.0\n\
                a man goes#a/DET man/NOUN go/VERB#nan#nan\n\
                he jumps#he/PRON jump/VERB#2.0#5.0\n\
                he waits##0.5#1.0\n";
    clip(folder, "000001", &first, text);
    clip(folder, "M000001", &rows(2, 40), TEXT);
    clip(folder, "000002", &rows(3, 199), TEXT);
    write(folder, "train.txt", "000001\r\nM000001\n\n");
    write(folder, "test.txt", "\u{feff}000002\n");
    write(folder, "all.txt", "000001\n000002\n000003\n");
    let mut progress_calls = Vec::new();
    let observer = &mut |progress: Progress| progress_calls.push(progress);
    let data = Dataset::open(folder, &LoadOptions::default(), observer).unwrap();
    assert_eq!(progress_calls.last(), Some(&Progress { done: 3, all: 3 }));

    let names: Vec<&str> = data.entries().iter().map(|entry| &*entry.name).collect();
    assert_eq!(names, ["000001", "A_000001", "M000001", "000002"]);
    assert_eq!(data.split(Split::Train).count(), 3);
    assert_eq!(data.indices(Split::Test).collect::<Vec<_>>(), [3]);
    let [whole, part, ..] = data.entries() else {
        unreachable!()
    };
    assert_eq!((whole.frames, whole.captions.len()), (120, 2));
    let tokens = whole.captions[0].tokens.as_deref();
    assert_eq!(tokens, Some("he/PRON walk/VERB left/ADV"));
    assert_eq!((part.frames, &*part.captions[0].text), (60, "he jumps"));

    // The part begins at frame 40; 16-bit numbers are right to one part in two thousand.
    let mut found = vec![7.0];
    data.features(part, 10..12, &mut found);
    assert_eq!(found.len(), 1 + 2 * POSE_FEATURES);
    for (found, expected) in found[1..].iter().zip(&first[50 * POSE_FEATURES..]) {
        assert!((found - expected).abs() <= expected.abs() / 2048.0 + 1e-7);
    }

    // The part of half a second is too short to be a motion of its own.
    assert_eq!(
        data.problems().counts(),
        [(ProblemKind::TooShort, 1)].into()
    );
    assert_eq!(data.problems().broken().count(), 0);
    let reason = &data.problems().iter().next().unwrap().reason;
    assert!(
        reason.contains("he waits") && reason.contains("found 10"),
        "{reason}"
    );
}

#[test]
fn what_is_broken_is_named_with_its_reason_and_the_rest_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let good = rows(1, 50);
    let mut broken = good.clone();
    broken[3 * POSE_FEATURES + 5] = f32::NAN;
    let mut large = good.clone();
    large[7] = 1e6;
    clip(folder, "good", &good, TEXT);
    clip(folder, "nan", &broken, TEXT);
    clip(folder, "large", &large, TEXT);
    clip(folder, "short", &rows(2, 39), TEXT);
    clip(folder, "long", &rows(3, 200), TEXT);
    clip(folder, "line", &good, "a person walks\n");
    clip(folder, "empty", &good, "\n");
    clip(folder, "textless", &good, TEXT);
    std::fs::remove_file(folder.join("texts/textless.txt")).unwrap();
    clip(folder, "latin", &good, TEXT);
    std::fs::write(folder.join("texts/latin.txt"), b"\xe9#a#0#0").unwrap();
    clip(folder, "cut", &good, TEXT);
    std::fs::write(folder.join("new_joint_vecs/cut.npy"), b"\x93NUMPY").unwrap();
    clip(folder, "narrow", &good, TEXT);
    npy::write(
        folder.join("new_joint_vecs/narrow.npy"),
        &[0.0; 251 * 50],
        &[50, 251],
    )
    .unwrap();
    let names = "good nan large short long line empty textless latin cut narrow missing good";
    write(folder, "train.txt", &names.replace(' ', "\n"));
    write(folder, "val.txt", "good");

    let data = open(folder);
    assert_eq!(data.entries().len(), 1);
    let problems = data.problems();
    for (name, kind, part) in [
        ("nan", ProblemKind::NotFinite, "frame 3, feature 5"),
        ("large", ProblemKind::NotFinite, "1000000"),
        (
            "short",
            ProblemKind::TooShort,
            "at least 40 frames, found 39",
        ),
        (
            "long",
            ProblemKind::TooLong,
            "at most 199 frames, found 200",
        ),
        ("line", ProblemKind::Line, "line.txt, line 1"),
        ("empty", ProblemKind::NoCaption, "empty.txt"),
        ("textless", ProblemKind::NoCaption, "textless.txt"),
        ("latin", ProblemKind::Unreadable, "latin.txt"),
        ("cut", ProblemKind::Unreadable, "cut.npy"),
        ("narrow", ProblemKind::Shape, "[50, 251]"),
        ("missing", ProblemKind::Missing, "missing.npy"),
        ("good", ProblemKind::Twice, "val.txt"),
    ] {
        let found =
            { problems.iter() }.find(|problem| problem.name == name && problem.kind == kind);
        let found = found.unwrap_or_else(|| panic!("{name} is not reported as {kind}"));
        assert!(
            found.reason.contains(part) || kind == ProblemKind::Twice,
            "{found:?}"
        );
    }
    assert_eq!(problems.count(ProblemKind::Twice), 2);
    assert_eq!((problems.len(), problems.broken().count()), (13, 11));

    write(folder, "train.txt", "nan\nshort");
    write(folder, "val.txt", "");
    let message = error(folder);
    for part in [
        "at least one motion",
        "1 too short",
        "1 not finite",
        "frame 3",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn statistics_are_those_of_the_folder_or_of_the_training_split() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (train, test) = (rows(1, 90), rows(2, 60));
    clip(folder, "a", &train, TEXT);
    clip(folder, "b", &test, TEXT);
    write(folder, "train.txt", "a");
    write(folder, "test.txt", "b");
    let data = open(folder);
    let column = |feature: usize| train.iter().skip(feature).step_by(POSE_FEATURES);
    let deviation = |feature: usize| {
        let mean = column(feature).sum::<f32>() / 90.0;
        (column(feature).map(|x| (x - mean).powi(2)).sum::<f32>() / 90.0).sqrt()
    };
    for group in FeatureGroup::ALL {
        let expected = group.range().map(deviation).sum::<f32>() / group.width() as f32;
        for feature in group.range() {
            assert!((data.std()[feature] - expected).abs() < 1e-4, "{feature}");
            let mean = column(feature).sum::<f32>() / 90.0;
            assert!((data.mean()[feature] - mean).abs() < 1e-4, "{feature}");
        }
    }
    let mut normalized = Vec::new();
    data.normalized(&data.entries()[0], 2..3, &mut normalized);
    let expected = (train[2 * POSE_FEATURES + 9] - data.mean()[9]) / data.std()[9];
    assert!((normalized[9] - expected).abs() < 2e-3);

    let mean: Vec<f32> = (0..POSE_FEATURES).map(|i| i as f32).collect();
    npy::write(folder.join("Mean.npy"), &mean, &[POSE_FEATURES]).unwrap();
    let message = error(folder);
    assert!(message.contains("Std.npy"), "{message}");
    npy::write(
        folder.join("Std.npy"),
        &[2.0; POSE_FEATURES],
        &[POSE_FEATURES],
    )
    .unwrap();
    let data = open(folder);
    assert_eq!((data.mean(), data.std()[262]), (&mean[..], 2.0));
    npy::write(
        folder.join("Std.npy"),
        &[0.0; POSE_FEATURES],
        &[POSE_FEATURES],
    )
    .unwrap();
    let message = error(folder);
    assert!(
        message.contains("above 0 for feature 0 (root yaw)"),
        "{message}"
    );
}

#[test]
fn without_training_motions_there_are_no_statistics_and_unchanging_features_have_deviation_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    clip(folder, "a", &rows(1, 90), TEXT);
    write(folder, "test.txt", "a");
    assert!(error(folder).contains("no motion is for training"));
    clip(folder, "a", &vec![0.5; 90 * POSE_FEATURES], TEXT);
    std::fs::rename(folder.join("test.txt"), folder.join("train.txt")).unwrap();
    let data = open(folder);
    assert_eq!(data.unchanging().count(), FeatureGroup::ALL.len());
    let mut normalized = Vec::new();
    data.normalized(&data.entries()[0], 3..5, &mut normalized);
    assert_eq!(normalized, [0.0; 2 * POSE_FEATURES]);
}

#[test]
fn the_error_for_a_folder_of_no_form_names_the_expected_files() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let message = error(folder);
    for part in [
        "captions.jsonl",
        "new_joint_vecs",
        "train.txt",
        "none of these",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
    clip(folder, "a", &rows(1, 90), TEXT);
    assert!(error(folder).contains("found only new_joint_vecs, texts"));
    assert!(error(&folder.join("lost")).contains("lost"));
    let none = LoadOptions {
        min_frames: 50,
        max_frames: 40,
    };
    let message = Dataset::open(folder, &none, &mut |_| {}).unwrap_err();
    assert!(message.to_string().contains("50 and 40"), "{message}");
}

#[test]
fn a_benchmark_counts_recordings_and_parts_as_the_public_evaluation_does() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let whole = "a person walks.#a/DET person/NOUN walk/VERB#0.0#0.0\n";
    let part = |start: f32, end: f32| format!("he turns#he/PRON turn/VERB#{start:?}#{end:?}\n");
    // The shortest and the longest recording there may be, and those that are one frame off.
    clip(folder, "short", &rows(1, 39), whole);
    clip(folder, "least", &rows(2, 40), whole);
    clip(folder, "most", &rows(3, 199), whole);
    // A recording that is too long is left out with its parts.
    clip(
        folder,
        "long",
        &rows(4, 200),
        &(whole.to_owned() + &part(1.0, 5.0)),
    );
    // Parts: of 60 frames, of 39 frames, past the end (120 of 130 frames), and the end before the start.
    let parts = [
        part(2.0, 5.0),
        part(2.0, 3.99),
        part(0.5, 9.0),
        part(5.0, 2.0),
    ]
    .concat();
    clip(folder, "parts", &rows(5, 130), &(parts + whole));
    // Only parts: the recording itself is none.
    clip(folder, "M000007", &rows(6, 100), &part(0.0, 2.0));
    // A line that cannot be read ends its recording, but the part before stays.
    let broken = whole.to_owned() + &part(0.0, 3.0) + "he # waves#he/PRON wave/VERB#0.0#0.0\n";
    clip(folder, "broken", &rows(7, 80), &broken);
    clip(folder, "mute", &rows(8, 80), "");
    write(
        folder,
        "test.txt",
        "short\nleast\nmost\nlong\nparts\nM000007\nbroken\nmute\nmissing\nmost\n",
    );
    let mut last = None;
    let split = BenchmarkSplit::open(folder, Split::Test, &mut |p| last = Some(p)).unwrap();
    assert_eq!(last, Some(Progress { done: 9, all: 9 }));
    let found: Vec<(&str, usize, usize)> = { split.clips().iter() }
        .map(|clip| (&*clip.name, clip.frames(), clip.captions.len()))
        .collect();
    let expected = [
        ("least", 40, 1),
        ("A_M000007", 40, 1),
        ("A_parts", 60, 1),
        ("A_broken", 60, 1),
        ("B_parts", 120, 1),
        ("parts", 130, 1),
        ("most", 199, 1),
    ];
    assert_eq!(found, expected);
    assert_eq!(split.listed(), 9);
    let counts: Vec<_> = split.problems().counts().into_iter().collect();
    let expected = [
        (ProblemKind::TooShort, 3),
        (ProblemKind::TooLong, 1),
        (ProblemKind::Missing, 1),
        (ProblemKind::NoCaption, 1),
        (ProblemKind::Line, 1),
        (ProblemKind::Twice, 1),
    ];
    assert_eq!(counts, expected);
    // Rows are those of the file, to the last bit.
    let original = rows(5, 130);
    assert_eq!(
        split.clips()[2].features,
        original[40 * POSE_FEATURES..100 * POSE_FEATURES]
    );
    let error = BenchmarkSplit::open(folder, Split::Validation, &mut |_| ()).unwrap_err();
    assert!(error.to_string().contains("val.txt"), "{error}");
}
