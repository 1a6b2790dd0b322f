//! From the gradient of the output to that of the condition, and to those of the weights where they are asked for.
//!
//! With `C = softmax(k)ᵀ v` and `y = softmax(q) C`, the gradient of the keys before their softmax is
//! `K ⊙ (v Ċᵀ - r)` with `K` the softmax and `rᵢ = Σⱼ Cᵢⱼ Ċᵢⱼ`: the sum over frames that the softmax asks
//! for is already in `C`, so that chunks meet only once a block, for `Ċ = softmax(q)ᵀ ẏ`.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::FloatStorage;
use crate::attention::{self, Context};
use crate::chunk::Chunk;
use crate::decoder::{Decoder, DecoderBlock, DecoderInput, LAYERS, on_the_pool};
use crate::forward::gelu;
use crate::math;
use crate::stylization::{Gathered, Style};
use crate::tape::{Keep, Passage, Record, Tape};

/// What the way back through a block leaves for others.
struct Trace {
    /// DecoderGradients of scale and shift of each layer, granule after granule.
    modulations: [Vec<f32>; LAYERS],
    /// Gradient of the self-attention's output.
    y: Vec<f32>,
    /// Gradient of its context, for each granule.
    contexts: Vec<Vec<f32>>,
    /// Gradient of what the frames attend to in the text, for each granule; where weights are trained.
    texts: Vec<Vec<f32>>,
}

/// Passages whose gradients of weights are summed up in one place.
type Shared<'a> = (&'a mut [Passage], &'a mut Ledger);

/// Where gradients of weights are summed up, if they are asked for.
pub(crate) type Ledger = Option<Decoder<Vec<f32>>>;

/// All that the first half of a block needs on the way back.
struct After {
    contexts: Vec<Context>,
    /// For each motion.
    context_gradients: Vec<Vec<f32>>,
    /// For each chunk.
    traces: Vec<Trace>,
}

impl<S: FloatStorage> Decoder<S> {
    /// The gradient with respect to the condition, `[batch, condition]`, from the gradient of the
    /// output, `[batch, frames, features]`, of the evaluation that was recorded with the same input.
    ///
    /// # Panics
    ///
    /// If the tape is of another input.
    pub fn backward(&self, input: DecoderInput<'_>, tape: Tape, gradient: &[f32]) -> Vec<f32> {
        self.check_tape(input, &tape, gradient);
        on_the_pool(|| {
            let modulations = self.modulation_gradient(input, tape, gradient);
            self.modulations
                .modulate_backward(input.condition, &modulations)
        })
    }

    /// The gradient with respect to the scales and shifts of all stylization layers, `[batch, outputs of the modulations]`, as
    /// [`backward`](Self::backward) gives it with respect to the condition.
    ///
    /// # Panics
    ///
    /// As [`backward`](Self::backward).
    pub fn backward_to_modulation(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> Vec<f32> {
        self.check_tape(input, &tape, gradient);
        on_the_pool(|| self.modulation_gradient(input, tape, gradient))
    }

    fn modulation_gradient(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> Vec<f32> {
        let mut nobody: Vec<Ledger> = tape.passages.iter().map(|_| None).collect();
        self.unroll(input, tape, gradient, &mut nobody, &mut []).0
    }

    /// The gradient with respect to the noisy motion, `[batch, frames, features]`, as [`backward`](Self::backward) gives it with respect to
    /// the condition, of an evaluation that was [recorded for training](Self::record_for_training). 0 past a motion's length.
    ///
    /// # Panics
    ///
    /// If the tape is of another input, or was not recorded for training.
    pub fn backward_to_motion(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
    ) -> Vec<f32> {
        self.check_tape(input, &tape, gradient);
        assert!(
            tape.keep == Keep::ForWeights,
            "the tape was not recorded for training"
        );
        on_the_pool(|| {
            let mut nobody: Vec<Ledger> = tape.passages.iter().map(|_| None).collect();
            let (_, passages) = self.unroll(input, tape, gradient, &mut nobody, &mut []);
            let entered = passages.par_iter().map(|passage| {
                let place = self.place(&passage.chunk, input);
                let mut gradient = vec![0.0; place.len()];
                self.pose_embedding
                    .weight
                    .pull(&passage.hidden, &mut gradient);
                (place, gradient)
            });
            let entered: Vec<_> = entered.collect();
            let mut out = vec![0.0; input.x_t.len()];
            for (place, gradient) in entered {
                out[place].copy_from_slice(&gradient);
            }
            out
        })
    }

    /// Panics where tape or gradient are not of this input.
    pub(crate) fn check_tape(&self, input: DecoderInput<'_>, tape: &Tape, gradient: &[f32]) {
        self.check(input);
        let mut lengths = vec![0; input.lengths.len()];
        for passage in &tape.passages {
            lengths[passage.chunk.motion] += passage.chunk.frames();
        }
        assert!(
            lengths == input.lengths && tape.contexts.len() == self.blocks.len(),
            "the tape is of another input"
        );
        let features = self.output.weight.outputs();
        assert_eq!(
            gradient.len(),
            input.lengths.len() * input.frames * features,
            "expected a gradient for every output"
        );
    }

    /// Goes back through all blocks. Returns the gradients of all scales and shifts, `[batch, outputs of the
    /// modulations]`, and the passages, which then hold the gradient of the first block's input if the tape was recorded for training.
    ///
    /// Adjacent passages share one of the `ledgers`, in which gradients of weights are summed up in the order of
    /// the passages; then `texts` has a vector for each block, to which the gradient of its text is written.
    pub(crate) fn unroll(
        &self,
        input: DecoderInput<'_>,
        tape: Tape,
        gradient: &[f32],
        ledgers: &mut [Ledger],
        texts: &mut [Vec<f32>],
    ) -> (Vec<f32>, Vec<Passage>) {
        let Tape {
            mut passages,
            mut contexts,
            styles,
            keep,
        } = tape;
        let motions = input.lengths.len();
        let mut modulations = vec![0.0; motions * self.modulations.weight.outputs()];
        let sharing = passages.len().div_ceil(ledgers.len());
        // What the block after left for this one; the last has none after it.
        let mut after: Option<After> = None;
        for block in (0..self.blocks.len()).rev() {
            let of_ledger = |(group, (passages, ledger)): (usize, Shared<'_>)| {
                let passages = passages.iter_mut().enumerate();
                let back = passages.map(|(place, passage)| {
                    match &after {
                        None => self.leave_backward(passage, input, gradient, ledger),
                        Some(after) => {
                            let trace = &after.traces[group * sharing + place];
                            self.attend_backward(passage, block + 1, after, trace, ledger);
                        }
                    }
                    let motion = passage.chunk.motion;
                    let text = input.text(block, motion);
                    let styles = &styles[motion][block];
                    self.finish_backward(passage, (block, keep), text, styles, ledger)
                });
                back.collect::<Vec<Trace>>()
            };
            let traces: Vec<Vec<Trace>> = passages
                .par_chunks_mut(sharing)
                .zip(ledgers.par_iter_mut())
                .enumerate()
                .map(of_ledger)
                .collect();
            let traces: Vec<Trace> = traces.into_iter().flatten().collect();
            self.gather(&passages, &traces, block, &mut modulations);
            if let Some(text) = texts.get_mut(block) {
                *text = self.gather_texts(&passages, &traces, motions);
            }
            after = Some(After {
                contexts: contexts.pop().expect("one a block"),
                context_gradients: self.context_gradients(&passages, &traces, motions),
                traces,
            });
        }
        // On the first block's attention the condition has no influence.
        if let (Keep::ForWeights, Some(after)) = (keep, &after) {
            passages
                .par_chunks_mut(sharing)
                .zip(ledgers.par_iter_mut())
                .enumerate()
                .for_each(|(group, (passages, ledger))| {
                    for (place, passage) in passages.iter_mut().enumerate() {
                        let trace = &after.traces[group * sharing + place];
                        self.attend_backward(passage, 0, after, trace, ledger);
                        self.enter_backward(passage, input, ledger);
                    }
                });
        }
        (modulations, passages)
    }

    fn leave_backward(
        &self,
        passage: &mut Passage,
        input: DecoderInput<'_>,
        gradient: &[f32],
        ledger: &mut Ledger,
    ) {
        let gradient = &gradient[self.place(&passage.chunk, input)];
        if let Some(ledger) = ledger {
            ledger.output.gather(&passage.hidden, gradient);
        }
        self.output.weight.pull(gradient, &mut passage.hidden);
    }

    fn enter_backward(&self, passage: &Passage, input: DecoderInput<'_>, ledger: &mut Ledger) {
        let Passage { chunk, hidden, .. } = passage;
        if let Some(ledger) = ledger {
            let x_t = &input.x_t[self.place(chunk, input)];
            ledger.pose_embedding.gather(x_t, hidden);
            let first = chunk.first * self.width();
            math::add(&mut ledger.frame_embedding[first..], hidden);
        }
    }

    /// Back to the output of the self-attention.
    fn finish_backward(
        &self,
        passage: &mut Passage,
        (block, keep): (usize, Keep),
        text: &[f32],
        [first, second, third]: &[Style; LAYERS],
        ledger: &mut Ledger,
    ) -> Trace {
        let heads = self.heads();
        let weights = &self.blocks[block];
        let Passage {
            chunk,
            hidden: gradient,
            records,
            ..
        } = passage;
        let record = records.last_mut().expect("one a block");
        let mut gathered = ledger.as_mut().map(|ledger| &mut ledger.blocks[block]);
        let mut modulations =
            [(); LAYERS].map(|()| vec![0.0; chunk.granules.len() * 2 * heads.width]);
        let [in_first, in_second, in_third] = &mut modulations;
        let mut y = vec![0.0; gradient.len()];

        let layers = &weights.feed_forward;
        let style = &record.feed_forward_style;
        let sums = Gathered {
            modulation: in_third,
            weights: gathered
                .as_mut()
                .map(|block| &mut block.feed_forward.output),
        };
        layers
            .output
            .backward(gradient, third, style, &mut y, chunk, sums);
        let mut wide = vec![0.0; record.expanded.len()];
        if let Some(DecoderBlock { feed_forward, .. }) = &mut gathered {
            gelu(&record.expanded, &mut wide);
            feed_forward.contract.gather(&wide, &y);
        }
        layers.contract.weight.pull(&y, &mut wide);
        gelu_backward(&record.expanded, &mut wide);
        if let Some(DecoderBlock { feed_forward, .. }) = &mut gathered {
            let input = &record.feed_forward_input;
            feed_forward.expand.gather(input, &wide);
        }
        layers.expand.weight.pull_accumulate(&wide, gradient);

        let attention = &weights.cross_attention;
        let style = &record.cross_style;
        let sums = Gathered {
            modulation: in_second,
            weights: gathered
                .as_mut()
                .map(|block| &mut block.cross_attention.output),
        };
        attention
            .output
            .backward(gradient, second, style, &mut y, chunk, sums);
        let texts = match &gathered {
            None => Vec::new(),
            Some(_) => self.outer_each(chunk, &record.cross_query, &y),
        };
        let mut query = vec![0.0; gradient.len()];
        heads.apply_transposed(&y, text, &mut query);
        heads.softmax_backward(&record.cross_query, &mut query);
        if let Some(DecoderBlock {
            cross_attention, ..
        }) = &mut gathered
        {
            record.cross_norm.output(&attention.norm, &mut y);
            cross_attention.query.gather(&y, &query);
        }
        attention.query.weight.pull(&query, &mut y);
        if let Some(DecoderBlock {
            cross_attention, ..
        }) = &mut gathered
        {
            cross_attention.norm.gather(&y, &record.cross_norm);
        }
        attention
            .norm
            .backward(&mut y, &record.cross_norm, gradient);

        let style = &record.self_style;
        let sums = Gathered {
            modulation: in_first,
            weights: gathered
                .as_mut()
                .map(|block| &mut block.self_attention.output),
        };
        let output = &weights.self_attention.output;
        output.backward(gradient, first, style, &mut y, chunk, sums);
        let contexts = match (block, keep) {
            // On the first block's attention the condition has no influence.
            (0, Keep::ForCondition) => Vec::new(),
            _ => self.outer_each(chunk, &record.self_attention.query, &y),
        };
        Trace {
            modulations,
            y,
            contexts,
            texts,
        }
    }

    /// The sums over each granule that are the gradient of what its frames attend to.
    fn outer_each(&self, chunk: &Chunk, query: &[f32], y: &[f32]) -> Vec<Vec<f32>> {
        let heads = self.heads();
        chunk
            .granules(heads.width)
            .map(|range| {
                let mut out = vec![0.0; heads.width * heads.channels];
                heads.outer(&query[range.clone()], &y[range], &mut out);
                out
            })
            .collect()
    }

    /// Back through queries, keys and values to the block's input.
    fn attend_backward(
        &self,
        passage: &mut Passage,
        block: usize,
        after: &After,
        trace: &Trace,
        ledger: &mut Ledger,
    ) {
        let heads = self.heads();
        let attention = &self.blocks[block].self_attention;
        let motion = passage.chunk.motion;
        let context = &after.contexts[motion].values;
        let context_gradient = &after.context_gradients[motion];
        let y = &trace.y;
        let Record { self_attention, .. } = passage.records.pop().expect("one a block");
        let mut query = vec![0.0; y.len()];
        heads.apply_transposed(y, context, &mut query);
        heads.softmax_backward(&self_attention.query, &mut query);

        let mut key = vec![0.0; y.len()];
        heads.apply_transposed(&self_attention.value, context_gradient, &mut key);
        let rows = context.chunks_exact(heads.channels);
        let means: Vec<f32> = rows
            .zip(context_gradient.chunks_exact(heads.channels))
            .map(|(context, gradient)| math::dot(context, gradient))
            .collect();
        attention::keys_backward(&self_attention.key, &means, &mut key);

        let mut value = vec![0.0; y.len()];
        heads.apply(&self_attention.key, context_gradient, &mut value);

        let mut normed = vec![0.0; query.len()];
        let mut gathered = ledger
            .as_mut()
            .map(|ledger| &mut ledger.blocks[block].self_attention);
        if let Some(gathered) = &mut gathered {
            self_attention.norm.output(&attention.norm, &mut normed);
            gathered.query.gather(&normed, &query);
            gathered.key.gather(&normed, &key);
            gathered.value.gather(&normed, &value);
        }
        attention.query.weight.pull(&query, &mut normed);
        attention.key.weight.pull_accumulate(&key, &mut normed);
        attention.value.weight.pull_accumulate(&value, &mut normed);
        if let Some(gathered) = &mut gathered {
            gathered.norm.gather(&normed, &self_attention.norm);
        }
        attention
            .norm
            .backward(&mut normed, &self_attention.norm, &mut passage.hidden);
    }

    /// DecoderGradients of the contexts, for each motion.
    fn context_gradients(
        &self,
        passages: &[Passage],
        traces: &[Trace],
        motions: usize,
    ) -> Vec<Vec<f32>> {
        let heads = self.heads();
        let mut gradients = vec![vec![0.0; heads.width * heads.channels]; motions];
        for (passage, trace) in passages.iter().zip(traces) {
            for part in &trace.contexts {
                math::add(&mut gradients[passage.chunk.motion], part);
            }
        }
        gradients
    }

    /// The gradient of a block's text, `[batch, heads, d, d]`.
    fn gather_texts(&self, passages: &[Passage], traces: &[Trace], motions: usize) -> Vec<f32> {
        let heads = self.heads();
        let size = heads.width * heads.channels;
        let mut gradients = vec![0.0; motions * size];
        for (passage, trace) in passages.iter().zip(traces) {
            for part in &trace.texts {
                math::add(&mut gradients[passage.chunk.motion * size..][..size], part);
            }
        }
        gradients
    }

    /// Sums up a block's gradients of scales and shifts over frames, `[motion, block, layer]`.
    fn gather(
        &self,
        passages: &[Passage],
        traces: &[Trace],
        block: usize,
        modulations: &mut [f32],
    ) {
        let size = 2 * self.width();
        for (passage, trace) in passages.iter().zip(traces) {
            for (layer, parts) in trace.modulations.iter().enumerate() {
                let place = passage.chunk.motion * self.blocks.len() + block;
                let out = &mut modulations[(place * LAYERS + layer) * size..][..size];
                for part in parts.chunks_exact(size) {
                    math::add(out, part);
                }
            }
        }
    }
}

/// Turns the gradient of GELU into that of its argument.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn gelu_backward(x: &[f32], gradient: &mut [f32]) {
    for (g, x) in gradient.iter_mut().zip(x) {
        *g *= math::normal_cdf(*x) + x * math::normal_pdf(*x);
    }
}
