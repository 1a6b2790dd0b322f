//! Characters that the tests make, and files of theirs read back.

// Each test uses a part of them.
#![allow(dead_code, unused_imports)]

mod animated_file;
mod test_character;

pub use animated_file::AnimatedFile;
pub use test_character::{TestCharacter, characters, pack};
