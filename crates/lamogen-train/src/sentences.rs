//! Sentences that a text encoder learns from a larger one.

use std::path::{Path, PathBuf};

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_data::Checksum;
use lamogen_model::{SentenceSimilarity, Tokenizer};
use lamogen_motion::npy::{self, NpyError};
use rand::RngExt;
use rayon::prelude::*;

use crate::sampling::stream;

/// Sentences, with their embeddings by a sentence encoder.
///
/// ```text
/// sentences.txt ──Tokenizer──▶ ids ─┐
/// sentences.npy ──▶ embeddings ─────┴─ draw(step) ──▶ tokens, cosines of their embeddings
/// ```
#[derive(Clone, Debug)]
pub struct Sentences {
    ids: Vec<Vec<i32>>,
    /// `[sentence][dimension]`, rows of length 1.
    embeddings: Vec<f32>,
    width: usize,
    /// Of each sentence the nearest others.
    neighbours: Vec<Vec<u32>>,
}

/// What is wrong with a file of sentences or of their embeddings.
#[derive(Debug, thiserror::Error)]
pub enum SentencesError {
    /// The array of embeddings cannot be read.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// What the files hold does not fit, or the sentences cannot be read.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Content { path: PathBuf, problem: String },
}

/// How many nearest sentences are known of each.
const NEIGHBOURS: usize = 16;

impl Sentences {
    /// Reads embeddings, `[sentences, width]` in an `.npy`, and the sentences from the `.txt` beside it, one a line.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, there are fewer than two sentences, or not as many as rows of embeddings.
    pub fn read(path: &Path, tokenizer: &Tokenizer) -> Result<Self, SentencesError> {
        let failed = |path: &Path, problem: String| SentencesError::Content {
            path: path.to_owned(),
            problem,
        };
        let array = npy::read(path)?;
        let text_path = path.with_extension("txt");
        let text = std::fs::read_to_string(&text_path)
            .map_err(|error| failed(&text_path, error.to_string()))?;
        let lines: Vec<&str> = text.lines().collect();
        let &[rows, width] = &array.shape[..] else {
            return Err(failed(
                path,
                format!(
                    "expected [sentences, width], found the shape {:?}",
                    array.shape
                ),
            ));
        };
        if rows != lines.len() || rows < 2 || width == 0 {
            let problem = format!(
                "expected one row for each of the {} sentences in {}, and at least two, found {rows}",
                lines.len(),
                text_path.display()
            );
            return Err(failed(path, problem));
        }
        let mut ids = Vec::with_capacity(rows);
        for (place, line) in lines.iter().enumerate() {
            let tokens = tokenizer
                .encode(line)
                .map_err(|error| failed(&text_path, format!("line {}: {error}", place + 1)))?;
            ids.push(tokens.ids.iter().map(|&id| id as i32).collect());
        }
        let mut embeddings = array.values;
        for (place, row) in embeddings.chunks_mut(width).enumerate() {
            let length = row.iter().map(|value| value * value).sum::<f32>().sqrt();
            if !(length.is_finite() && length > 0.0) {
                return Err(failed(
                    path,
                    format!("row {place}: expected finite numbers that are not all 0"),
                ));
            }
            row.iter_mut().for_each(|value| *value /= length);
        }
        Ok(Sentences {
            neighbours: neighbours(&embeddings, width),
            ids,
            embeddings,
            width,
        })
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.ids.len()
    }

    /// A number that stands for all of them, for the identity of a run that learns from them.
    pub fn checksum(&self) -> String {
        let mut sum = Checksum::new(0);
        for id in self.ids.iter().flatten() {
            sum.add(&id.to_le_bytes());
        }
        for number in &self.embeddings {
            sum.add(&number.to_le_bytes());
        }
        format!("{:016x}", sum.value())
    }

    /// The sentences of a step: some from anywhere, and of each two that are near it, since others have little to do with each other.
    pub(crate) fn draw(
        &self,
        seed: u64,
        step: u64,
        count: usize,
        weight: f64,
        device: &Device,
    ) -> SentenceSimilarity {
        const NEAR: usize = 2;
        let mut generator = stream(seed, step);
        let mut places = Vec::with_capacity(count + NEAR);
        while places.len() < count {
            let anchor = generator.random_range(0..self.count() as u64) as usize;
            places.push(anchor);
            for _ in 0..NEAR {
                let near = &self.neighbours[anchor];
                places.push(near[generator.random_range(0..near.len() as u64) as usize] as usize);
            }
        }
        places.truncate(count);
        let ids: Vec<i32> = { places.iter() }
            .flat_map(|&place| self.ids[place].iter().copied())
            .collect();
        let cosines: Vec<f32> = { places.iter() }
            .flat_map(|&one| places.iter().map(move |&other| self.cosine(one, other)))
            .collect();
        let tokens = TensorData::new(ids, [count, self.ids[0].len()]);
        SentenceSimilarity {
            tokens: Tensor::<2, Int>::from_data(tokens, device),
            cosines: Tensor::from_data(TensorData::new(cosines, [count, count]), device),
            weight,
        }
    }

    fn cosine(&self, one: usize, other: usize) -> f32 {
        let row = |place: usize| &self.embeddings[place * self.width..(place + 1) * self.width];
        dot(row(one), row(other))
    }
}

fn dot(one: &[f32], other: &[f32]) -> f32 {
    const LANES: usize = 8;
    let mut sums = [0.0f32; LANES];
    let chunks = one.chunks_exact(LANES).zip(other.chunks_exact(LANES));
    for (one, other) in chunks {
        for lane in 0..LANES {
            sums[lane] += one[lane] * other[lane];
        }
    }
    let whole = one.len() / LANES * LANES;
    let rest: f32 = one[whole..]
        .iter()
        .zip(&other[whole..])
        .map(|(one, other)| one * other)
        .sum();
    sums.iter().sum::<f32>() + rest
}

/// The nearest rows of each row, of length 1.
fn neighbours(embeddings: &[f32], width: usize) -> Vec<Vec<u32>> {
    let rows: Vec<&[f32]> = embeddings.chunks(width).collect();
    let nearest = |(place, row): (usize, &&[f32])| {
        let others = { rows.iter().enumerate() }.filter(|&(other, _)| other != place);
        let mut others: Vec<(f32, u32)> = others
            .map(|(other, numbers)| (dot(row, numbers), other as u32))
            .collect();
        let count = NEIGHBOURS.min(others.len());
        let order = |one: &(f32, u32), other: &(f32, u32)| {
            other.0.total_cmp(&one.0).then(one.1.cmp(&other.1))
        };
        others.select_nth_unstable_by(count - 1, order);
        others.truncate(count);
        others.sort_by(order);
        // Into a list of its own: collected in place, each would keep the room of all sentences.
        let mut nearest = Vec::with_capacity(count);
        nearest.extend(others.into_iter().map(|(_, other)| other));
        nearest
    };
    rows.par_iter().enumerate().map(nearest).collect()
}
