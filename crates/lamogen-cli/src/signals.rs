//! Handling of signals that end the command.

use lamogen::motion::remove_temporaries;

/// Exit code of a command that a signal ended: the one that shells report after Ctrl-C.
pub const INTERRUPTED: i32 = 130;

/// Installs a handler that removes incomplete files and ends the command on Ctrl-C and on termination signals.
pub fn clean_up_on_signals() {
    // If no handler can be installed, the command still works, but may leave incomplete files behind.
    let _ = ctrlc::set_handler(clean_up_and_exit);
}

/// Removes incomplete files, and ends the command.
pub fn clean_up_and_exit() {
    remove_temporaries();
    std::process::exit(INTERRUPTED);
}
