//! The work behind the HTTP interface.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use serde_json::Value;

use crate::problem::Problem;

/// The work that a [`Server`](crate::Server) is asked for: motions from requests, measurements of motion files, and
/// characters for motions. Its
/// functions run on threads of their own and may block.
pub trait MotionService: Send + Sync + 'static {
    /// A request for a motion that has been parsed and checked.
    type Request: Send + 'static;

    /// Returns the media types in which motions can be answered. The first is that of clients that accept any.
    fn media_types(&self) -> &'static [&'static str];

    /// Returns the description of the model, as JSON.
    fn model(&self) -> Value;

    /// Parses and checks a request before it waits for its turn, on one of a few threads for this. It must return soon.
    ///
    /// # Errors
    ///
    /// If the text is not a valid request.
    fn parse(&self, json: &str) -> Result<Self::Request, Problem>;

    /// Generates the motion of a request and returns it in a media type, on its share of the processors; the motion must not
    /// depend on the share. `observer` is called after every step; if it breaks, the work stops with [`WorkError::Stopped`].
    ///
    /// # Errors
    ///
    /// If the motion cannot be generated or written.
    fn generate(
        &self,
        request: &Self::Request,
        media_type: &str,
        share: ProcessorShare,
        observer: WorkObserver<'_>,
    ) -> Result<Vec<u8>, WorkError>;

    /// Measures an uploaded motion file and returns its report as JSON.
    ///
    /// # Errors
    ///
    /// If the file or an option cannot be read.
    fn measure(&self, file: &UploadedFile) -> Result<Value, Problem>;

    /// Reads an uploaded character, keeps it for requests that name it, and returns as JSON its name and what a page needs to draw it.
    /// A service keeps a bounded number of characters.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, or has no character.
    fn add_character(&self, file: &UploadedFile) -> Result<Value, Problem>;
}

/// A function that is called with the progress of a work and may stop it.
pub type WorkObserver<'o> = &'o mut (dyn FnMut(WorkProgress) -> ControlFlow<()> + Send);

/// The share of the processors that a work may use: all of them, or an equal part where several works run at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessorShare {
    works: usize,
}

impl ProcessorShare {
    /// Makes the share of one of so many works.
    pub(crate) fn one_of(works: usize) -> ProcessorShare {
        ProcessorShare { works }
    }

    /// Returns whether the work has all processors.
    pub fn is_all(&self) -> bool {
        self.works == 1
    }

    /// Returns the number of threads of the share, of so many threads for all works; at least 1.
    pub fn of(&self, threads: usize) -> usize {
        (threads / self.works).max(1)
    }
}

/// How far a work is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorkProgress {
    /// The number of finished steps.
    pub done: usize,
    /// The largest number of steps that the work can take.
    pub total: usize,
    /// The name of the part of the work that is going on.
    pub stage: &'static str,
}

/// Why a work has no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WorkError {
    /// The observer stopped the work.
    Stopped,
    /// The work failed.
    Failed(Problem),
}

impl From<Problem> for WorkError {
    fn from(problem: Problem) -> Self {
        WorkError::Failed(problem)
    }
}

/// A file in the body of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UploadedFile {
    /// The options in the query of the address, such as `name=dance.bvh`.
    pub options: BTreeMap<String, String>,
    /// The content of the file.
    pub bytes: Vec<u8>,
}
