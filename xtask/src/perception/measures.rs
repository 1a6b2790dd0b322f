//! The ways to measure a clip: what people may have seen of it, as logarithms.

use std::error::Error;

use burn::tensor::Device;
use lamogen_files::{ReadOptions, read};
use lamogen_laban::{EndEffectors, GaussianKernel, LabanOptions, LabanSeries, Smoothing};
use lamogen_motion::{FRAMES_PER_SECOND, Joint};

use super::study::Clip;

/// The summary of a series over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Summary {
    Mean,
    /// A quantile; the maximum is that of 1.
    Quantile(f64),
}

impl Summary {
    /// Summarises values over time.
    pub fn of(self, mut values: Vec<f64>) -> f64 {
        match self {
            Summary::Mean => values.iter().sum::<f64>() / values.len().max(1) as f64,
            Summary::Quantile(fraction) => {
                values.sort_unstable_by(f64::total_cmp);
                let Some(last) = values.len().checked_sub(1) else {
                    return 0.0;
                };
                let place = fraction * last as f64;
                let (below, above) = (
                    values[place.floor() as usize],
                    values[place.ceil() as usize],
                );
                below + (above - below) * place.fract()
            }
        }
    }
}

/// A way to measure the four features of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    /// The group of the row in the table.
    pub group: &'static str,
    /// The name of the row.
    pub name: &'static str,
    pub options: LabanOptions,
    pub summary: Summary,
    /// The number of frames a second at which the clip is measured. The clips have 30.
    pub frames_per_second: f32,
}

/// The number of frames that have no difference before them, for each feature.
const WITHOUT_DIFFERENCE: [usize; 4] = [1, 2, 3, 0];

/// A feature is at least this, so that it has a logarithm.
const SMALLEST: f64 = 1e-12;

impl Measure {
    /// Returns all ways to measure: the usual one by several summaries, and others of which one thing is different.
    pub fn all() -> Vec<Measure> {
        let usual = Measure {
            group: "summary over time",
            name: "mean (smoothed positions, six end-effectors, 20 frames a second)",
            options: LabanOptions::default(),
            summary: Summary::Mean,
            frames_per_second: FRAMES_PER_SECOND,
        };
        let mut all = vec![usual.clone()];
        for (name, fraction) in [
            ("median", 0.5),
            ("75th percentile", 0.75),
            ("90th percentile", 0.9),
            ("95th percentile", 0.95),
            ("maximum", 1.0),
        ] {
            all.push(Measure {
                name,
                summary: Summary::Quantile(fraction),
                ..usual.clone()
            });
        }
        let gaussian = |size, variance| {
            GaussianKernel::new(size, variance)
                .expect("windows of odd sizes and positive variances")
        };
        for (name, smoothing) in [
            ("none", Smoothing::None),
            (
                "positions, 5 frames, variance 2",
                Smoothing::Positions(gaussian(5, 2.0)),
            ),
            (
                "positions, 21 frames, variance 40",
                Smoothing::Positions(gaussian(21, 40.0)),
            ),
            (
                "each difference, as the paper's text",
                Smoothing::EachDifference(GaussianKernel::PAPER),
            ),
        ] {
            for (name, summary) in [
                (name, Summary::Mean),
                (maximum_of(name), Summary::Quantile(1.0)),
            ] {
                all.push(Measure {
                    group: "smoothing",
                    name,
                    options: LabanOptions {
                        smoothing,
                        ..LabanOptions::default()
                    },
                    summary,
                    ..usual.clone()
                });
            }
        }
        let effectors = |joints: &[Joint]| {
            let joints = joints.iter().map(|&joint| (joint, 1.0));
            EndEffectors::new(joints).expect("different joints")
        };
        for (name, joints) in [
            ("both wrists", &[Joint::LeftWrist, Joint::RightWrist][..]),
            ("both feet", &[Joint::LeftFoot, Joint::RightFoot]),
            (
                "wrists and feet",
                &[
                    Joint::LeftWrist,
                    Joint::RightWrist,
                    Joint::LeftFoot,
                    Joint::RightFoot,
                ],
            ),
            ("the pelvis", &[Joint::Pelvis]),
            ("all 22 joints", &Joint::ALL),
        ] {
            all.push(Measure {
                group: "end-effectors",
                name,
                options: LabanOptions {
                    end_effectors: effectors(joints),
                    ..LabanOptions::default()
                },
                ..usual.clone()
            });
        }
        for (name, frames_per_second) in [
            ("10 frames a second", 10.0),
            ("15 frames a second", 15.0),
            ("30 frames a second, as the clips have", 30.0),
        ] {
            all.push(Measure {
                group: "frame rate",
                name,
                frames_per_second,
                ..usual.clone()
            });
        }
        all
    }

    /// Returns the features of every clip as logarithms: Weight, Time, Flow and Shape.
    ///
    /// # Errors
    ///
    /// If a clip cannot be read.
    pub fn features(
        &self,
        clips: &[Clip],
        device: &Device,
    ) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
        clips
            .iter()
            .map(|clip| self.features_of(clip, device))
            .collect()
    }

    fn features_of(&self, clip: &Clip, device: &Device) -> Result<Vec<f64>, Box<dyn Error>> {
        // A motion has 20 frames a second. A clip that is said to be slower or faster than it is gets the frames of another rate.
        let stated = CLIP_RATE * FRAMES_PER_SECOND / self.frames_per_second;
        let options = ReadOptions {
            frames_per_second: Some(stated),
            ..ReadOptions::default()
        };
        let read = read(&clip.path, &options)?;
        let series = LabanSeries::of(&read.motion, &self.options, device);
        let features = WITHOUT_DIFFERENCE
            .iter()
            .enumerate()
            .map(|(feature, &first)| {
                let frames = series.frames().iter().skip(first);
                let values = frames.map(|row| f64::from(row[feature])).collect();
                self.summary.of(values).max(SMALLEST).ln()
            });
        Ok(features.collect())
    }
}

/// The number of frames a second of the study's clips, which their files state.
const CLIP_RATE: f32 = 30.0;

/// Returns the name of a row by maximum instead of mean.
fn maximum_of(name: &'static str) -> &'static str {
    match name {
        "none" => "none, maximum",
        "positions, 5 frames, variance 2" => "positions, 5 frames, variance 2, maximum",
        "positions, 21 frames, variance 40" => "positions, 21 frames, variance 40, maximum",
        _ => "each difference, as the paper's text, maximum",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summaries_are_mean_and_quantiles() {
        let values = || vec![4.0, 1.0, 3.0, 2.0];
        assert_eq!(Summary::Mean.of(values()), 2.5);
        assert_eq!(Summary::Quantile(0.5).of(values()), 2.5);
        assert_eq!(Summary::Quantile(1.0).of(values()), 4.0);
        assert_eq!(Summary::Quantile(1.0).of(Vec::new()), 0.0);
    }

    #[test]
    fn rows_have_different_names_and_ways() {
        let all = Measure::all();
        for (place, measure) in all.iter().enumerate() {
            for other in &all[..place] {
                assert_ne!((measure.group, measure.name), (other.group, other.name));
                let is_same = measure.options == other.options
                    && measure.summary == other.summary
                    && measure.frames_per_second == other.frames_per_second;
                assert!(!is_same, "{} is {}", measure.name, other.name);
            }
        }
    }
}
