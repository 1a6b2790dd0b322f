//! Motion as files.

mod clip;
