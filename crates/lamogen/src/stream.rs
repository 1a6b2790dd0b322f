//! Motions that are made while they are watched.

use std::collections::VecDeque;
use std::ops::{ControlFlow, Range, RangeInclusive};

use lamogen_guide::{Body, Itinerary, Places};
use lamogen_laban::Goals;
use lamogen_model::{AnyNetwork, Denoiser};
use lamogen_motion::FRAMES_PER_SECOND;

use crate::error::{Error, RequestError, RequestIndex};
use crate::generation::{Generation, LaMoGen, Progress};
use crate::groups::{requested_goals, requested_guidance};
use crate::neighbours::{KNOWN_FRAMES, StretchEnd};
use crate::request::Request;
use crate::stretches::{
    Section, Sentence, ahead, itinerary, places_from, section_places, sections, stretch_request,
};

/// The largest number of frames of a stretch, unless the stream says otherwise: four seconds.
const LONGEST_STRETCH: usize = 80;

/// A motion that is made a stretch at a time, while new sentences and goals may still arrive
/// ([`LaMoGen::stream`]).
///
/// The stream is an iterator over stretches. Each begins where and as the one before ends, and the network sees the last 0.4 seconds of
/// that. A stretch is a sentence, or a part of one that is longer than the [longest stretch](Self::with_longest_stretch); its
/// frames are finished when it comes. When all sentences are made the iterator is at its end, and goes on after another
/// [`then`](Self::then).
///
/// ```no_run
/// use lamogen::{LaMoGen, Request, Tag};
///
/// let model = LaMoGen::embedded(&lamogen::Device::flex())?;
/// let walk = Request::new("a person walks forward").seconds(6.0).seed(7);
/// let mut stream = model.stream(&walk)?;
/// while let Some(stretch) = stream.next() {
///     let stretch = stretch?;
///     println!("{:?}: {}", stretch.frames, stretch.generation.guided.frames());
///     if stretch.frames.start == 0 {
///         // From the next stretch on.
///         stream.then(&Request::new("a person jumps").seconds(2.0).tag(Tag::Strong))?;
///     }
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct MotionStream<'m, D = AnyNetwork> {
    model: &'m LaMoGen<D>,
    /// The first request, whose options hold for all stretches.
    options: Request,
    /// The places that have been asked for.
    itinerary: Itinerary,
    /// Whether places have ever been asked for.
    is_led: bool,
    /// The sentences that are not finished, each with its place. The first may have begun.
    sentences: VecDeque<PendingSentence>,
    /// The number of sentences that have been added.
    added: usize,
    /// The end of the last stretch, with the goals that held there.
    end: Option<(StretchEnd, Goals)>,
    /// The number of stretches that have been made.
    stretches: usize,
    /// The number of frames that have been made.
    frames: usize,
    longest: usize,
}

/// A sentence of which some sections have not been made.
struct PendingSentence {
    place: usize,
    sentence: Sentence,
    sections: VecDeque<Range<usize>>,
}

impl PendingSentence {
    /// Returns the number of frames of the sentence that have been made.
    fn made(&self) -> usize {
        self.sections.front().map_or(0, |section| section.start)
    }
}

/// A stretch of a [`MotionStream`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Stretch {
    /// The frames among those of the whole stream.
    pub frames: Range<usize>,
    /// The place of the sentence among those that were added to the stream, from 0.
    pub sentence: usize,
    /// The motion of these frames, which stands where the one before ends, and all that is known about it. Its places are those at
    /// these frames, as they are counted in the whole stream.
    pub generation: Generation,
}

impl Stretch {
    /// Returns the time in seconds at which the stretch begins in the stream.
    pub fn seconds(&self) -> f32 {
        self.frames.start as f32 / FRAMES_PER_SECOND
    }
}

impl<D: Denoiser> LaMoGen<D> {
    /// Makes a motion a stretch at a time, so that its first frames are there long before its last. The request may have several
    /// sentences, and may [continue](Request::after) a motion; more can be added while the stream runs.
    ///
    /// A peak or a mean as a goal holds for each stretch on its own, because the later ones are not known. All other results are
    /// those of [`generate`](Self::generate) for one stretch after another, and the same requests give the same motion.
    ///
    /// # Errors
    ///
    /// If the request is invalid, is a loop, leads to a motion, has loss terms, or is of the network's own body, or the model makes a
    /// motion a window at a time.
    pub fn stream(&self, request: &Request) -> Result<MotionStream<'_, D>, Error> {
        let places = requested_guidance(request, self.preset()).places;
        let mut stream = MotionStream {
            model: self,
            is_led: !places.is_empty(),
            itinerary: itinerary(request, places),
            options: Request {
                following: Vec::new(),
                ..request.clone().without_places()
            },
            sentences: VecDeque::new(),
            added: 0,
            end: None,
            stretches: 0,
            frames: 0,
            longest: LONGEST_STRETCH.min(longest_stretch(self)),
        };
        stream.check(request)?;
        stream.push(request);
        Ok(stream)
    }
}

/// Returns the number of frames of the longest stretch that a network makes whole, with the frames that it sees of the one before.
fn longest_stretch<D: Denoiser>(model: &LaMoGen<D>) -> usize {
    model.lengths().end() - KNOWN_FRAMES.min(*model.lengths().end() / 2)
}

impl<D: Denoiser> MotionStream<'_, D> {
    /// Sets the length in seconds of the longest stretch: 4 by default, at least the shortest motion of the model and at most its longest
    /// less 0.4 seconds. Shorter stretches come sooner; a longer one shows more of its sentence, which every stretch of a long
    /// sentence begins anew. It holds for sentences that are added from now on, and for the first ones if no stretch has been
    /// made.
    pub fn with_longest_stretch(mut self, seconds: f32) -> Self {
        let frames = (seconds * FRAMES_PER_SECOND).round();
        let (shortest, longest) = (*self.model.lengths().start(), longest_stretch(self.model));
        self.longest = (frames as usize).clamp(shortest.min(longest), longest);
        if self.stretches == 0 {
            self.cut();
        }
        self
    }

    /// Cuts what has not been made of all sentences into sections.
    fn cut(&mut self) {
        let places = self.itinerary.frames(self.length());
        let lengths = self.section_lengths();
        let mut start = self.frames;
        for pending in &mut self.sentences {
            let made = pending.made();
            let left = pending.sentence.frames - made;
            let own = places_from(start, &places);
            let sections = sections(left, lengths.clone(), &own).into_iter();
            pending.sections = sections
                .map(|frames| made + frames.start..made + frames.end)
                .collect();
            start += left;
        }
    }

    /// Returns the number of frames that the stream has when all its sentences are made.
    fn length(&self) -> usize {
        let left =
            { self.sentences.iter() }.map(|pending| pending.sentence.frames - pending.made());
        self.frames + left.sum::<usize>()
    }

    /// Adds what comes next: a sentence with its length and its goals, or several.
    ///
    /// # Errors
    ///
    /// If the request is invalid or has other options, which are those of the first request.
    pub fn then(&mut self, request: &Request) -> Result<(), Error> {
        let alone = Request {
            following: Vec::new(),
            ..request.clone()
        };
        if !alone.is_segment() {
            return Err(self.refused(RequestError::SegmentOptions));
        }
        let mut whole = self.options.clone();
        whole.after = None;
        self.check(&whole.then(request.clone()))?;
        self.push(request);
        Ok(())
    }

    /// Leaves out all frames that have not been made yet, and goes on with this: a sentence with its length and its goals, or
    /// several.
    ///
    /// # Errors
    ///
    /// As [`then`](Self::then); the stream then goes on as if nothing had been asked.
    pub fn replace(&mut self, request: &Request) -> Result<(), Error> {
        let pending = std::mem::take(&mut self.sentences);
        let result = self.then(request);
        if result.is_err() {
            self.sentences = pending;
        }
        result
    }

    /// Sets the goals of the next stretch and of what follows of its sentence. They set in within the first second. At the end of
    /// the stream nothing happens.
    ///
    /// # Errors
    ///
    /// If the goals are invalid for these frames.
    pub fn steer(&mut self, goals: impl Into<Goals>) -> Result<(), Error> {
        let goals = goals.into();
        let Some(pending) = self.sentences.front() else {
            return Ok(());
        };
        let first = pending.made();
        let frames = pending.sentence.frames - first;
        let request = Request::new(&pending.sentence.prompt)
            .frames(frames)
            .scale(goals.clone());
        let guidance = requested_guidance(&self.options, self.model.preset());
        if let Err(reason) = goals.check(frames, &guidance.laban.end_effectors) {
            let which = RequestIndex::new(std::slice::from_ref(&request), 0);
            return Err(Error::Request {
                which,
                reason: reason.into(),
            });
        }
        if let Some(pending) = self.sentences.front_mut() {
            pending.sentence.goals = Some(goals);
            pending.sentence.frames = frames;
            for section in &mut pending.sections {
                *section = section.start - first..section.end - first;
            }
        }
        Ok(())
    }

    /// Leads what has not been made through these places, instead of those that were asked for before. Moments and positions are
    /// counted from where those of the first request are: the beginning of the stream, or the end of the motion that it
    /// continues. A place may be further on than the sentences that have been added; what comes before it is on the way there.
    ///
    /// ```no_run
    /// use lamogen::{LaMoGen, Places, Request};
    ///
    /// let model = LaMoGen::embedded(&lamogen::Device::flex())?;
    /// let walk = Request::new("a person walks forward").seconds(12.0);
    /// let mut stream = model.stream(&walk)?;
    /// let first = stream.next().transpose()?;
    /// // Two metres to the left, eight seconds after the stream began.
    /// stream.lead(Places { path: Some("8:2,4".parse()?), ..Places::default() })?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// If two places exclude each other, or one is at a moment that has been made.
    pub fn lead(&mut self, places: Places) -> Result<(), Error> {
        let itinerary = self.itinerary.with_places(places.clone());
        let checked = { places.check(Request::LONGEST_MOTION) }
            .and_then(|()| itinerary.check_from(self.frames));
        checked.map_err(|reason| self.refused(reason.into()))?;
        self.is_led |= !places.is_empty();
        self.itinerary = itinerary;
        self.cut();
        Ok(())
    }

    /// Returns the number of frames that have been made.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Makes the next stretch as the iterator does; `observer` is called after every step and may stop it.
    ///
    /// # Errors
    ///
    /// If numbers become infinite during the generation, or [`Error::Stopped`] if the observer stops it. The stretch is then not
    /// made, and the next call tries it again.
    pub fn next_with(
        &mut self,
        observer: &mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>,
    ) -> Option<Result<Stretch, Error>> {
        let pending = self.sentences.front()?;
        let frames = pending.sections.front()?.clone();
        let section = Section {
            sentence: 0,
            frames: frames.clone(),
        };
        let mut sentence = pending.sentence.clone();
        let goals = sentence.goals.clone();
        let end = self.end.clone().map(|(end, before)| StretchEnd {
            changes_goals: before != goals.clone().unwrap_or_default(),
            ..end
        });
        // After a guided stretch the motion of the text alone is elsewhere, and the guided one goes on from its own end. Places ask
        // for nothing of the components.
        if { end.as_ref() }.is_some_and(|end| end.baseline != end.guided) {
            let others = match self.is_led {
                true => Goals::anything(),
                false => Goals::default(),
            };
            sentence.goals = Some(goals.clone().unwrap_or(others));
        }
        let made = self.frames..self.frames + frames.len();
        let length = self.length();
        let request = section.request(&sentence);
        let mut request = stretch_request(&self.options, [request], self.stretches, end);
        request.places = section_places(&self.itinerary, (&made, length), &request);
        request.ahead = ahead(goals.is_some() || !self.itinerary.is_empty());
        let mut generation = match self.model.generate_with(&request, observer) {
            Ok(generation) => generation,
            Err(error) => return Some(Err(error)),
        };
        generation.places = self.itinerary.outcomes(&made, length, &generation.guided);
        let end = StretchEnd::of(&generation.baseline, &generation.guided, false);
        let place = pending.place;
        self.end = Some((end, goals.unwrap_or_default()));
        self.stretches += 1;
        self.frames = made.end;
        if let Some(pending) = self.sentences.front_mut() {
            pending.sections.pop_front();
            if pending.sections.is_empty() {
                self.sentences.pop_front();
            }
        }
        Some(Ok(Stretch {
            frames: made,
            sentence: place,
            generation,
        }))
    }

    /// Returns the lengths that sections of sentences have in frames.
    fn section_lengths(&self) -> RangeInclusive<usize> {
        *self.model.lengths().start()..=self.longest
    }

    /// Checks a request of the stream.
    fn check(&self, request: &Request) -> Result<(), Error> {
        let guidance = requested_guidance(request, self.model.preset());
        let found = [
            (
                self.model.network().window().is_some(),
                "a model that makes a motion a window at a time",
            ),
            (request.is_looped, "a loop"),
            (request.before.is_some(), "a motion to lead to"),
            (!guidance.loss_terms.is_empty(), "loss terms"),
            (guidance.body == Body::Network, "the network's own body"),
        ];
        if let Some((_, found)) = found.into_iter().find(|(is_there, _)| *is_there) {
            return Err(self.refused(RequestError::Stream { found }));
        }
        self.model
            .check(request)
            .map_err(|reason| self.refused(reason))
    }

    /// Makes the error of a request that cannot be a part of the stream.
    fn refused(&self, reason: RequestError) -> Error {
        Error::Request {
            which: RequestIndex::new(std::slice::from_ref(&self.options), 0),
            reason,
        }
    }

    /// Adds the sentences of a request that has been checked.
    fn push(&mut self, request: &Request) {
        for request in request.sentences() {
            let lengths = self.model.lengths();
            let frames = request
                .length
                .frames(*lengths.start(), Request::LONGEST_MOTION);
            let frames = frames.expect("the length of a checked request");
            let sentence = Sentence {
                prompt: request.prompt.clone(),
                frames,
                goals: requested_goals(request).expect("goals of a checked request"),
            };
            let start = self.length();
            let own = places_from(start, &self.itinerary.frames(start + frames));
            self.sentences.push_back(PendingSentence {
                place: self.added,
                sections: sections(frames, self.section_lengths(), &own).into(),
                sentence,
            });
            self.added += 1;
        }
    }
}

impl<D: Denoiser> Iterator for MotionStream<'_, D> {
    type Item = Result<Stretch, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_with(&mut |_| ControlFlow::Continue(()))
    }
}
