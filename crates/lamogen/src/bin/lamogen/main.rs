//! The command `lamogen`.
fn main() {}
