//! The queue of works, and the threads that do them: one work with all processors, or several that share them.
//!
//! A work that is alone is done with all processors, and nothing else runs beside it. If others wait when it begins, they run side
//! by side, each with its share: threads that work for different motions never wait for each other, so that more gets done.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::service::ProcessorShare;

/// A work that waits for its turn. It is told its share of the processors.
type Work = Box<dyn FnOnce(ProcessorShare) + Send>;

/// A bounded queue, first in, first out. It is shared by all its clones.
#[derive(Clone)]
pub(crate) struct WorkQueue {
    shared: Arc<Shared>,
}

struct Shared {
    state: Mutex<State>,
    /// Something was added or finished, or the queue was closed.
    changed: Condvar,
    capacity: usize,
    workers: usize,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<(u64, Work)>,
    running: usize,
    /// Whether the work that runs has all processors.
    is_one_alone: bool,
    next_number: u64,
    is_closed: bool,
    /// A moving average of the seconds that a work takes.
    mean_seconds: f64,
}

/// Why a work was not added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum QueueError {
    /// So many works wait already as are allowed. The first of them will probably be finished after so many seconds.
    Full { waiting: usize, seconds: u32 },
    /// The queue was closed.
    Closed,
}

/// The weight of the last work in the average of seconds.
const AVERAGE_WEIGHT: f64 = 0.2;

impl WorkQueue {
    /// Makes a queue in which so many works may wait, and starts its threads.
    pub(crate) fn start(capacity: usize, workers: usize) -> std::io::Result<WorkQueue> {
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            changed: Condvar::new(),
            capacity,
            workers,
        });
        for number in 0..workers {
            let shared = shared.clone();
            let name = format!("work-{number}");
            thread::Builder::new()
                .name(name)
                .spawn(move || shared.work())?;
        }
        Ok(WorkQueue { shared })
    }

    /// Adds a work. Returns its number.
    pub(crate) fn push(&self, work: Work) -> Result<u64, QueueError> {
        let mut state = self.shared.lock();
        if state.is_closed {
            return Err(QueueError::Closed);
        }
        let waiting = state.waiting.len();
        let idle = self.shared.workers.saturating_sub(state.running);
        if waiting >= self.shared.capacity + idle {
            let turns = (waiting + 1).div_ceil(self.shared.workers);
            let seconds = (state.mean_seconds * turns as f64)
                .ceil()
                .clamp(1.0, 3600.0) as u32;
            return Err(QueueError::Full { waiting, seconds });
        }
        let number = state.next_number;
        state.next_number += 1;
        state.waiting.push_back((number, work));
        self.shared.changed.notify_all();
        Ok(number)
    }

    /// Removes a work that still waits.
    pub(crate) fn remove(&self, number: u64) {
        let mut state = self.shared.lock();
        state.waiting.retain(|(waiting, _)| *waiting != number);
    }

    /// Returns how many works wait and how many run.
    pub(crate) fn lengths(&self) -> [usize; 2] {
        let state = self.shared.lock();
        [state.waiting.len(), state.running]
    }

    /// Refuses further works and drops those that wait.
    pub(crate) fn close(&self) {
        let mut state = self.shared.lock();
        state.is_closed = true;
        let dropped = std::mem::take(&mut state.waiting);
        drop(state);
        drop(dropped);
        self.shared.changed.notify_all();
    }

    /// Waits until no work runs, but no longer than so. Returns whether none runs.
    pub(crate) fn wait_until_idle(&self, longest: Duration) -> bool {
        let end = Instant::now() + longest;
        let mut state = self.shared.lock();
        while state.running > 0 {
            let Some(left) = end.checked_duration_since(Instant::now()) else {
                return false;
            };
            let waited = self.shared.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }
}

impl State {
    /// Takes the next work, unless one runs that has all processors.
    fn next_if_free(&mut self) -> Option<(u64, Work)> {
        match self.is_one_alone {
            true => None,
            false => self.waiting.pop_front(),
        }
    }
}

impl Shared {
    /// A work cannot leave a broken state: it never runs while the state is locked.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does one work after another until the queue is closed.
    fn work(&self) {
        loop {
            let mut state = self.lock();
            let work = loop {
                if let Some((_, work)) = state.next_if_free() {
                    break work;
                }
                if state.is_closed {
                    return;
                }
                let waited = self.changed.wait(state);
                state = waited.unwrap_or_else(PoisonError::into_inner);
            };
            let is_alone = state.running == 0 && (state.waiting.is_empty() || self.workers == 1);
            let works = if is_alone { 1 } else { self.workers };
            state.is_one_alone = is_alone;
            state.running += 1;
            drop(state);
            let start = Instant::now();
            work(ProcessorShare::one_of(works));
            let seconds = start.elapsed().as_secs_f64();
            let mut state = self.lock();
            state.running -= 1;
            state.is_one_alone = false;
            state.mean_seconds += AVERAGE_WEIGHT * (seconds - state.mean_seconds);
            drop(state);
            self.changed.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn works_are_done_in_their_order_and_removed_ones_are_not() {
        let queue = WorkQueue::start(8, 1).unwrap();
        let (hold, held) = channel::<()>();
        let (said, heard) = channel();
        queue.push(Box::new(move |_| held.recv().unwrap())).unwrap();
        let numbers: Vec<u64> = (0..4)
            .map(|i| {
                let said = said.clone();
                queue
                    .push(Box::new(move |_| said.send(i).unwrap()))
                    .unwrap()
            })
            .collect();
        queue.remove(numbers[1]);
        hold.send(()).unwrap();
        drop(said);
        assert_eq!(heard.iter().collect::<Vec<i32>>(), [0, 2, 3]);
    }

    #[test]
    fn a_full_queue_says_so_and_a_closed_one_drops_what_waits() {
        let queue = WorkQueue::start(1, 1).unwrap();
        let (hold, held) = channel::<()>();
        let (started, has_started) = channel();
        let first = move |_| {
            started.send(()).unwrap();
            held.recv().unwrap();
        };
        queue.push(Box::new(first)).unwrap();
        has_started.recv().unwrap();
        queue
            .push(Box::new(|_| unreachable!("the queue is closed before")))
            .unwrap();
        let full = queue.push(Box::new(|_| ()));
        assert_eq!(
            full,
            Err(QueueError::Full {
                waiting: 1,
                seconds: 1
            })
        );
        assert_eq!(queue.lengths(), [1, 1]);
        queue.close();
        assert_eq!(queue.push(Box::new(|_| ())), Err(QueueError::Closed));
        assert!(!queue.wait_until_idle(Duration::from_millis(10)));
        hold.send(()).unwrap();
        assert!(queue.wait_until_idle(Duration::from_secs(10)));
        assert_eq!(queue.lengths(), [0, 0]);
    }

    #[test]
    fn a_work_that_is_alone_has_all_processors_and_others_share_them() {
        let queue = WorkQueue::start(8, 2).unwrap();
        let (said, heard) = channel();
        let begin = |name: &'static str| {
            let (release, held) = channel::<()>();
            let said = said.clone();
            let work = move |share: ProcessorShare| {
                said.send((name, share.of(8))).unwrap();
                held.recv().unwrap();
            };
            queue.push(Box::new(work)).unwrap();
            release
        };
        let soon = Duration::from_secs(10);
        let alone = begin("alone");
        assert_eq!(heard.recv_timeout(soon).unwrap(), ("alone", 8));
        let others = ["second", "third", "fourth"].map(&begin);
        // There is a free thread, but no free processor.
        assert!(heard.recv_timeout(Duration::from_millis(100)).is_err());
        assert_eq!(queue.lengths(), [3, 1]);
        alone.send(()).unwrap();
        let mut pair = [(); 2].map(|()| heard.recv_timeout(soon).unwrap());
        pair.sort();
        assert_eq!(pair, [("second", 4), ("third", 4)]);
        // The last one runs beside another and has the share of one.
        others[0].send(()).unwrap();
        assert_eq!(heard.recv_timeout(soon).unwrap(), ("fourth", 4));
        for release in &others[1..] {
            release.send(()).unwrap();
        }
        assert!(queue.wait_until_idle(soon));
        let alone = begin("alone again");
        assert_eq!(heard.recv_timeout(soon).unwrap(), ("alone again", 8));
        alone.send(()).unwrap();
    }
}
