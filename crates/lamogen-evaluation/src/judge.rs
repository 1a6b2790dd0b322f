//! The evaluator of an evaluation, and what its scores are computed from.

use lamogen_data::BenchmarkClip;
use lamogen_eval::protocol::{Protocol, PublicEvaluator, Replication};
use lamogen_eval::{Embeddings, Evaluator, EvaluatorError};

/// The evaluator that embeds motions.
#[derive(Clone, Copy)]
pub enum MotionEvaluator<'a> {
    /// An evaluator that was trained by lamogen.
    Trained(&'a Evaluator),
    /// The public evaluator.
    Public(&'a PublicEvaluator),
    /// None: nothing that needs an evaluator is computed.
    None,
}

impl MotionEvaluator<'_> {
    /// Embeds motions, if there is an evaluator.
    pub fn motions(
        self,
        motions: &[impl AsRef<[f32]>],
    ) -> Result<Option<Embeddings>, EvaluatorError> {
        match self {
            MotionEvaluator::Trained(evaluator) => evaluator.motions(motions).map(Some),
            MotionEvaluator::Public(evaluator) => evaluator.motions(motions).map(Some),
            MotionEvaluator::None => Ok(None),
        }
    }

    /// Returns a text that is another one for another evaluator.
    pub fn fingerprint(self) -> String {
        match self {
            MotionEvaluator::Trained(evaluator) => lamogen_train::fingerprint(evaluator.network()),
            MotionEvaluator::Public(evaluator) => {
                let network = lamogen_train::fingerprint(evaluator.network());
                match evaluator.has_words() {
                    true => format!("{network}, public"),
                    false => format!("{network}, public, without words"),
                }
            }
            MotionEvaluator::None => "none".into(),
        }
    }
}

/// What the evaluator's scores are computed from, before anything is embedded that takes long.
pub enum ScoreSource<'a> {
    /// The embeddings of the prompts' real motions, and those of sets of as many real motions of other sentences.
    Trained {
        real: Embeddings,
        others: Vec<Embeddings>,
    },
    /// The benchmark's motions and the draws of each repeat.
    Public {
        evaluator: &'a PublicEvaluator,
        clips: Vec<&'a BenchmarkClip>,
        replications: Vec<Replication>,
    },
    /// Nothing: there is no evaluator.
    None,
}

/// What the evaluator's scores are computed from.
pub enum ScoreBasis<'a> {
    /// For each repeat the embeddings of the captions of all prompts, and those of the real motions. R-precision is that of batches with distinct
    /// captions, FID that of the prompts' own motions. `others` are real motions of other sentences, as many in each set: what FID is between
    /// motions that are all real.
    Trained {
        texts: &'a [Embeddings],
        real: &'a Embeddings,
        others: &'a [Embeddings],
    },
    /// The public evaluation.
    Public(Box<Protocol>),
    /// There is no evaluator.
    None,
}
