//! Texts of a motion over time.

use std::ops::Range;

/// A text that says what happens in some of the frames of a motion, such as one of several sentences.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Caption<'a> {
    /// The text.
    pub text: &'a str,
    /// The frames for which it holds, from 0.
    pub frames: Range<usize>,
}
