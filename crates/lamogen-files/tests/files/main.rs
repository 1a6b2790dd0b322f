//! Files of lamogen and of other programs are written and read.

mod figure;
mod round_trip;
mod skeletons;
mod turning;
