//! The frames that a request asks for, of a motion that was generated with known frames around them.

use std::ops::Range;

use burn::tensor::Device;
use lamogen_laban::{Goals, LabanOptions, LabanSeries};
use lamogen_motion::Motion;

use crate::generation::{Generation, NetworkMotions, PartLaban, TermValues};
use crate::neighbours::{KnownStart, KnownStarts};

/// What is kept of a generated motion, and where it is put.
pub(crate) struct KeptFrames<'a> {
    pub(crate) frames: &'a Range<usize>,
    /// The goals of these frames.
    pub(crate) goals: Goals,
    /// The ends of the motions that the two passes continue, if there are any.
    pub(crate) starts: Option<&'a KnownStarts>,
    pub(crate) options: &'a LabanOptions,
    pub(crate) device: &'a Device,
}

impl KeptFrames<'_> {
    /// Returns what is kept of a generation. Its features are measured again, as those of a file would be.
    pub(crate) fn of(&self, generation: Generation) -> Generation {
        let starts = self.starts;
        let [of_baseline, of_guided] = [
            starts.map(|starts| &starts.baseline),
            starts.map(KnownStarts::guided),
        ];
        let baseline = kept_motion(&generation.baseline, self.frames, of_baseline);
        let guided = kept_motion(&generation.guided, self.frames, of_guided);
        let series = |motion: &Motion| LabanSeries::of(motion, self.options, self.device);
        let parts = generation.parts.iter();
        let terms = generation.terms.iter();
        Generation {
            baseline_laban: series(&baseline),
            guided_laban: series(&guided),
            target: self.series(&generation.target),
            goals: self.goals.clone(),
            network: NetworkMotions {
                baseline: kept_motion(&generation.network.baseline, self.frames, None),
                guided: kept_motion(&generation.network.guided, self.frames, None),
            },
            parts: parts.map(|part| self.part(part)).collect(),
            terms: terms.map(|term| self.term(term)).collect(),
            baseline,
            guided,
            ..generation
        }
    }

    fn series(&self, series: &LabanSeries) -> LabanSeries {
        series.section(self.frames.clone())
    }

    fn part(&self, part: &PartLaban) -> PartLaban {
        PartLaban {
            end_effectors: part.end_effectors.clone(),
            baseline: self.series(&part.baseline),
            target: self.series(&part.target),
            guided: self.series(&part.guided),
        }
    }

    fn term(&self, term: &TermValues) -> TermValues {
        let rows = |rows: &[Vec<f32>]| rows[self.frames.clone()].to_vec();
        TermValues {
            name: term.name.clone(),
            value_names: term.value_names.clone(),
            baseline: rows(&term.baseline),
            target: rows(&term.target),
            weight: rows(&term.weight),
            guided: rows(&term.guided),
        }
    }
}

/// Returns the kept frames of a motion. Those of a rigid body go on from where the motion before, which ends with `start`, stands.
pub(crate) fn kept_motion(
    motion: &Motion,
    frames: &Range<usize>,
    start: Option<&KnownStart>,
) -> Motion {
    let kept = match motion.features() {
        Some(features) => Motion::from_pose_features(features[frames.clone()].to_vec()),
        None => {
            let rotations = motion.rotations().between(frames.clone());
            Motion::from_rotations(match start {
                Some(start) => start.carry_on(&rotations),
                None => rotations,
            })
        }
    };
    kept.expect("the frames of a motion are a motion")
        .with_copyright(motion.copyright())
        .with_root_motion(motion.root_motion())
}
