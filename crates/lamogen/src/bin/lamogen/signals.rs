//! What happens when the command is told to end.

use lamogen::motion::remove_temporaries;

/// Exit code of a command that a signal ended: what shells say of Ctrl-C.
pub const INTERRUPTED: i32 = 130;

/// Ends the command on Ctrl-C and requests to terminate, after files that are not whole yet are removed.
pub fn clean_up_on_signals() {
    // Without a handler the command works as well, and leaves files behind.
    let _ = ctrlc::set_handler(end);
}

/// Removes files that are not whole yet, and ends the command.
pub fn end() {
    remove_temporaries();
    std::process::exit(INTERRUPTED);
}
