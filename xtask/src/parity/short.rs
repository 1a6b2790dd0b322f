//! As much of a case as a slow device can compute in seconds.

use std::ops::ControlFlow;
use std::path::Path;

use burn::tensor::{Device, Tensor};
use lamogen_guide::{Guidance, GuideError, Sampler, Step};

use super::case::{Case, numbers};
use super::network::{self, Network};
use super::{Actual, ParityError, Values, read};

/// Guided steps that are made.
const STEPS: usize = 3;

/// Some values of a case, as computed on one device.
pub struct Short {
    values: Values,
    /// What the reference computes.
    expected: Vec<(&'static str, Vec<f64>)>,
}

/// How far two results are apart, relative to the largest number.
#[derive(Clone, Copy, Debug)]
pub struct Distance {
    /// The value's name in the case.
    pub name: &'static str,
    /// The largest difference over the largest absolute value.
    pub error: f64,
    /// Whether the value is behind Adam.
    pub is_guided: bool,
}

/// Computes text features, one evaluation, the gradient of the Laban loss, and three guided steps: the
/// embeddings and losses on the way.
///
/// # Errors
///
/// As [`super::run`].
pub fn short(folder: &Path, device: &Device) -> Result<Short, ParityError> {
    let path = folder.join("case.safetensors");
    let bytes = read(&path)?;
    let case = Case::new(path, &bytes, device)?;
    let network = Network::load(folder, &case)?;
    let mut values = Values::new();
    let batch = network.batch(&case)?;
    network.evaluate(&case, &batch.prompt, &mut values)?;
    network::laban(&case, &mut values)?;

    let size = batch.lengths.len();
    let sampler = Sampler::new(&network.model, &network.normalization, case.steps()?)?;
    let (mut embeddings, mut losses) = (Vec::new(), Vec::new());
    let mut observer = |step: &Step<'_>| {
        embeddings.push(step.embedding.clone());
        losses.extend(step.loss.into_iter().flatten().map(|&loss| f64::from(loss)));
        match embeddings.len() {
            STEPS => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    };
    let baseline = case.tensor::<3>("out.baseline")?;
    let scales = vec![case.scale()?.into(); size];
    let guidance = Guidance::paper();
    match sampler.guided(&batch, baseline, &scales, &guidance, &mut observer) {
        Ok(_) | Err(GuideError::Stopped { .. }) => {}
        Err(error) => return Err(error.into()),
    }
    values.insert(
        "out.trace_e",
        Actual::of(Tensor::stack::<3>(embeddings, 0), super::GUIDED),
    );
    values.insert(
        "out.trace_loss",
        Actual::new(losses, vec![STEPS, size], super::GUIDED),
    );

    let expected = values
        .iter()
        .map(|(name, actual)| {
            let numbers = numbers(&case.view(name)?);
            Ok((*name, numbers.take(actual.values.len()).collect()))
        })
        .collect::<Result<_, ParityError>>()?;
    Ok(Short { values, expected })
}

impl Short {
    /// How far these values are from the reference's.
    pub fn distances_to_reference(&self) -> Vec<Distance> {
        let expected = self.expected.iter();
        expected
            .map(|(name, expected)| self.distance(name, expected.iter().copied()))
            .collect()
    }

    /// How far these values are from those of another device.
    pub fn distances_to(&self, other: &Short) -> Vec<Distance> {
        let others = other.values.iter();
        others
            .map(|(name, other)| self.distance(name, other.values.iter().copied()))
            .collect()
    }

    fn distance(&self, name: &'static str, expected: impl Iterator<Item = f64>) -> Distance {
        let actual = &self.values[name];
        Distance {
            name,
            error: actual.distance(expected),
            is_guided: actual.tolerance == super::GUIDED,
        }
    }
}
