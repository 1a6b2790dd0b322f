//! Guidance options that the main file of a case does not cover.
//!
//! A case may have a second file, `options.safetensors`. It has the guided pass of the same inputs with the loss divided by
//! the mean, the learning rate 0.05 and one option changed; the raw frame update with 20 iterations; and the start noise with 5
//! iterations.

use lamogen_guide::{Guidance, GuidanceVariable, Sampler, UpdateTiming};
use lamogen_laban::{GaussianKernel, LabanOptions, Smoothing};

use super::case::Case;
use super::network::Network;
use super::{ComputedValue, ComputedValues, GUIDED_TOLERANCE, ParityError};

/// Returns the options with the names of their expected values.
fn options() -> [(&'static str, Guidance); 6] {
    let fast = Guidance::fast;
    [
        (
            "out.updates_3",
            Guidance {
                updates_per_step: 3,
                ..fast()
            },
        ),
        (
            "out.lagged",
            Guidance {
                update: UpdateTiming::Lagged,
                ..fast()
            },
        ),
        (
            "out.emphasis_10",
            Guidance {
                emphasis: [10.0; 4],
                ..fast()
            },
        ),
        (
            "out.each_difference",
            Guidance {
                laban: LabanOptions {
                    smoothing: Smoothing::EachDifference(GaussianKernel::PAPER),
                    ..LabanOptions::default()
                },
                ..fast()
            },
        ),
        (
            "out.raw_update_20",
            Guidance {
                variable: GuidanceVariable::Motion { iterations: 20 },
                ..Guidance::raw_frame_update()
            },
        ),
        (
            "out.start_noise_5",
            Guidance {
                variable: GuidanceVariable::Noise { iterations: 5 },
                ..Guidance::start_noise()
            },
        ),
    ]
}

impl Network {
    /// Runs the guided pass with each of the options.
    pub(super) fn options(&self, case: &Case) -> Result<ComputedValues, ParityError> {
        let batch = self.batch(case)?;
        let baseline = case.tensor::<3>("out.baseline")?;
        let scales = vec![case.scale()?.into(); batch.lengths.len()];
        let sampler = Sampler::new(&self.model, &self.normalization, case.steps()?)?;
        options()
            .into_iter()
            .map(|(name, guidance)| {
                let baseline = baseline.clone();
                let guided = sampler.guided(&batch, baseline, &scales, &guidance, &mut ())?;
                let motions =
                    ComputedValue::of_motions(guided.motion, &batch.lengths, GUIDED_TOLERANCE);
                Ok((name, motions))
            })
            .collect()
    }
}
