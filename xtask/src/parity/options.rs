//! Guidance options that the main file of a case does not hold.
//!
//! A case may have a second file, `options.safetensors`: the guided pass of the same inputs with the
//! loss divided by the mean, learning rate 0.05, and one option changed; 20 iterations of raw frame update; and 5 of
//! start noise.

use lamogen_guide::{Guidance, GuidanceVariable, Sampler, UpdateTiming};
use lamogen_laban::{Gaussian, LabanOptions, Smoothing};

use super::case::Case;
use super::network::Network;
use super::{Actual, GUIDED, ParityError, Values};

/// Each option by the name of its expected value.
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
                    smoothing: Smoothing::EachDifference(Gaussian::PAPER),
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
    /// The guided pass with each option.
    pub(super) fn options(&self, case: &Case) -> Result<Values, ParityError> {
        let batch = self.batch(case)?;
        let baseline = case.tensor::<3>("out.baseline")?;
        let scales = vec![case.scale()?.into(); batch.lengths.len()];
        let sampler = Sampler::new(&self.model, &self.normalization, case.steps()?)?;
        options()
            .into_iter()
            .map(|(name, guidance)| {
                let baseline = baseline.clone();
                let guided = sampler.guided(&batch, baseline, &scales, &guidance, &mut ())?;
                let motions = Actual::of_motions(guided.motion, &batch.lengths, GUIDED);
                Ok((name, motions))
            })
            .collect()
    }
}
