//! The model, and the generation of motions from requests.

use std::ops::{ControlFlow, Range, RangeInclusive};

use burn::tensor::Device;
use lamogen_guide::{GuideError, PlaceOutcome, Preset, Step, TemporalSmoothing, TextScale};
use lamogen_laban::{EndEffectors, Goals, LabanSeries};
use lamogen_model::{AnyNetwork, Denoiser, SamplingMethod, Tokenizer, WordList};
use lamogen_motion::{Motion, Normalization, POSE_FEATURES};

use crate::baseline_cache::BaselineCache;
use crate::error::{Error, PassError, RequestError, RequestIndex};
use crate::groups::{JobGroup, assign_to_group, default_steps, split_into_batches};
use crate::licence::Licence;
use crate::long_run::LongRun;
use crate::request::Request;
use crate::run::BatchRun;

/// A text-to-motion model that Laban tags can steer.
pub struct LaMoGen<D = AnyNetwork> {
    pub(crate) network: D,
    pub(crate) tokenizer: Tokenizer,
    pub(crate) normalization: Normalization,
    licence: Option<Licence>,
    preset: Preset,
    batch_size: usize,
    pub(crate) temporal_smoothing: Option<TemporalSmoothing>,
    pub(crate) text_scale: TextScale,
    pub(crate) sampling_method: SamplingMethod,
    pub(crate) known_words: Option<WordList>,
    stand_in: Option<String>,
    min_frames: usize,
    pub(crate) baseline_cache: BaselineCache,
}

/// The result of a request.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Generation {
    /// The sentences of the motion, each with the frames for which it holds.
    pub sentences: Vec<GeneratedSentence>,
    /// The number of tokens of the prompt, and of the sentences after it, that did not fit the model and were left out.
    pub cut_tokens: usize,
    /// Words of the sentences that occur in no caption that the model was trained on. The list is empty if the model's
    /// words are not [known](LaMoGen::known_words). The motion follows the other words, and the letters that these
    /// words have in common with known ones.
    pub unseen_words: Vec<String>,
    /// The sentence that replaced the prompt or one of the sentences after it, if that says nothing in words that the model knows
    /// ([`LaMoGen::with_stand_in`]).
    pub stand_in: Option<String>,
    /// The goals of the request, given by tags, by factors or in other ways.
    pub goals: Goals,
    /// The motion of the text alone. It is the motion of a rigid body, unless
    /// [`Guidance::body`](lamogen_guide::Guidance::body) says otherwise.
    pub baseline: Motion,
    /// The motion that follows the tags. A request without tags and factors has no second pass: this is then the
    /// baseline.
    pub guided: Motion,
    /// The motions that the network itself generated, with their pose features; `baseline` and `guided` are made from
    /// these. Their bones stretch and their feet slide.
    pub network: NetworkMotions,
    /// Laban features of the baseline.
    pub baseline_laban: LabanSeries,
    /// Laban features of the guided motion.
    pub guided_laban: LabanSeries,
    /// Laban features that the guided motion should reach. Components that may become anything have the features of
    /// the baseline.
    pub target: LabanSeries,
    /// Weight, Time and Flow of each part of the body that has goals of its own, and of the rest of the body; empty
    /// if no part has.
    pub parts: Vec<PartLaban>,
    /// The values of the loss terms that the request or its guidance added ([`Request::loss_term`]).
    pub terms: Vec<TermValues>,
    /// How near the guided motion comes to each place that the request asked for.
    pub places: Vec<PlaceOutcome>,
    /// The number of DDIM steps of each pass.
    pub steps: usize,
    /// The loss at every step of the guided pass, over all terms.
    pub loss: Vec<f32>,
}

/// A sentence of a motion.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GeneratedSentence {
    /// The sentence as it was requested.
    pub prompt: String,
    /// The frames of the motion for which it holds.
    pub frames: Range<usize>,
    /// The goals of these frames. A sentence without goals beside others keeps the motion of its text.
    pub goals: Goals,
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

/// The motions of the pose features that the network generated.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct NetworkMotions {
    /// The motion of the first pass, of the text alone.
    pub baseline: Motion,
    /// The motion of the second pass; the baseline if there was none.
    pub guided: Motion,
}

/// Laban features of a part of the body; Shape is that of the whole body.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PartLaban {
    /// The joints of the part that are measured.
    pub end_effectors: EndEffectors,
    /// Features of the part in the motion of the text alone.
    pub baseline: LabanSeries,
    /// Features that the part should reach.
    pub target: LabanSeries,
    /// Features of the part in the guided motion.
    pub guided: LabanSeries,
}

impl PartLaban {
    /// Returns the features in some of the frames. Frames past the end of the motion are left out.
    pub fn section(&self, frames: Range<usize>) -> PartLaban {
        let [baseline, target, guided] = [&self.baseline, &self.target, &self.guided]
            .map(|series| series.section(frames.clone()));
        PartLaban {
            end_effectors: self.end_effectors.clone(),
            baseline,
            target,
            guided,
        }
    }
}

/// The progress of a call.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// The number of finished steps, over all passes and batches.
    pub done: usize,
    /// The largest number of steps that the call can take. Fewer are made if a fit to the body ends early.
    pub total: usize,
    /// The step that was just finished.
    pub step: &'a Step<'a>,
}

impl<D: Denoiser> LaMoGen<D> {
    /// Makes a model of any denoiser, with the tokenizer and the feature statistics it was trained with.
    ///
    /// Requests without a preset run with [`Preset::Fast`]; [`with_preset`](Self::with_preset) changes that.
    ///
    /// # Panics
    ///
    /// If the network or the statistics do not have 263 pose features.
    pub fn new(network: D, tokenizer: Tokenizer, normalization: Normalization) -> Self {
        assert_eq!(
            [network.pose_features(), normalization.features()],
            [POSE_FEATURES; 2],
            "the network and its statistics must be of HumanML3D's pose features"
        );
        LaMoGen {
            batch_size: default_batch_size(&network.device()),
            min_frames: network.min_frames(),
            sampling_method: network.sampling_method(),
            network,
            tokenizer,
            normalization,
            licence: None,
            preset: Preset::default(),
            temporal_smoothing: None,
            text_scale: TextScale::default(),
            known_words: None,
            stand_in: None,
            baseline_cache: BaselineCache::default(),
        }
    }

    /// Sets the length in frames of the shortest motion that may be requested. The default is that of the network ([`Denoiser::min_frames`]), which is the shortest one it was trained on;
    /// a shorter motion is a network's guess. The public evaluation of HumanML3D generates motions of 36 frames with networks that were trained on 40 and more.
    ///
    /// # Panics
    ///
    /// If the length is 0 or above that of the longest motion.
    pub fn with_min_frames(self, min_frames: usize) -> Self {
        let longest = self.network.max_frames();
        assert!(
            (1..=longest).contains(&min_frames),
            "expected a shortest motion of 1 to {longest} frames, found {min_frames}"
        );
        LaMoGen { min_frames, ..self }
    }

    /// Returns the lengths in frames of motions that may be requested.
    pub fn lengths(&self) -> RangeInclusive<usize> {
        self.min_frames..=self.network.max_frames()
    }

    /// Returns the number of motions that run together in [`generate_all`](Self::generate_all).
    pub fn batch_size(&self) -> usize {
        self.batch_size
    }

    pub(crate) fn with_licence(self, licence: Option<Licence>) -> Self {
        LaMoGen { licence, ..self }
    }

    /// Sets the preset of requests that have none.
    pub fn with_preset(self, preset: Preset) -> Self {
        LaMoGen { preset, ..self }
    }

    /// Returns the preset of requests that have none.
    pub fn preset(&self) -> Preset {
        self.preset
    }

    /// Sets how many motions run together in [`generate_all`](Self::generate_all).
    ///
    /// The default is 1 on a CPU, so that each motion is exactly that of a single call (8 are 1.3 times as fast on two cores), and 8 elsewhere. Larger batches need more memory.
    ///
    /// The numbers of a motion that runs with others differ in their last bits from those of a single call. A fit to
    /// the body finds one of many motions that are equally near and reach their goals equally well, and the last bits
    /// may decide which one. In 24 guided motions in batches of 8, the distance of the joints from those of single
    /// calls was 1.5 mm in the median motion and 18 mm in the worst. A motion that runs alone is the same to the last
    /// bit, whatever other requests there are.
    ///
    /// # Panics
    ///
    /// If the batch size is 0.
    pub fn with_batch_size(self, batch_size: usize) -> Self {
        assert!(batch_size > 0, "a batch has at least one motion");
        LaMoGen { batch_size, ..self }
    }

    /// Sets how many motions of texts alone are kept: those that were used last. A request that differs from an earlier one in its goals alone, as
    /// when a slider is moved, then needs no first pass, and its motion is the same to the last bit. The default is 0.
    ///
    /// A kept motion of ten seconds takes about half a megabyte. Motions that run together with others in a
    /// [batch](Self::with_batch_size) are not kept.
    pub fn with_kept_baselines(self, count: usize) -> Self {
        LaMoGen {
            baseline_cache: BaselineCache::new(count),
            ..self
        }
    }

    /// Sets whether predictions are smoothed along time (see [`TemporalSmoothing`]). Networks as small as the embedded
    /// one need it. It is off unless the config of a model turns it on.
    ///
    /// # Errors
    ///
    /// If the options are invalid.
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

    /// Returns how predictions are smoothed along time, if they are.
    pub fn temporal_smoothing(&self) -> Option<TemporalSmoothing> {
        self.temporal_smoothing
    }

    /// Sets the words of the captions that the model was trained on, so that each
    /// [`Generation`](Generation::unseen_words) can list the words of its prompt that are not among them.
    pub fn with_known_words(self, known_words: Option<WordList>) -> Self {
        LaMoGen {
            known_words,
            ..self
        }
    }

    /// Returns the words of the captions that the model was trained on, if they are known.
    pub fn known_words(&self) -> Option<&WordList> {
        self.known_words.as_ref()
    }

    /// Sets the sentence that replaces prompts that say nothing in words that the model knows, such as numbers, "a person" or another
    /// language (see [`WordList::says_anything`]). Without it the motions of such prompts are arbitrary.
    ///
    /// A [`Generation`](Generation::stand_in) says whether its prompt was replaced. Prompts are replaced only if the
    /// model's words are [known](Self::with_known_words).
    pub fn with_stand_in(self, stand_in: Option<String>) -> Self {
        LaMoGen { stand_in, ..self }
    }

    /// Returns the sentence that replaces a prompt, if one does.
    pub fn stand_in(&self, prompt: &str) -> Option<&str> {
        let says_anything = self.known_words.as_ref()?.says_anything(prompt);
        self.stand_in.as_deref().filter(|_| !says_anything)
    }

    /// Sets how strongly motions follow the sentence, by classifier-free guidance (see [`ClassifierFree`](lamogen_guide::ClassifierFree)): a scale, or a scale
    /// for the noisier of the timesteps.
    ///
    /// At 1, the default, the network is evaluated once a step and its prediction is used as it is; above 1 it is
    /// evaluated twice. Other scales than 1 are for networks that were trained with text dropout.
    ///
    /// # Errors
    ///
    /// If the scale is invalid (see [`TextScale::check`]).
    pub fn with_text_scale(self, text_scale: impl Into<TextScale>) -> Result<Self, GuideError> {
        let text_scale = text_scale.into();
        text_scale.check(self.network.noise_schedule())?;
        Ok(LaMoGen { text_scale, ..self })
    }

    /// Returns the scale of classifier-free guidance: how strongly motions follow the sentence.
    pub fn text_scale(&self) -> TextScale {
        self.text_scale
    }

    /// Sets whether a part of the noise is drawn anew at each step. The default is what the authors of the network do:
    /// [`SamplingMethod::Ddim`] for MotionDiffuse, [`SamplingMethod::Ddpm`] for MDM.
    ///
    /// With either method, a seed means one motion.
    pub fn with_sampling_method(self, sampling_method: SamplingMethod) -> Self {
        LaMoGen {
            sampling_method,
            ..self
        }
    }

    /// Returns how a step of sampling goes to the next timestep.
    pub fn sampling_method(&self) -> SamplingMethod {
        self.sampling_method
    }

    /// Returns the number of steps of a request with a preset and without steps of its own: those of the preset, or all
    /// timesteps that the network was trained with if these are fewer. Loops, motions with places and motions
    /// that lead to another may have more ([`Preset::meeting_steps`]); [`Generation::steps`] says how many a motion had.
    pub fn default_steps(&self, preset: Preset) -> usize {
        default_steps(preset, false, &self.network)
    }

    /// Returns the licence of the weights, if their file states one. PyTorch checkpoints do not.
    pub fn licence(&self) -> Option<&Licence> {
        self.licence.as_ref()
    }

    /// Returns the network.
    pub fn network(&self) -> &D {
        &self.network
    }

    /// Returns the tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// Returns the mean and the standard deviation of the features that the network was trained on.
    pub fn normalization(&self) -> &Normalization {
        &self.normalization
    }

    /// Generates a motion.
    ///
    /// # Errors
    ///
    /// If the request is invalid, or if numbers become infinite during the generation.
    pub fn generate(&self, request: &Request) -> Result<Generation, Error> {
        self.generate_with(request, &mut |_| ControlFlow::Continue(()))
    }

    /// Generates a motion as [`generate`](Self::generate) does; `observer` is called after every step and may stop the
    /// run.
    ///
    /// # Errors
    ///
    /// The errors of [`generate`](Self::generate), and [`Error::Stopped`] with partial results if the observer stops
    /// the run.
    pub fn generate_with(
        &self,
        request: &Request,
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Result<Generation, Error> {
        let mut all = self.generate_all_with(std::slice::from_ref(request), observer)?;
        Ok(all.pop().expect("one request gives one motion"))
    }

    /// Generates several motions.
    ///
    /// Requests with the same steps and guidance options run together if the [batch size](Self::with_batch_size)
    /// allows it. In batches of one, the default on a CPU, each motion is exactly the one that
    /// [`generate`](Self::generate) gives.
    ///
    /// # Errors
    ///
    /// The errors of [`generate`](Self::generate). All requests are checked before the first one runs. The error of a
    /// run that fails later contains the finished motions ([`Error::Failed`]).
    pub fn generate_all(&self, requests: &[Request]) -> Result<Vec<Generation>, Error> {
        self.generate_all_with(requests, &mut |_| ControlFlow::Continue(()))
    }

    /// Generates several motions as [`generate_all`](Self::generate_all) does; `observer` is called after every step
    /// and may stop the run.
    ///
    /// # Errors
    ///
    /// The errors of [`generate_all`](Self::generate_all), and [`Error::Stopped`] with partial results if the observer
    /// stops the run.
    pub fn generate_all_with(
        &self,
        requests: &[Request],
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Result<Vec<Generation>, Error> {
        let groups = self.groups(requests)?;
        let window = self.network.window();
        let total = groups.iter().map(|group| group.max_steps(window)).sum();
        let mut done = 0;
        let mut observe_step = |step: &Step<'_>| {
            done += 1;
            observer(&Progress { done, total, step })
        };
        let mut finished: Vec<(usize, Generation)> = Vec::new();
        for group in &groups {
            let generations = match LongRun::new(self, group, requests) {
                Some(run) => { run.generation(&mut observe_step) }
                    .map(|generation| vec![(group.jobs[0].request, generation)]),
                None => BatchRun::new(self, group, requests).generations(&mut observe_step),
            };
            match generations {
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

    /// Generates several motions, of which some may fail: the others are generated without these. Returns the motion of each request, or why there
    /// is none. `observer` sees every step, and may stop the run.
    ///
    /// # Errors
    ///
    /// If a request makes no sense, or the observer stopped the run. That error has the motions that were finished.
    pub fn generate_each(
        &self,
        requests: &[Request],
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Result<Vec<Result<Generation, PassError>>, Error> {
        let mut results: Vec<Option<Result<Generation, PassError>>> =
            requests.iter().map(|_| None).collect();
        loop {
            let pending: Vec<usize> = { 0..requests.len() }
                .filter(|&place| results[place].is_none())
                .collect();
            if pending.is_empty() {
                break;
            }
            let pending_requests: Vec<Request> = pending
                .iter()
                .map(|&place| requests[place].clone())
                .collect();
            match self.generate_all_with(&pending_requests, observer) {
                Ok(all) => {
                    for (place, generation) in pending.into_iter().zip(all) {
                        results[place] = Some(Ok(generation));
                    }
                }
                Err(Error::Failed(error)) => {
                    for (place, generation) in error.partial.finished {
                        results[pending[place]] = Some(Ok(generation));
                    }
                    results[pending[error.which.index]] = Some(Err(error.reason));
                }
                Err(Error::Stopped(mut stopped)) => {
                    let partial = &mut stopped.partial;
                    for unfinished in &mut partial.unfinished {
                        unfinished.request = pending[unfinished.request];
                    }
                    for (place, _) in &mut partial.finished {
                        *place = pending[*place];
                    }
                    let before = results.into_iter().enumerate();
                    let before = before.filter_map(|(place, result)| Some((place, result?.ok()?)));
                    partial.finished.extend(before);
                    partial.finished.sort_by_key(|&(request, _)| request);
                    return Err(Error::Stopped(stopped));
                }
                Err(error) => return Err(error),
            }
        }
        let results = results.into_iter();
        Ok(results
            .map(|result| result.expect("no request is pending"))
            .collect())
    }

    /// Checks whether this model can run a request. All functions that generate motions check their requests
    /// themselves before they run.
    ///
    /// # Errors
    ///
    /// If the request is invalid; the error says why.
    pub fn check(&self, request: &Request) -> Result<(), RequestError> {
        self.assign(&mut Vec::new(), 0, request)
    }

    /// Checks all requests and groups them into batches.
    pub(crate) fn groups(&self, requests: &[Request]) -> Result<Vec<JobGroup>, Error> {
        let mut groups = Vec::new();
        for (index, request) in requests.iter().enumerate() {
            self.assign(&mut groups, index, request)
                .map_err(|reason| Error::Request {
                    which: RequestIndex::new(requests, index),
                    reason,
                })?;
        }
        Ok(split_into_batches(groups, self.batch_size))
    }

    /// Checks the request at the place `index` and adds it to a group.
    fn assign(
        &self,
        groups: &mut Vec<JobGroup>,
        index: usize,
        request: &Request,
    ) -> Result<(), RequestError> {
        assign_to_group(
            groups,
            (index, request),
            &|prompt| self.stand_in(prompt).map(str::to_owned),
            (&self.network, &self.lengths()),
            &self.tokenizer,
            self.preset,
        )
    }
}

/// Returns the default batch size on a device.
// burn replaces ndarray by flex; while ndarray is still there, it counts as a CPU.
#[cfg_attr(feature = "ndarray", allow(deprecated))]
fn default_batch_size(device: &Device) -> usize {
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
        fn assert_shareable<T: Send + Sync>() {}
        assert_shareable::<LaMoGen>();
        assert_shareable::<Generation>();
        assert_shareable::<Error>();
    }
}
