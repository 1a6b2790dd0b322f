//! SentenceEmbeddings from which a text encoder learns the similarities of a larger sentence encoder.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use burn::tensor::{Device, Int, Tensor, TensorData};
use lamogen_data::Checksum;
use lamogen_model::{SentenceSimilarity, Tokenizer};
use lamogen_motion::npy::{self, NpyError};
use rand::RngExt;
use rayon::prelude::*;

use crate::sampling::step_generator;

/// SentenceEmbeddings and their embeddings from a sentence encoder.
///
/// ```text
/// sentences.txt ──Tokenizer──▶ ids ─┐
/// sentences.npy ──▶ embeddings ─────┴─ draw(step) ──▶ tokens, cosines of their embeddings
/// ```
#[derive(Clone, Debug)]
pub struct SentenceEmbeddings {
    ids: Vec<Vec<i32>>,
    /// The embeddings `[sentence][dimension]`, in rows of length 1.
    embeddings: Vec<f32>,
    width: usize,
    /// The nearest other sentences of each sentence, found when it is first drawn: all sentences are compared with it.
    neighbours: Vec<OnceLock<Vec<u32>>>,
}

/// The error of files of sentences and embeddings that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SentencesError {
    /// The array of embeddings cannot be read.
    #[error(transparent)]
    Npy(#[from] NpyError),
    /// The contents of the files do not fit together, or the sentences cannot be read.
    #[error("{path}: {problem}")]
    #[allow(missing_docs)]
    Content { path: PathBuf, problem: String },
}

/// The number of nearest sentences that are kept for each sentence.
const NEIGHBOURS: usize = 16;

impl SentenceEmbeddings {
    /// Reads embeddings `[sentences, width]` from an `.npy` file, and the sentences from the `.txt` file of the same name, one in
    /// each line.
    ///
    /// # Errors
    ///
    /// If a file cannot be read, there are fewer than two sentences, or the numbers of sentences and of embeddings differ.
    pub fn read(path: &Path, tokenizer: &Tokenizer) -> Result<Self, SentencesError> {
        let content_error = |path: &Path, problem: String| SentencesError::Content {
            path: path.to_owned(),
            problem,
        };
        let array = npy::read(path)?;
        let text_path = path.with_extension("txt");
        let text = std::fs::read_to_string(&text_path)
            .map_err(|error| content_error(&text_path, error.to_string()))?;
        let lines: Vec<&str> = text.lines().collect();
        let &[rows, width] = &array.shape[..] else {
            return Err(content_error(
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
            return Err(content_error(path, problem));
        }
        let mut ids = Vec::with_capacity(rows);
        for (place, line) in lines.iter().enumerate() {
            let tokens = tokenizer.encode(line).map_err(|error| {
                content_error(&text_path, format!("line {}: {error}", place + 1))
            })?;
            ids.push(tokens.ids.iter().map(|&id| id as i32).collect());
        }
        let mut embeddings = array.values;
        for (place, row) in embeddings.chunks_mut(width).enumerate() {
            let length = row.iter().map(|value| value * value).sum::<f32>().sqrt();
            if !(length.is_finite() && length > 0.0) {
                return Err(content_error(
                    path,
                    format!("row {place}: expected finite numbers that are not all 0"),
                ));
            }
            row.iter_mut().for_each(|value| *value /= length);
        }
        Ok(SentenceEmbeddings {
            neighbours: vec![OnceLock::new(); rows],
            ids,
            embeddings,
            width,
        })
    }

    /// Returns the number of sentences.
    pub fn count(&self) -> usize {
        self.ids.len()
    }

    /// Returns a checksum of all sentences and embeddings, for the identity of a run that learns from them.
    pub fn checksum(&self) -> String {
        let mut checksum = Checksum::new(0);
        for id in self.ids.iter().flatten() {
            checksum.add(&id.to_le_bytes());
        }
        for number in &self.embeddings {
            checksum.add(&number.to_le_bytes());
        }
        format!("{:016x}", checksum.value())
    }

    /// Draws the sentences of a step: random sentences, each with two of its nearest ones, because most pairs of random sentences
    /// have little in common.
    pub(crate) fn draw(
        &self,
        seed: u64,
        step: u64,
        count: usize,
        weight: f64,
        device: &Device,
    ) -> SentenceSimilarity {
        const NEIGHBOURS_DRAWN: usize = 2;
        let mut generator = step_generator(seed, step);
        let mut places = Vec::with_capacity(count + NEIGHBOURS_DRAWN);
        while places.len() < count {
            let anchor = generator.random_range(0..self.count() as u64) as usize;
            places.push(anchor);
            for _ in 0..NEIGHBOURS_DRAWN {
                let nearest = self.neighbours(anchor);
                let choice = generator.random_range(0..nearest.len() as u64) as usize;
                places.push(nearest[choice] as usize);
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

    /// Returns the nearest other sentences of a sentence, the nearest one first.
    fn neighbours(&self, place: usize) -> &[u32] {
        self.neighbours[place].get_or_init(|| {
            let mut cosines: Vec<(f32, u32)> = (0..self.count())
                .into_par_iter()
                .map(|other| (self.cosine(place, other), other as u32))
                .collect();
            cosines.swap_remove(place);
            let count = NEIGHBOURS.min(cosines.len());
            let order = |one: &(f32, u32), other: &(f32, u32)| {
                other.0.total_cmp(&one.0).then(one.1.cmp(&other.1))
            };
            cosines.select_nth_unstable_by(count - 1, order);
            cosines.truncate(count);
            cosines.sort_by(order);
            cosines.iter().map(|&(_, other)| other).collect()
        })
    }

    /// Computes the cosine of the embeddings of two sentences.
    fn cosine(&self, one: usize, other: usize) -> f32 {
        let row = |place: usize| &self.embeddings[place * self.width..(place + 1) * self.width];
        dot(row(one), row(other))
    }
}

/// Computes the dot product of two rows.
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
