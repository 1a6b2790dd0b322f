//! A work of a request, as the request sees it: its progress, its result, and its end when nobody waits for it any more.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::{oneshot, watch};

use crate::metrics::{JobOutcome, Metrics};
use crate::problem::{Problem, ProblemKind};
use crate::queue::{QueueError, WorkQueue};
use crate::service::{ProcessorShare, WorkError, WorkObserver, WorkProgress};

/// A work that waits or runs. Dropping it stops the work.
pub(crate) struct Job<T> {
    pub(crate) outcome: oneshot::Receiver<Result<T, Problem>>,
    /// The progress; its total is 0 until the work begins.
    pub(crate) progress: watch::Receiver<WorkProgress>,
    pub(crate) guard: JobGuard,
}

/// Stops a work when it is dropped.
pub(crate) struct JobGuard {
    queue: WorkQueue,
    number: u64,
    is_cancelled: Arc<AtomicBool>,
}

impl Drop for JobGuard {
    fn drop(&mut self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
        self.queue.remove(self.number);
    }
}

/// What ends works beside their own result: the end of the server, and their time.
#[derive(Clone)]
pub(crate) struct JobLimits {
    pub(crate) time: Duration,
    pub(crate) is_shut_down: Arc<AtomicBool>,
}

/// Adds a work to the queue.
///
/// # Errors
///
/// If the queue is full or closed.
pub(crate) fn start_job<T: Send + 'static>(
    queue: &WorkQueue,
    metrics: &Arc<Metrics>,
    limits: &JobLimits,
    work: impl FnOnce(ProcessorShare, WorkObserver<'_>) -> Result<T, WorkError> + Send + 'static,
) -> Result<Job<T>, Problem> {
    let (send_outcome, outcome) = oneshot::channel();
    let (send_progress, progress) = watch::channel(WorkProgress::default());
    let is_cancelled = Arc::new(AtomicBool::new(false));
    let (flag, limits, metrics_of_work) = (is_cancelled.clone(), limits.clone(), metrics.clone());
    let run = move |share: ProcessorShare| {
        let start = Instant::now();
        let mut is_late = false;
        let mut observer = |progress| {
            send_progress.send_replace(progress);
            is_late = start.elapsed() > limits.time;
            let is_over = is_late
                || flag.load(Ordering::Relaxed)
                || limits.is_shut_down.load(Ordering::Relaxed);
            match is_over {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        };
        let result = catch_unwind(AssertUnwindSafe(|| work(share, &mut observer)));
        let (result, outcome) = match result {
            Ok(Ok(result)) => (Ok(result), JobOutcome::Done),
            Ok(Err(WorkError::Failed(problem))) => (Err(problem), JobOutcome::Failed),
            Ok(Err(WorkError::Stopped)) if is_late => {
                let seconds = limits.time.as_secs_f64();
                let expected = format!("a work of at most {seconds} s");
                let problem = Problem::mismatch(ProblemKind::TimeLimit, expected, "a longer one");
                (Err(problem), JobOutcome::TimedOut)
            }
            Ok(Err(WorkError::Stopped)) => (Err(ending()), JobOutcome::Cancelled),
            Err(_) => {
                let detail = "the work ended by an error in the program";
                let problem = Problem::new(ProblemKind::Internal, detail);
                (Err(problem), JobOutcome::Failed)
            }
        };
        metrics_of_work.count_job(outcome, start.elapsed());
        // The client may have gone.
        let _ = send_outcome.send(result);
    };
    let number = queue.push(Box::new(run)).map_err(|error| match error {
        QueueError::Full { waiting, seconds } => {
            metrics.count_rejection();
            let detail =
                format!("{waiting} requests wait already; {seconds} s from now one may be done");
            Problem::new(ProblemKind::Busy, detail).retry_after(seconds)
        }
        QueueError::Closed => ending(),
    })?;
    let guard = JobGuard {
        queue: queue.clone(),
        number,
        is_cancelled,
    };
    Ok(Job {
        outcome,
        progress,
        guard,
    })
}

impl<T> Job<T> {
    /// Waits for the result.
    pub(crate) async fn result(self) -> Result<T, Problem> {
        let _guard = self.guard;
        // The queue drops works when the server ends.
        self.outcome.await.unwrap_or_else(|_| Err(ending()))
    }
}

/// Makes the problem of a work that the end of the server has stopped.
pub(crate) fn ending() -> Problem {
    let detail = "the server is ending and takes no more work";
    Problem::new(ProblemKind::ShuttingDown, detail)
}
