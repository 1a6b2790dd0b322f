//! Files of the motions before and after a generated one.

use std::path::Path;

use lamogen_files::{ReadError, ReadOptions, read};
use lamogen_motion::Motion;

use crate::request::Request;

/// The motion that a request continues and the one that it leads to, as far as there are any.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Neighbours {
    /// The motion that the request continues.
    pub after: Option<Motion>,
    /// The motion that the request leads to.
    pub before: Option<Motion>,
}

impl Neighbours {
    /// Reads them from motion files.
    ///
    /// # Errors
    ///
    /// If a file cannot be read.
    pub fn read(after: Option<&Path>, before: Option<&Path>) -> Result<Neighbours, ReadError> {
        let motion = |path| read(path, &ReadOptions::default()).map(|imported| imported.motion);
        Ok(Neighbours {
            after: after.map(motion).transpose()?,
            before: before.map(motion).transpose()?,
        })
    }

    /// Sets the motions on a request.
    pub fn apply(&self, mut request: Request) -> Request {
        if let Some(motion) = &self.after {
            request = request.after(motion);
        }
        if let Some(motion) = &self.before {
            request = request.before(motion);
        }
        request
    }
}
