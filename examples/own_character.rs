//! Puts a guided motion on a rigged character and prints how its bones turn.
//!
//! ```sh
//! cargo run --release --example own_character -- hero.glb hero_jump.glb
//! ```
//!
//! Without arguments the character is a rig that lamogen writes itself, in `target/own_character`.

use std::error::Error;
use std::path::PathBuf;

use lamogen::character::{Character, CharacterOptions, RetargetOptions, SaveOptions};
use lamogen::files::WriteOptions;
use lamogen::{Device, LaMoGen, Request, Tag};

fn main() -> Result<(), Box<dyn Error>> {
    let model = LaMoGen::embedded(&Device::flex())?;
    let request = Request::new("a person jumps")
        .tag(Tag::Strong)
        .seconds(3.0)
        .seed(7);
    let jump = model.generate(&request)?;

    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [character, out] = match <[PathBuf; 2]>::try_from(paths) {
        Ok(paths) => paths,
        Err(paths) if paths.is_empty() => {
            let folder = PathBuf::from("target/own_character");
            std::fs::create_dir_all(&folder)?;
            let rig = folder.join("rig.glb");
            lamogen::files::write(&rig, &jump.baseline, &WriteOptions::default())?;
            [rig, folder.join("rig_jump.glb")]
        }
        Err(paths) => {
            let found = paths.len();
            return Err(
                format!("expected a character and a file to write, found {found} paths").into(),
            );
        }
    };

    let hero = Character::open(&character, &CharacterOptions::default())?;
    println!(
        "{}: joints as {}, legs of {:.2} m",
        character.display(),
        hero.scheme(),
        hero.leg_length()
    );
    let animation = hero
        .animate(&jump.guided, &RetargetOptions::default())?
        .named("jump");
    // An engine that has a skeleton of its own needs no file: these are the rotations relative to the parent bone.
    for bone in &animation.bones {
        let [x, y, z, w] = bone.rotations[animation.frames() / 2];
        println!("{:>16}  {x:+.3} {y:+.3} {z:+.3} {w:+.3}", bone.name);
    }
    hero.save(&out, &[animation], &SaveOptions::default())?;
    println!("{}", out.display());
    Ok(())
}
