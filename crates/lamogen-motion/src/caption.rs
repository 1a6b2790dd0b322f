//! Texts of a motion over time.

use std::fmt;
use std::ops::Range;

use crate::FRAMES_PER_SECOND;

/// A text that says what happens in some of the frames of a motion, such as one of several sentences.
///
/// It is displayed with its time: `3.00 to 5.00 s: a person jumps`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct TimedCaption {
    /// The text.
    pub text: String,
    /// The frames for which it holds, from 0.
    pub frames: Range<usize>,
}

impl TimedCaption {
    /// Creates the caption of some frames.
    pub fn new(text: impl Into<String>, frames: Range<usize>) -> Self {
        TimedCaption {
            text: text.into(),
            frames,
        }
    }

    /// Returns the place of the caption that holds at a frame. If several do, it is the first one.
    ///
    /// ```
    /// use lamogen_motion::TimedCaption;
    ///
    /// let captions = [TimedCaption::new("walks", 0..3), TimedCaption::new("jumps", 3..5)];
    /// let at = [0, 2, 3, 4, 5].map(|frame| TimedCaption::position(&captions, frame));
    /// assert_eq!(at, [Some(0), Some(0), Some(1), Some(1), None]);
    /// ```
    pub fn position(captions: &[TimedCaption], frame: usize) -> Option<usize> {
        let mut captions = captions.iter();
        captions.position(|caption| caption.frames.contains(&frame))
    }
}

impl fmt::Display for TimedCaption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from, until] =
            [self.frames.start, self.frames.end].map(|frame| frame as f32 / FRAMES_PER_SECOND);
        write!(f, "{from:.2} to {until:.2} s: {}", self.text)
    }
}
