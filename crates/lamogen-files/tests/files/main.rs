//! Files as they are written, read and brought from elsewhere.

mod figure;
mod round_trip;
mod skeletons;
mod turning;
