//! From requests to motions.

use std::ops::ControlFlow;

use burn::tensor::Device;
use lamogen_guide::{ClassifierFree, GuideError, Preset, Step, TemporalSmoothing};
use lamogen_laban::{EndEffectors, Goals, LabanSeries};
use lamogen_model::{Denoiser, KnownWords, MotionDiffuse, Tokenizer};
use lamogen_motion::{Motion, Normalization, POSE_FEATURES};

use crate::error::{Error, RequestError, RequestIndex};
use crate::groups::{Group, assign, in_batches};
use crate::licence::Licence;
use crate::request::Request;
use crate::run::Run;

/// A text-to-motion model that Laban tags can steer.
pub struct LaMoGen<D = MotionDiffuse> {
    pub(crate) network: D,
    pub(crate) tokenizer: Tokenizer,
    pub(crate) normalization: Normalization,
    licence: Option<Licence>,
    preset: Preset,
    batch_size: usize,
    pub(crate) temporal_smoothing: Option<TemporalSmoothing>,
    pub(crate) text_scale: f64,
    pub(crate) known_words: Option<KnownWords>,
    stand_in: Option<String>,
}

/// A finished request.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Generation {
    /// How many tokens of the prompt did not fit the model and were left out.
    pub cut_tokens: usize,
    /// Words of the prompt that stand in no caption that the model was trained on, as far as its words are [known](LaMoGen::known_words). The
    /// motion goes by the others and by what these are spelled like.
    pub unseen_words: Vec<String>,
    /// The sentence that was taken instead of the prompt, if the model has met no word of it ([`LaMoGen::with_stand_in`]).
    pub stand_in: Option<String>,
    /// What was asked for, by tags, factors or else.
    pub goals: Goals,
    /// The motion of the text alone: that of a rigid body, unless [`Guidance::body`](lamogen_guide::Guidance::body) says otherwise.
    pub baseline: Motion,
    /// The motion that follows the tags. Without tags or scale there is nothing to follow: the
    /// second pass is left out and this is the baseline.
    pub guided: Motion,
    /// What the network itself gave, with its pose features; both motions are made of these. Bones stretch and feet slide in them.
    pub network: NetworkMotions,
    /// Laban features of the baseline.
    pub baseline_laban: LabanSeries,
    /// Laban features of the guided motion.
    pub guided_laban: LabanSeries,
    /// Laban features to reach; the baseline's where they may be anything.
    pub target: LabanSeries,
    /// Where parts of the body have goals of their own: Weight, Time and Flow of each, and of the rest.
    pub parts: Vec<PartLaban>,
    /// The values of the loss terms that the request or its guidance added ([`Request::loss_term`]).
    pub terms: Vec<TermValues>,
    /// The loss at every step of the guided pass, over all terms.
    pub loss: Vec<f32>,
}

/// The values of a loss term before and after guidance, frame by frame.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TermValues {
    /// The name of the term.
    pub name: String,
    /// The names of its values.
    pub value_names: Vec<String>,
    /// The values of the baseline: `[frame][value]`.
    pub baseline: Vec<Vec<f32>>,
    /// The values to reach: `[frame][value]`.
    pub target: Vec<Vec<f32>>,
    /// What differences from the target are multiplied by: `[frame][value]`; 0 where a value may be anything.
    pub weight: Vec<Vec<f32>>,
    /// The values of the guided motion: `[frame][value]`.
    pub guided: Vec<Vec<f32>>,
}

/// The motions of pose features that a network gave.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct NetworkMotions {
    /// In the first pass, of the text alone.
    pub baseline: Motion,
    /// In the second pass; the baseline where there is none.
    pub guided: Motion,
}

/// Laban features of some end-effectors; Shape is that of the whole body.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PartLaban {
    /// The joints that are meant.
    pub end_effectors: EndEffectors,
    /// In the motion of the text alone.
    pub baseline: LabanSeries,
    /// To reach.
    pub target: LabanSeries,
    /// In the motion that follows.
    pub guided: LabanSeries,
}

/// How far a call has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Steps made, over all passes and batches.
    pub done: usize,
    /// Steps in all; a fit to the body may end before its last one, so that fewer are made.
    pub total: usize,
    /// The step just made.
    pub step: &'a Step<'a>,
}

impl<D: Denoiser> LaMoGen<D> {
    /// Guides any denoiser, with the tokenizer and the feature statistics it was trained with. Requests
    /// that say nothing else run with [`Preset::Fast`]; [`with_preset`](Self::with_preset) changes
    /// that.
    ///
    /// # Panics
    ///
    /// If the network's poses are not of 263 features, or the statistics of another width.
    pub fn new(network: D, tokenizer: Tokenizer, normalization: Normalization) -> Self {
        assert_eq!(
            [network.pose_features(), normalization.features()],
            [POSE_FEATURES; 2],
            "the network and its statistics must be of HumanML3D's pose features"
        );
        LaMoGen {
            batch_size: usual_batch_size(&network.device()),
            network,
            tokenizer,
            normalization,
            licence: None,
            preset: Preset::default(),
            temporal_smoothing: None,
            text_scale: 1.0,
            known_words: None,
            stand_in: None,
        }
    }

    /// How many motions run together in [`generate_all`](Self::generate_all).
    pub fn batch_size(&self) -> usize {
        self.batch_size
    }

    pub(crate) fn with_licence(self, licence: Option<Licence>) -> Self {
        LaMoGen { licence, ..self }
    }

    /// Sets what requests run with that say nothing else.
    pub fn with_preset(self, preset: Preset) -> Self {
        LaMoGen { preset, ..self }
    }

    /// What requests run with that say nothing else.
    pub fn preset(&self) -> Preset {
        self.preset
    }

    /// Sets how many motions run together in [`generate_all`](Self::generate_all): by default 1 on a CPU, where more are no faster, and 8
    /// elsewhere. More need more memory.
    ///
    /// A motion that runs with others is rounded otherwise in its last bits. A fit to the body finds one of many motions that are as near
    /// and reach their goals as well, and those bits may decide which: of 24 guided motions in batches of 8, joints were
    /// 1.5 mm from those of single calls on the median, and 18 mm in the worst motion. One that runs alone is the same to the last bit whatever
    /// other requests there are.
    ///
    /// # Panics
    ///
    /// If it is 0.
    pub fn with_batch_size(self, batch_size: usize) -> Self {
        assert!(batch_size > 0, "a batch has at least one motion");
        LaMoGen { batch_size, ..self }
    }

    /// Sets whether predictions are smoothed along time (see [`TemporalSmoothing`]), which networks as small as the embedded one need; it is
    /// off unless a model says otherwise.
    ///
    /// # Errors
    ///
    /// If the numbers make no sense.
    pub fn with_temporal_smoothing(
        self,
        temporal_smoothing: Option<TemporalSmoothing>,
    ) -> Result<Self, GuideError> {
        if let Some(temporal_smoothing) = temporal_smoothing {
            temporal_smoothing.check()?;
        }
        Ok(LaMoGen {
            temporal_smoothing,
            ..self
        })
    }

    /// How predictions are smoothed along time, if they are.
    pub fn temporal_smoothing(&self) -> Option<TemporalSmoothing> {
        self.temporal_smoothing
    }

    /// Sets the words of the captions that the model was trained on, so that [generations](Generation::unseen_words) tell of others.
    pub fn with_known_words(self, known_words: Option<KnownWords>) -> Self {
        LaMoGen {
            known_words,
            ..self
        }
    }

    /// The words of the captions that the model was trained on, if it comes with them.
    pub fn known_words(&self) -> Option<&KnownWords> {
        self.known_words.as_ref()
    }

    /// Sets the sentence that is taken instead of prompts of which the model has met no word, such as numbers or another language; what it would make of
    /// those is anything. [Generations](Generation::stand_in) say when it was. It acts where the model's words are [known](Self::with_known_words).
    pub fn with_stand_in(self, stand_in: Option<String>) -> Self {
        LaMoGen { stand_in, ..self }
    }

    /// The sentence that is taken for a prompt instead, if one is.
    pub fn stand_in(&self, prompt: &str) -> Option<&str> {
        let knows_some = self.known_words.as_ref()?.knows_some(prompt);
        self.stand_in.as_deref().filter(|_| !knows_some)
    }

    /// Sets how strongly motions follow the sentence, by classifier-free guidance (see [`ClassifierFree`]): 1, the default, asks the network
    /// once a step and takes what it says; above 1 it is asked twice. For networks that were trained with text dropout.
    ///
    /// # Errors
    ///
    /// If the scale is not finite or below 0.
    pub fn with_text_scale(self, text_scale: f64) -> Result<Self, GuideError> {
        ClassifierFree::new(&self.network, text_scale, &[])?;
        Ok(LaMoGen { text_scale, ..self })
    }

    /// How strongly motions follow the sentence.
    pub fn text_scale(&self) -> f64 {
        self.text_scale
    }

    /// The licence of the weights, if their file states one. PyTorch checkpoints do not.
    pub fn licence(&self) -> Option<&Licence> {
        self.licence.as_ref()
    }

    /// The network.
    pub fn network(&self) -> &D {
        &self.network
    }

    /// The tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// Mean and standard deviation of the features that the network was trained on.
    pub fn normalization(&self) -> &Normalization {
        &self.normalization
    }

    /// Generates a motion.
    ///
    /// # Errors
    ///
    /// If the request makes no sense, or numbers become infinite on the way.
    pub fn generate(&self, request: &Request) -> Result<Generation, Error> {
        self.generate_with(request, &mut |_| ControlFlow::Continue(()))
    }

    /// As [`generate`](Self::generate); `observer` sees every step and may stop the run.
    ///
    /// # Errors
    ///
    /// As [`generate`](Self::generate), and [`Error::Stopped`] with what there is if stopped.
    pub fn generate_with(
        &self,
        request: &Request,
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Result<Generation, Error> {
        let mut all = self.generate_all_with(std::slice::from_ref(request), observer)?;
        Ok(all.pop().expect("one request gives one motion"))
    }

    /// Generates several motions, those with the same steps and guidance options together where the
    /// [batch size](Self::with_batch_size) allows it. In batches of one, as on a CPU by default, each is exactly the motion that
    /// [`generate`](Self::generate) gives.
    ///
    /// # Errors
    ///
    /// As [`generate`](Self::generate). All requests are checked before the first is run; a run that
    /// fails later keeps what was finished ([`Error::Failed`]).
    pub fn generate_all(&self, requests: &[Request]) -> Result<Vec<Generation>, Error> {
        self.generate_all_with(requests, &mut |_| ControlFlow::Continue(()))
    }

    /// As [`generate_all`](Self::generate_all); `observer` sees every step and may stop the run.
    ///
    /// # Errors
    ///
    /// As [`generate_all`](Self::generate_all), and [`Error::Stopped`] with what there is if
    /// stopped.
    pub fn generate_all_with(
        &self,
        requests: &[Request],
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Result<Vec<Generation>, Error> {
        let groups = self.groups(requests)?;
        let total = groups.iter().map(Group::cost).sum();
        let mut done = 0;
        let mut watch = |step: &Step<'_>| {
            done += 1;
            observer(&Progress { done, total, step })
        };
        let mut finished: Vec<(usize, Generation)> = Vec::new();
        for group in &groups {
            match Run::new(self, group, requests).generations(&mut watch) {
                Ok(generations) => finished.extend(generations),
                Err(mut error) => {
                    finished.sort_by_key(|&(request, _)| request);
                    match &mut error {
                        Error::Stopped(stopped) => stopped.partial.finished = finished,
                        Error::Failed(failed) => failed.partial.finished = finished,
                        Error::Request { .. } => {}
                    }
                    return Err(error);
                }
            }
        }
        finished.sort_by_key(|&(request, _)| request);
        Ok(finished.into_iter().map(|(_, motion)| motion).collect())
    }

    /// Whether a request makes sense to this model. Everything that generates checks so itself, before it
    /// runs.
    ///
    /// # Errors
    ///
    /// If it does not; the error says why.
    pub fn check(&self, request: &Request) -> Result<(), RequestError> {
        self.join(&mut Vec::new(), 0, request)
    }

    fn groups(&self, requests: &[Request]) -> Result<Vec<Group>, Error> {
        let mut groups = Vec::new();
        for (index, request) in requests.iter().enumerate() {
            self.join(&mut groups, index, request)
                .map_err(|reason| Error::Request {
                    which: RequestIndex::new(requests, index),
                    reason,
                })?;
        }
        Ok(in_batches(groups, self.batch_size))
    }

    fn join(
        &self,
        groups: &mut Vec<Group>,
        index: usize,
        request: &Request,
    ) -> Result<(), RequestError> {
        assign(
            groups,
            (index, request),
            self.stand_in(&request.prompt),
            &self.network,
            &self.tokenizer,
            self.preset,
        )
    }
}

/// Motions that run together where nothing else is said.
// burn gives ndarray up for flex; as long as it is there, it is a CPU.
#[cfg_attr(feature = "ndarray", allow(deprecated))]
fn usual_batch_size(device: &Device) -> usize {
    let processors: &[Device] = &[
        #[cfg(feature = "flex")]
        Device::flex(),
        #[cfg(feature = "ndarray")]
        Device::ndarray(),
    ];
    match processors.contains(device) {
        true => 1,
        false => 8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_can_be_shared_between_threads() {
        fn shared<T: Send + Sync>() {}
        shared::<LaMoGen>();
        shared::<Generation>();
        shared::<Error>();
    }
}
