//! The fuzz targets of lamogen.

pub mod targets;
