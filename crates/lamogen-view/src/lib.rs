//! Pictures of motion: stick-figure strips and Laban curves
