//! Memory does not grow with the number of steps.

#![cfg(target_os = "linux")]

use lamogen::{Device, LaMoGen, Request, Tag};

/// The most memory that this process has held, in MiB.
fn peak() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find(|line| line.starts_with("VmHWM:"))
        .unwrap();
    let kib: usize = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    kib / 1024
}

#[test]
fn a_thousand_steps_take_no_more_memory_than_twenty() {
    let model = LaMoGen::embedded(&Device::flex()).unwrap();
    let request = Request::new("a person jumps").tag(Tag::Strong).frames(60);
    let peak_after = |steps: usize| {
        model.generate(&request.clone().steps(steps)).unwrap();
        peak()
    };
    peak_after(5);
    let few = peak_after(20);
    let many = peak_after(1000);
    println!("{few} MiB after 20 steps, {many} MiB after 1000");
    // One step's tape is about 2 MiB: a leak would show a hundred times over.
    assert!(
        many <= few + 8,
        "{few} MiB after 20 steps, {many} MiB after 1000"
    );
}
