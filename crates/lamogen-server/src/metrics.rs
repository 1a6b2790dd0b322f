//! What the server has done, in Prometheus' text format.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// How a work ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum JobOutcome {
    Done,
    Failed,
    Cancelled,
    TimedOut,
}

impl JobOutcome {
    const ALL: [JobOutcome; 4] = [
        JobOutcome::Done,
        JobOutcome::Failed,
        JobOutcome::Cancelled,
        JobOutcome::TimedOut,
    ];

    fn name(self) -> &'static str {
        match self {
            JobOutcome::Done => "done",
            JobOutcome::Failed => "failed",
            JobOutcome::Cancelled => "cancelled",
            JobOutcome::TimedOut => "timed_out",
        }
    }
}

/// The upper ends of the buckets of seconds.
const BUCKETS: [f64; 10] = [0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0];

/// The counters of a server.
#[derive(Default)]
pub(crate) struct Metrics {
    counts: Mutex<Counts>,
}

#[derive(Default)]
struct Counts {
    /// The number of answers by path and status.
    answers: BTreeMap<(&'static str, u16), u64>,
    outcomes: BTreeMap<JobOutcome, u64>,
    rejected: u64,
    /// The number of finished works in each bucket of seconds, without those of the buckets before.
    buckets: [u64; BUCKETS.len() + 1],
    seconds: f64,
}

impl Metrics {
    /// Counts an answer. `path` is one of the paths of the server, so that clients cannot make new ones.
    pub(crate) fn count_answer(&self, path: &'static str, status: u16) {
        *self.lock().answers.entry((path, status)).or_default() += 1;
    }

    /// Counts a request that found the queue full.
    pub(crate) fn count_rejection(&self) {
        self.lock().rejected += 1;
    }

    /// Counts a work that ended. Only those that are done count into the times.
    pub(crate) fn count_job(&self, outcome: JobOutcome, time: Duration) {
        let mut counts = self.lock();
        *counts.outcomes.entry(outcome).or_default() += 1;
        if outcome == JobOutcome::Done {
            let seconds = time.as_secs_f64();
            let bucket = BUCKETS.iter().position(|&end| seconds <= end);
            counts.buckets[bucket.unwrap_or(BUCKETS.len())] += 1;
            counts.seconds += seconds;
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Counts> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Formats all counters. `waiting` and `running` are the numbers of works now.
    pub(crate) fn text(&self, [waiting, running]: [usize; 2]) -> String {
        let counts = self.lock();
        let mut text = String::new();
        let mut metric = |name: &str, kind: &str, help: &str, lines: &[String]| {
            let name = format!("lamogen_{name}");
            let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
            for line in lines {
                let _ = writeln!(text, "{name}{line}");
            }
        };
        let answers = counts.answers.iter().map(|((path, status), count)| {
            format!("{{path=\"{path}\",status=\"{status}\"}} {count}")
        });
        metric(
            "answers_total",
            "counter",
            "Answers by path and status.",
            &answers.collect::<Vec<_>>(),
        );
        let outcomes = JobOutcome::ALL.map(|outcome| {
            let count = counts.outcomes.get(&outcome).copied().unwrap_or(0);
            format!("{{outcome=\"{}\"}} {count}", outcome.name())
        });
        metric(
            "jobs_total",
            "counter",
            "Works that ended: motions generated and files measured.",
            &outcomes,
        );
        metric(
            "rejected_total",
            "counter",
            "Requests that found the queue full.",
            &[format!(" {}", counts.rejected)],
        );
        metric(
            "jobs_waiting",
            "gauge",
            "Works that wait.",
            &[format!(" {waiting}")],
        );
        metric(
            "jobs_running",
            "gauge",
            "Works that run.",
            &[format!(" {running}")],
        );
        let mut sum = 0;
        let mut times: Vec<String> = Vec::new();
        for (place, count) in counts.buckets.iter().enumerate() {
            sum += count;
            let end = BUCKETS.get(place).map_or("+Inf".to_owned(), f64::to_string);
            times.push(format!("_bucket{{le=\"{end}\"}} {sum}"));
        }
        times.push(format!("_sum {}", counts.seconds));
        times.push(format!("_count {sum}"));
        metric(
            "job_seconds",
            "histogram",
            "Seconds that a work took, without its time in the queue.",
            &times,
        );
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_are_cumulative_and_only_finished_works_are_timed() {
        let metrics = Metrics::default();
        metrics.count_answer("/health", 200);
        metrics.count_answer("/health", 200);
        metrics.count_job(JobOutcome::Done, Duration::from_millis(200));
        metrics.count_job(JobOutcome::Done, Duration::from_secs(100));
        metrics.count_job(JobOutcome::Cancelled, Duration::from_secs(1));
        let text = metrics.text([3, 1]);
        for line in [
            "lamogen_answers_total{path=\"/health\",status=\"200\"} 2",
            "lamogen_jobs_total{outcome=\"done\"} 2",
            "lamogen_jobs_total{outcome=\"cancelled\"} 1",
            "lamogen_jobs_waiting 3",
            "lamogen_job_seconds_bucket{le=\"0.1\"} 0",
            "lamogen_job_seconds_bucket{le=\"0.25\"} 1",
            "lamogen_job_seconds_bucket{le=\"60\"} 1",
            "lamogen_job_seconds_bucket{le=\"+Inf\"} 2",
            "lamogen_job_seconds_count 2",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
    }
}
