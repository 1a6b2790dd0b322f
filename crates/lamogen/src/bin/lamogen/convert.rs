//! `lamogen convert`.

use serde_json::json;

use crate::arguments::Convert;
use crate::console::Console;
use crate::failure::Failure;
use crate::opened::open;
use crate::source::device;

pub fn run(options: &Convert, console: &Console) -> Result<(), Failure> {
    options.to.check()?;
    let opened = open(&options.from, &options.reading, &device(None)?)?;
    if !opened.assumed.is_empty() {
        console.notice(format!("Read with {}.", opened.assumed));
    }
    options.to.write(&opened.scene, &options.writing, console)?;
    let motion = &opened.scene.main().motion;
    if console.json {
        let (from, to) = (
            options.from.to_string_lossy(),
            options.to.path.to_string_lossy(),
        );
        let result = json!({ "from": from, "to": to, "frames": motion.frames(), "seconds": motion.seconds() });
        return console.say(result.to_string());
    }
    console.say(format!("{}: {:.2} s", options.to, motion.seconds()))
}
