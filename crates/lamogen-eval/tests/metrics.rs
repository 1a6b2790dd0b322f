//! Tests of the metrics against values that numpy and scipy computed (`tests/golden/metrics/make.py`).

use std::path::Path;

use lamogen_eval::{
    ChangeMatrix, ControlRange, Embeddings, Gaussian, MatchingScore, diversity, fid,
};
use serde::Deserialize;

#[derive(Deserialize)]
struct Cases {
    fid: Vec<FidCase>,
    matching: MatchingCase,
    control: ControlCase,
}

#[derive(Deserialize)]
struct ControlCase {
    small: [Vec<[f64; 4]>; 4],
    large: [Vec<[f64; 4]>; 4],
    mean: [[f64; 4]; 4],
    std: [[f64; 4]; 4],
    diagonality: f64,
}

#[derive(Deserialize)]
struct FidCase {
    name: String,
    width: usize,
    a: Vec<f32>,
    b: Vec<f32>,
    fid: f64,
}

#[derive(Deserialize)]
struct MatchingCase {
    width: usize,
    texts: Vec<f32>,
    motions: Vec<f32>,
    r_precision: [f64; 3],
    distance: f64,
}

fn cases() -> Cases {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/metrics/cases.json");
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn sets(case: &FidCase) -> [Embeddings; 2] {
    [&case.a, &case.b].map(|values| Embeddings::new(values.clone(), case.width).unwrap())
}

#[test]
fn fid_is_scipys_and_holds_for_singular_covariances() {
    for case in cases().fid {
        let [a, b] = sets(&case);
        for found in [fid(&a, &b).unwrap(), fid(&b, &a).unwrap()] {
            let error = (found - case.fid).abs() / case.fid;
            assert!(error < 1e-9, "{}: {found} is not {}", case.name, case.fid);
        }
    }
}

#[test]
fn equal_sets_have_no_distance_and_a_shift_is_its_square() {
    for case in cases().fid {
        let [a, _] = sets(&case);
        assert!(fid(&a, &a).unwrap() < 1e-9, "{}", case.name);
        // The second set is moved by 0.5 along each axis; 0.5 and the values are exact in 32 bits to 1e-7.
        let moved = case.a.iter().map(|value| value + 0.5).collect();
        let moved = Embeddings::new(moved, case.width).unwrap();
        let expected = 0.25 * case.width as f64;
        let found = fid(&a, &moved).unwrap();
        assert!((found - expected).abs() < 1e-5, "{}: {found}", case.name);
    }
}

#[test]
fn r_precision_and_matching_score_are_numpys() {
    let case = cases().matching;
    let texts = Embeddings::new(case.texts, case.width).unwrap();
    let motions = Embeddings::new(case.motions, case.width).unwrap();
    let batch: Vec<usize> = (0..texts.len()).collect();
    let found = MatchingScore::of(&texts, &motions, &[batch]).unwrap();
    assert_eq!(found.r_precision, case.r_precision);
    assert!((found.distance - case.distance).abs() < 1e-9);
}

#[test]
fn the_change_matrix_and_its_diagonality_are_numpys() {
    let case = cases().control;
    let rows: Vec<Vec<ControlRange>> = { case.small.iter().zip(&case.large) }
        .map(|(small, large)| {
            let pairs = small.iter().zip(large);
            pairs
                .map(|(&small, &large)| ControlRange { small, large })
                .collect()
        })
        .collect();
    let found = ChangeMatrix::of([0, 1, 2, 3].map(|row| &rows[row][..])).unwrap();
    let near = |found: [[f64; 4]; 4], expected: [[f64; 4]; 4]| {
        let mut pairs = found.iter().flatten().zip(expected.iter().flatten());
        pairs.all(|(a, b)| (a - b).abs() < 1e-12)
    };
    assert!(near(found.mean, case.mean) && near(found.std, case.std));
    assert!((found.diagonality() - case.diagonality).abs() < 1e-12);
}

#[test]
fn sets_of_different_widths_are_refused() {
    let narrow = Embeddings::new(vec![0.0, 1.0, 2.0, 4.0], 1).unwrap();
    let wide = Embeddings::new(vec![0.0, 1.0, 2.0, 4.0], 2).unwrap();
    let message = fid(&narrow, &wide).unwrap_err().to_string();
    assert_eq!(message, "expected embeddings of a width of 1, found 2");
    let one = Embeddings::new(vec![0.0], 1).unwrap();
    let message = Gaussian::of(&one).unwrap_err().to_string();
    assert_eq!(
        message,
        "FID needs at least 2 embeddings in each set, found 1"
    );
    assert!(diversity(&wide, 0, 1).is_err());
}
