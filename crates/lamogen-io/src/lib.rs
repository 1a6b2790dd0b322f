//! File handling that all of lamogen's crates share.
//!
//! [`write_atomically`] writes a file whole or not at all. [`remove_temporaries`] and [`remove_stale_temporaries`] remove
//! the temporary files of a stopped process. [`placeholder`] recognises Git LFS pointers and web pages that were stored
//! in place of a file.

mod atomic;
mod placeholder;

pub use atomic::{
    TEMPORARY_PREFIX, TemporaryPath, remove_stale_temporaries, remove_temporaries,
    replace_atomically, write_atomically,
};
pub use placeholder::{describe_placeholder_at, placeholder};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
