//! Motion as files: what animators, engines and researchers open, and what they bring.
//!
//! ```text
//! .bvh ──┐                 names          body              unit, axes, 20 fps
//! .glb ──┴──▶ clip of any ──────▶ nodes ──────▶ 22 joints ─────────────────────▶ Motion
//! .npy ────────────────────────────────────────────────────────────────────────▶ Motion
//!
//! Motion ──Rotations──▶ .bvh, .glb;  Motion ──▶ .npy;  LabanSeries ──▶ .csv
//! ```
//!
//! [`read`](read()) and [`write`](write()) choose the format by the end of the file's name. `read` recognises the
//! skeleton by its joints' names, guesses unit and axes by the body, and [tells](ImportedMotion) what it
//! took for granted; [`ReadOptions`] say it instead.

mod body;
pub mod bvh;
mod clip;
pub mod csv;
mod error;
mod format;
pub mod glb;
mod import;
mod mapping;
mod names;
mod near;
mod npy;
mod plausibility;
mod schemes;
mod units;

pub use error::{ReadError, WriteError};
pub use format::{WriteOptions, read, write};
pub use import::{ImportedMotion, ReadOptions};
pub use mapping::{JointMapping, MappingError};
pub use names::UnknownSkeleton;
pub use plausibility::ImportNotice;
pub use units::{Unit, UnitError, Up, UpError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
