//! Handling of signals that end the command.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use lamogen::motion::remove_temporaries;

use crate::console::print_to_stderr;

/// Exit code of a command that a signal ended: the one that shells report after Ctrl-C.
pub const INTERRUPTED: i32 = 130;

/// Installs a handler that removes incomplete files and ends the command on Ctrl-C and on termination signals.
pub fn clean_up_on_signals() {
    // If no handler can be installed, the command still works, but may leave incomplete files behind.
    let _ = ctrlc::set_handler(clean_up_and_exit);
}

/// Installs a handler that asks for a stop on the first signal, and ends the command at once on the second one. Where the
/// command does not [heed](StopRequest::heed) the request, the first signal ends it.
pub fn stop_on_signals() -> StopRequest {
    let request = StopRequest::default();
    let handled = request.clone();
    // If no handler can be installed, the command still works, but a signal may leave incomplete files behind.
    let _ = ctrlc::set_handler(move || {
        if !handled.is_heeded.load(Ordering::Relaxed) || handled.asked.swap(true, Ordering::Relaxed)
        {
            clean_up_and_exit();
        }
        print_to_stderr("Stopping after this step; once more stops at once.");
    });
    request
}

/// Whether the user has asked for a stop.
#[derive(Clone, Debug, Default)]
pub struct StopRequest {
    asked: Arc<AtomicBool>,
    is_heeded: Arc<AtomicBool>,
}

impl StopRequest {
    /// Sets whether the command asks for the [control flow](Self::control_flow) again and again from here on.
    pub fn heed(&self, is_heeded: bool) {
        self.is_heeded.store(is_heeded, Ordering::Relaxed);
    }

    /// Returns what an observer answers: to break off once a stop is asked for.
    pub fn control_flow(&self) -> ControlFlow<()> {
        match self.asked.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}

/// Removes incomplete files, and ends the command.
pub fn clean_up_and_exit() {
    remove_temporaries();
    std::process::exit(INTERRUPTED);
}
