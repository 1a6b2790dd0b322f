//! What all of lamogen's crates do with files.
//!
//! [`write_atomically`] writes a file whole or not at all; [`remove_temporaries`] and [`remove_stale_temporaries`] take care of what a stopped
//! process leaves. [`placeholder`] says what a file is that takes the place of the one it is named after.

mod atomic;
mod placeholder;

pub use atomic::{
    TEMPORARY_PREFIX, TemporaryFile, remove_stale_temporaries, remove_temporaries,
    replace_atomically, write_atomically,
};
pub use placeholder::{placeholder, placeholder_at};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
