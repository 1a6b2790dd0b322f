//! `lamogen serve` while a task uses it.

use std::error::Error;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use serde_json::Value;

/// A server on a free port. It ends when this is dropped.
pub(crate) struct RunningServer {
    child: Child,
    /// `127.0.0.1` and the port.
    address: String,
}

impl RunningServer {
    /// Starts the command with options of `lamogen serve`, and waits until it answers.
    pub(crate) fn start<S: AsRef<std::ffi::OsStr>>(
        command: &Path,
        options: &[S],
    ) -> Result<RunningServer, Box<dyn Error>> {
        let child = Command::new(command)
            .args(["serve", "--port", "0", "--json"])
            .args(options)
            .stdout(Stdio::piped())
            .spawn()?;
        let mut server = RunningServer {
            child,
            address: String::new(),
        };
        let stdout = server.child.stdout.take();
        let mut line = String::new();
        BufReader::new(stdout.ok_or("expected a standard output")?).read_line(&mut line)?;
        let started: Value = serde_json::from_str(&line)?;
        let address = started["address"]
            .as_str()
            .ok_or("expected an address, found none")?;
        let address = address.trim_start_matches("http://").trim_end_matches('/');
        server.address = address.to_owned();
        Ok(server)
    }

    /// Returns `127.0.0.1` and the port.
    pub(crate) fn address(&self) -> &str {
        &self.address
    }

    /// Returns the number of the process.
    pub(crate) fn process(&self) -> u32 {
        self.child.id()
    }
}

impl Drop for RunningServer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
