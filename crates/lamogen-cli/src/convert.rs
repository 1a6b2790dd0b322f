//! `lamogen convert`: converts a motion file to another format.

use std::ops::ControlFlow;

use indicatif::ProgressBar;
use lamogen::Motion;
use lamogen::body::{FitInput, FitOptions, ground};
use lamogen::motion::RestPose;
use serde_json::json;

use crate::arguments::ConvertArguments;
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::motion_file::open_motion_file;
use crate::source::open_device;

/// Runs `lamogen convert`.
pub fn run(options: &ConvertArguments, console: &Console) -> Result<(), Failure> {
    options.to.check()?;
    options.writing.check(&[options.to.format])?;
    for notice in options.writing.notices(&[options.to.format]) {
        console.notice(notice);
    }
    let mut file = open_motion_file(
        &options.source,
        &options.reading,
        &open_device(None)?,
        console,
    )?;
    if !file.assumptions.is_empty() {
        console.notice(format!("Read with {}.", file.assumptions));
    }
    if options.clean_feet {
        let bar = console.progress_bar("steps");
        let motion = clean_feet(&file.scene.main().motion, &bar)?;
        bar.finish_and_clear();
        file.scene.replace_main(motion, &open_device(None)?);
    }
    file.scene.set_root_motion(options.writing.root_motion());
    let mut writing = options.writing.clone();
    if let Some(stem) = options.source.file_stem() {
        let name = || stem.to_string_lossy().into_owned();
        writing.onto.animation_name.get_or_insert_with(name);
    }
    options.to.write(&file.scene, &writing, console)?;
    let motion = &file.scene.main().motion;
    if console.json {
        let (from, to) = (
            options.source.to_string_lossy(),
            options.to.path.to_string_lossy(),
        );
        let result = json!({ "from": from, "to": to, "frames": motion.frames(), "seconds": motion.seconds() });
        return console.print(result.to_string());
    }
    console.print(format!("{}: {:.2} s", options.to, motion.seconds()))
}

/// Fits a rigid body to a motion. The body has the bones of the motion, and its feet neither slide nor sink into the
/// ground while they stand.
fn clean_feet(motion: &Motion, bar: &ProgressBar) -> Result<Motion, Failure> {
    let input = FitInput {
        motion,
        body: &RestPose::of(motion),
        ground: ground(motion),
        start: None,
    };
    let mut fitted = FitOptions::default().run(&[input], None, &mut |progress| {
        bar.set_length(progress.total as u64);
        bar.set_position(progress.done as u64);
        ControlFlow::Continue(())
    });
    let rotations = fitted.rotations.pop().expect("one motion was fitted");
    Motion::from_rotations(rotations).map_err(|error| Failure::new(FailureCode::Run, error))
}
