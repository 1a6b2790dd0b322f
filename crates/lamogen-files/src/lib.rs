//! Motion as files.

mod clip;
pub mod csv;
pub mod glb;
