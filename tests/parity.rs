//! The golden cases of the PyTorch reference (docs/parity.md).

use std::path::Path;

use burn::tensor::Device;

#[test]
fn a_network_that_predicts_noise_agrees_with_the_reference() {
    agrees("tiny");
}

#[test]
fn a_network_that_predicts_motion_agrees_with_the_reference() {
    agrees("tiny_sample");
}

fn agrees(case: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
    let rows = xtask::parity::run(&folder.join(case), &Device::flex()).unwrap();
    let covered: Vec<_> = rows
        .iter()
        .filter_map(|row| Some((&row.name, row.result?)))
        .collect();
    // All that the case holds but the two rivals of the paper.
    assert_eq!(covered.len(), 15, "{covered:?}");
    for (name, result) in covered {
        assert!(result.passes(), "{name}: {result:?}");
    }
}
