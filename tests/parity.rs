//! The golden cases of the PyTorch reference (docs/parity.md).

use std::path::Path;

use burn::tensor::Device;
use xtask::parity::{Comparison, run};

/// What a case holds.
const COVERED: usize = 17;
/// What `options.safetensors` holds.
const OPTIONS: usize = 6;

#[test]
fn a_network_that_predicts_motion_agrees_with_the_reference() {
    let results = results("tiny_sample");
    assert_eq!(results.len(), COVERED + OPTIONS, "{results:?}");
    for (name, result) in results {
        // A hundred updates that are as long for the smallest gradients as for the largest: on another number of threads the reference
        // itself is 8e-2 away. Twenty of them, `out.raw_update_20`, are held strictly.
        let is_excused =
            name == "out.raw_update" && result.is_within_rounding() && result.error < 0.2;
        assert!(
            result.is_within_tolerance() || is_excused,
            "{name}: {result:?}"
        );
    }
}

#[test]
fn a_network_that_predicts_noise_agrees_with_the_reference() {
    let results = results("tiny");
    assert_eq!(results.len(), COVERED, "{results:?}");
    for (name, result) in results {
        // Behind the amplified first step the reference differs from itself by up to 7e-3 from one
        // CPU to the next, and rounding moves these values by up to 4e-2 (docs/parity.md); nothing else
        // is excused.
        let magnified = [
            "out.e_grad",
            "out.trace_loss",
            "out.trace_e",
            "out.guided_mean",
        ];
        let is_excused =
            magnified.contains(&&*name) && result.is_within_rounding() && result.error < 5e-2;
        assert!(
            result.is_within_tolerance() || is_excused,
            "{name}: {result:?}"
        );
    }
}

fn results(case: &str) -> Vec<(String, Comparison)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
    let rows = run(&folder.join(case), &Device::flex(), &mut |_| {}).unwrap();
    rows.into_iter()
        .filter_map(|row| Some((row.name, row.result?)))
        .collect()
}
