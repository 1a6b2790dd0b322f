//! Reads and writes motions as files that animators, game engines and researchers use.
//!
//! ```text
//! .bvh ──┐                 names          body              unit, axes, 20 fps
//! .glb ──┤
//! .vrma ─┴──▶ clip of any ──────▶ nodes ──────▶ 22 joints ─────────────────────▶ Motion
//! .npy ────────────────────────────────────────────────────────────────────────▶ Motion
//!
//! Motion ──Rotations──▶ .bvh, .glb, .vrma;  Motion ──▶ .npy;  LabanSeries ──▶ .csv
//! ```
//!
//! [`read`](read()) and [`write`](write()) choose the format by the extension of the file's name. `read` recognises
//! the skeleton by the names of its joints and guesses the unit and the axes from the size and pose of the body.
//! [`ImportedMotion`] reports these guesses; [`ReadOptions`] can replace them by known values.

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
mod npy;
mod plausibility;
mod schemes;
mod similar_names;
mod skeleton;
mod units;
pub mod vrma;

pub use error::{ReadError, WriteError};
pub use format::{WriteOptions, read, read_bytes, write, write_bytes};
pub use import::{ImportedMotion, ReadOptions};
pub use mapping::{JointMapping, MappingError};
pub use names::UnknownSkeleton;
pub use plausibility::ImportNotice;
pub use skeleton::{SkeletonError, SkeletonJoints, SkeletonNode, find_joints};
pub use units::{Unit, UnitError, UpAxis, UpAxisError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
