//! `lamogen devices`: lists the available devices.

use lamogen::DeviceName;
use serde_json::json;

use crate::console::Console;
use crate::failure::Failure;

/// Runs `lamogen devices`.
pub fn run(console: &Console) -> Result<(), Failure> {
    let names: Vec<String> = DeviceName::available()
        .iter()
        .map(DeviceName::to_string)
        .collect();
    if console.json {
        return console.print(json!({ "devices": names, "default": names.first() }).to_string());
    }
    for (place, name) in names.iter().enumerate() {
        let default = if place == 0 {
            "  (used unless --device says another)"
        } else {
            ""
        };
        console.print(format!("{name}{default}"))?;
    }
    let about = "Backends are features of the build: cargo install … --features wgpu, vulkan, cuda, metal or rocm.";
    console.notice(about);
    Ok(())
}
