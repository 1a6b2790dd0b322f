//! `lamogen convert`.

use std::ops::ControlFlow;

use indicatif::ProgressBar;
use lamogen::Motion;
use lamogen::body::{FitInput, FitOptions, ground};
use lamogen::motion::RestPose;
use serde_json::json;

use crate::arguments::Convert;
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::opened::open;
use crate::source::device;

pub fn run(options: &Convert, console: &Console) -> Result<(), Failure> {
    options.to.check()?;
    for unused in options.writing.unused(&[options.to.format]) {
        console.notice(unused);
    }
    let mut opened = open(&options.source, &options.reading, &device(None)?, console)?;
    if !opened.assumed.is_empty() {
        console.notice(format!("Read with {}.", opened.assumed));
    }
    if options.clean_feet {
        let bar = console.bar("steps");
        let motion = clean_feet(&opened.scene.main().motion, &bar)?;
        bar.finish_and_clear();
        opened.scene.replace_main(motion, &device(None)?);
    }
    options.to.write(&opened.scene, &options.writing, console)?;
    let motion = &opened.scene.main().motion;
    if console.json {
        let (from, to) = (
            options.source.to_string_lossy(),
            options.to.path.to_string_lossy(),
        );
        let result = json!({ "from": from, "to": to, "frames": motion.frames(), "seconds": motion.seconds() });
        return console.say(result.to_string());
    }
    console.say(format!("{}: {:.2} s", options.to, motion.seconds()))
}

/// The motion of a rigid body with the motion's own bones, whose feet stand where they stand.
fn clean_feet(motion: &Motion, bar: &ProgressBar) -> Result<Motion, Failure> {
    let input = FitInput {
        motion,
        body: &RestPose::of(motion),
        ground: ground(motion),
    };
    let mut fitted = FitOptions::default().run(&[input], None, &mut |progress| {
        bar.set_length(progress.total as u64);
        bar.set_position(progress.done as u64);
        ControlFlow::Continue(())
    });
    let rotations = fitted.rotations.pop().expect("one motion was fitted");
    Motion::from_rotations(rotations).map_err(|error| Failure::new(Code::Run, error))
}
