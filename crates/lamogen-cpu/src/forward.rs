//! From noisy motions to the network's output.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::FloatStorage;
use crate::attention::Context;
use crate::chunk::Chunk;
use crate::decoder::{Decoder, DecoderInput, LAYERS};
use crate::math;
use crate::stylization::Style;
use crate::tape::{Keep, Passage, Record, Styles, Tape};

impl<S: FloatStorage> Decoder<S> {
    /// The output, and a tape that can be used only if everything is kept.
    pub(crate) fn forward(
        &self,
        input: DecoderInput<'_>,
        chunks: Vec<Chunk>,
        keep: Keep,
    ) -> (Vec<f32>, Tape) {
        let mut passages: Vec<Passage> = chunks
            .into_iter()
            .map(|chunk| Passage::new(chunk, self.width()))
            .collect();
        // The first block's attention needs no styles, whose weights take long to read.
        let begin = |passage: &mut Passage| {
            self.enter(passage, input);
            self.attend(passage, 0, keep);
        };
        let (styles, ()) = rayon::join(
            || self.styles(input),
            || passages.par_iter_mut().for_each(begin),
        );
        let mut contexts = Vec::new();
        for (block, _) in self.blocks.iter().enumerate() {
            let all = self.contexts(&passages, input.lengths.len());
            passages.par_iter_mut().for_each(|passage| {
                let motion = passage.chunk.motion;
                let text = input.text(block, motion);
                let style = &styles[motion][block];
                self.finish(passage, block, &all[motion], text, style, keep);
                if keep != Keep::Nothing {
                    self.share_keys(passage, &all[motion]);
                }
                match block + 1 == self.blocks.len() {
                    true => self.leave(passage),
                    false => self.attend(passage, block + 1, keep),
                }
            });
            contexts.push(all);
        }
        let out = self.output(&passages, input);
        let tape = Tape {
            keep,
            passages,
            contexts,
            styles,
        };
        (out, tape)
    }

    fn styles(&self, input: DecoderInput<'_>) -> Styles {
        let mut modulations = self.modulations.modulate(input.condition);
        if let Some(added) = input.modulation {
            math::add(&mut modulations, added);
        }
        let motions = modulations.chunks_exact(self.modulations.weight.outputs());
        let of_motion = |modulations: &[f32]| {
            let mut layers = modulations.chunks_exact(2 * self.width());
            let mut style = |norm| Style::new(norm, layers.next().expect("one a layer"));
            let blocks = self.blocks.iter();
            blocks
                .map(|block| block.styled_norms().map(&mut style))
                .collect()
        };
        motions.map(of_motion).collect()
    }

    /// From pose features to the hidden state.
    fn enter(&self, passage: &mut Passage, input: DecoderInput<'_>) {
        let x_t = &input.x_t[self.place(&passage.chunk, input)];
        self.pose_embedding.forward(x_t, &mut passage.hidden);
        let first = passage.chunk.first * self.width();
        let embedding = &self.frame_embedding.as_ref()[first..];
        math::add(&mut passage.hidden, embedding);
    }

    /// The first half of a block: queries, and keys and values summed up.
    fn attend(&self, passage: &mut Passage, block: usize, keep: Keep) {
        let Passage {
            chunk,
            hidden,
            parts,
            records,
            ..
        } = passage;
        if keep != Keep::Nothing || records.is_empty() {
            records.push(Record::default());
        }
        let record = &mut records.last_mut().expect("just pushed").self_attention;
        let attention = &self.blocks[block].self_attention;
        let mut normed = vec![0.0; hidden.len()];
        attention
            .norm
            .forward(hidden, &mut record.norm, &mut normed);
        for (layer, out) in [
            (&attention.query, &mut record.query),
            (&attention.key, &mut record.key),
            (&attention.value, &mut record.value),
        ] {
            out.resize(hidden.len(), 0.0);
            layer.forward(&normed, out);
        }
        let heads = self.heads();
        heads.softmax(&mut record.query);
        *parts = chunk
            .granules(heads.width)
            .map(|range| heads.part(&mut record.key[range.clone()], &record.value[range]))
            .collect();
    }

    /// What the frames of each motion attend to.
    fn contexts(&self, passages: &[Passage], motions: usize) -> Vec<Context> {
        let of_motion = |motion| {
            let own = passages
                .iter()
                .filter(|passage| passage.chunk.motion == motion);
            Context::of(own.flat_map(|passage| &passage.parts))
        };
        (0..motions).map(of_motion).collect()
    }

    /// The rest of a block.
    fn finish(
        &self,
        passage: &mut Passage,
        block: usize,
        context: &Context,
        text: &[f32],
        [first, second, third]: &[Style; LAYERS],
        keep: Keep,
    ) {
        let heads = self.heads();
        let weights = &self.blocks[block];
        let Passage {
            hidden, records, ..
        } = passage;
        let record = records.last_mut().expect("attention came first");
        let mut y = vec![0.0; hidden.len()];

        heads.apply(&record.self_attention.query, &context.values, &mut y);
        let output = &weights.self_attention.output;
        output.forward(&mut y, first, &mut record.self_style, hidden);

        let attention = &weights.cross_attention;
        attention
            .norm
            .forward(hidden, &mut record.cross_norm, &mut y);
        record.cross_query.resize(hidden.len(), 0.0);
        attention.query.forward(&y, &mut record.cross_query);
        heads.softmax(&mut record.cross_query);
        heads.apply(&record.cross_query, text, &mut y);
        attention
            .output
            .forward(&mut y, second, &mut record.cross_style, hidden);

        if keep == Keep::ForWeights {
            record.feed_forward_input.clone_from(hidden);
        }
        let layers = &weights.feed_forward;
        let ff_size = layers.expand.weight.outputs();
        record
            .expanded
            .resize(hidden.len() / heads.width * ff_size, 0.0);
        layers.expand.forward(hidden, &mut record.expanded);
        let mut active = vec![0.0; record.expanded.len()];
        gelu(&record.expanded, &mut active);
        layers.contract.forward(&active, &mut y);
        layers
            .output
            .forward(&mut y, third, &mut record.feed_forward_style, hidden);
    }

    /// Makes the keys of the current block their softmax over frames.
    fn share_keys(&self, passage: &mut Passage, context: &Context) {
        let width = self.width();
        let Passage { chunk, records, .. } = passage;
        let record = records.last_mut().expect("attention came first");
        let shares = &context.shares[chunk.first_granule..];
        for (range, share) in chunk.granules(width).zip(shares) {
            math::scale(&mut record.self_attention.key[range], share);
        }
    }

    /// From the hidden state to pose features.
    fn leave(&self, passage: &mut Passage) {
        let rows = passage.chunk.frames();
        passage.output = vec![0.0; rows * self.output.weight.outputs()];
        self.output.forward(&passage.hidden, &mut passage.output);
    }

    /// The outputs of all chunks at their places in the batch.
    fn output(&self, passages: &[Passage], input: DecoderInput<'_>) -> Vec<f32> {
        let features = self.output.weight.outputs();
        let mut out = vec![0.0; input.lengths.len() * input.frames * features];
        for passage in passages {
            out[self.place(&passage.chunk, input)].copy_from_slice(&passage.output);
        }
        out
    }
}

/// `x · Φ(x)`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn gelu(x: &[f32], out: &mut [f32]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = x * math::normal_cdf(*x);
    }
}
