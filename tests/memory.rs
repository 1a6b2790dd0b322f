//! Memory does not grow with the number of steps.

#![cfg(target_os = "linux")]

use lamogen::{Device, LaMoGen, Request, Tag};
use xtask::bench::peak_memory;

#[test]
fn a_thousand_steps_take_no_more_memory_than_twenty() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let request = Request::new("a person jumps").tag(Tag::Strong).frames(60);
    let peak_after = |steps: usize| {
        model.generate(&request.clone().steps(steps)).unwrap();
        peak_memory().unwrap()
    };
    // Scales and shifts of the last conditions are kept, four mebibytes of them; this many steps fill that place.
    peak_after(200);
    let few = peak_after(20);
    let many = peak_after(1000);
    println!("{few:.0} MiB after 20 steps, {many:.0} MiB after 1000");
    // One step's tape is about 2 MiB: a leak would show a hundred times over.
    assert!(
        many <= few + 8.0,
        "{few:.0} MiB after 20 steps, {many:.0} MiB after 1000"
    );
}
