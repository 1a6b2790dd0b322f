//! The part of a case that a slow device can compute in seconds.

use std::ops::ControlFlow;
use std::path::Path;

use burn::tensor::{Device, Tensor};
use lamogen_guide::{Guidance, GuideError, Sampler, Step};

use super::case::{Case, numbers};
use super::network::{self, Network};
use super::{ComputedValue, ComputedValues, ParityError, read};

/// The number of guided steps.
const STEPS: usize = 3;

/// Some values of a case that were computed on one device.
pub struct Short {
    values: ComputedValues,
    /// The values of the reference.
    expected: Vec<(&'static str, Vec<f64>)>,
}

/// The distance of two results, relative to the largest number.
#[derive(Clone, Copy, Debug)]
pub struct Distance {
    /// The name of the value in the case.
    pub name: &'static str,
    /// The largest difference divided by the largest absolute value.
    pub error: f64,
    /// Whether the value is computed after a step of Adam.
    pub is_guided: bool,
}

/// Computes the text features, one evaluation of the network, the gradient of the Laban loss, and the embeddings and losses of three
/// guided steps.
///
/// # Errors
///
/// The errors are those of [`super::run`].
pub fn short(folder: &Path, device: &Device) -> Result<Short, ParityError> {
    let path = folder.join("case.safetensors");
    let bytes = read(&path)?;
    let case = Case::new(path, &bytes, device)?;
    let network = Network::load(folder, &case)?;
    let mut values = ComputedValues::new();
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
        ComputedValue::of(Tensor::stack::<3>(embeddings, 0), super::GUIDED_TOLERANCE),
    );
    values.insert(
        "out.trace_loss",
        ComputedValue::new(losses, vec![STEPS, size], super::GUIDED_TOLERANCE),
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
    /// Returns the distances of these values from those of the reference.
    pub fn distances_to_reference(&self) -> Vec<Distance> {
        let expected = self.expected.iter();
        expected
            .map(|(name, expected)| self.distance(name, expected.iter().copied()))
            .collect()
    }

    /// Returns the distances of these values from those of another device.
    pub fn distances_to(&self, other: &Short) -> Vec<Distance> {
        let others = other.values.iter();
        others
            .map(|(name, other)| self.distance(name, other.values.iter().copied()))
            .collect()
    }

    /// Computes the distance of one value.
    fn distance(&self, name: &'static str, expected: impl Iterator<Item = f64>) -> Distance {
        let actual = &self.values[name];
        Distance {
            name,
            error: actual.distance(expected),
            is_guided: actual.tolerance == super::GUIDED_TOLERANCE,
        }
    }
}
