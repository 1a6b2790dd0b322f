//! `lamogen completions` and `lamogen man`: prints shell completions and manual pages.

use std::path::Path;

use clap::CommandFactory;
use clap_complete::Shell;

use crate::arguments::Arguments;
use crate::console::Console;
use crate::failure::{Failure, FailureCode};

/// Prints the completions of a shell.
pub fn completions(shell: Shell, console: &Console) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "lamogen", &mut text);
    console.print(String::from_utf8_lossy(&text))
}

/// Prints the manual page, or writes the pages of all subcommands to a folder.
pub fn man(out: Option<&Path>, console: &Console) -> Result<(), Failure> {
    let command = Arguments::command();
    let Some(folder) = out else {
        let mut page = Vec::new();
        clap_mangen::Man::new(command)
            .render(&mut page)
            .map_err(|error| Failure::new(FailureCode::Output, error))?;
        return console.print(String::from_utf8_lossy(&page));
    };
    std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(command, folder))
        .map_err(|error| Failure::output(folder, error))
}
