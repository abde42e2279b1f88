//! The rounds that lanes share between threads, under random schedules of a model checker: no job is lost or done twice, a round that was joined is done, and
//! nothing waits for what never comes.
//!
//! A schedule is drawn at each lock, wait and message; seeds are fixed. Time limits of waiting never run out here, so that a message that is missing is a
//! deadlock and no delay.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::Duration;

use foveate_messages::Time;
use primitives::{Arc, AtomicBool};
use rounds::{Kind, Rounds, WORTH_SHARING, Work};
use shuttle::rand::{Rng, thread_rng};
use shuttle::scheduler::{PctScheduler, RandomScheduler, Scheduler};
use shuttle::sync::Mutex;
use shuttle::{Config, Runner};

#[path = "../src/rounds.rs"]
mod rounds;

/// Stands in for `src/primitives.rs`: unbounded queues between tasks of the model checker.
mod primitives {
    use std::collections::VecDeque;
    use std::time::Duration;

    use shuttle::rand::{Rng, thread_rng};
    use shuttle::sync::{Condvar, Mutex};

    pub(crate) use shuttle::sync::Arc;
    pub(crate) use shuttle::sync::atomic::AtomicBool;
    pub(crate) use shuttle::thread::{JoinHandle, spawn};

    shuttle::lazy_static! {
        /// Changes of any queue; who waits looks again.
        static ref CHANGE: (Mutex<()>, Condvar) = (Mutex::new(()), Condvar::new());
    }

    fn changed() {
        let _guard = CHANGE.0.lock().unwrap();
        CHANGE.1.notify_all();
    }

    #[derive(Debug)]
    pub(crate) struct Nothing;

    struct Queue<T> {
        messages: VecDeque<T>,
        n_senders: usize,
    }

    pub(crate) struct Sender<T>(Arc<Mutex<Queue<T>>>);
    pub(crate) struct Receiver<T>(Arc<Mutex<Queue<T>>>);

    pub(crate) fn unbounded<T>() -> (Sender<T>, Receiver<T>) {
        let queue = Arc::new(Mutex::new(Queue { messages: VecDeque::new(), n_senders: 1 }));
        (Sender(Arc::clone(&queue)), Receiver(queue))
    }

    impl<T> Sender<T> {
        pub(crate) fn send(&self, message: T) -> Result<(), Nothing> {
            self.0.lock().unwrap().messages.push_back(message);
            changed();
            Ok(())
        }
    }

    impl<T> Clone for Sender<T> {
        fn clone(&self) -> Self {
            self.0.lock().unwrap().n_senders += 1;
            Self(Arc::clone(&self.0))
        }
    }

    impl<T> Drop for Sender<T> {
        fn drop(&mut self) {
            // What unwinds has its fault already.
            if let Ok(mut queue) = self.0.lock() {
                queue.n_senders -= 1;
            }
            if !std::thread::panicking() {
                changed();
            }
        }
    }

    impl<T> Clone for Receiver<T> {
        fn clone(&self) -> Self {
            Self(Arc::clone(&self.0))
        }
    }

    impl<T> Receiver<T> {
        /// A message, or the end of the queue; `None`: neither yet.
        fn look(&self) -> Option<Result<T, Nothing>> {
            let mut queue = self.0.lock().unwrap();
            match queue.messages.pop_front() {
                Some(message) => Some(Ok(message)),
                None => (queue.n_senders == 0).then_some(Err(Nothing)),
            }
        }

        pub(crate) fn try_recv(&self) -> Result<T, Nothing> {
            self.look().unwrap_or(Err(Nothing))
        }

        pub(crate) fn recv_timeout(&self, _never: Duration) -> Result<T, Nothing> {
            either(self, self)
        }
    }

    /// Which one is looked at first is drawn: neither goes before the other.
    pub(crate) fn either<T>(one: &Receiver<T>, other: &Receiver<T>) -> Result<T, Nothing> {
        let mut guard = CHANGE.0.lock().unwrap();
        loop {
            let (first, second) = if thread_rng().gen_bool(0.5) { (one, other) } else { (other, one) };
            if let Some(found) = first.look().or_else(|| second.look()) {
                return found;
            }
            guard = CHANGE.1.wait(guard).unwrap();
        }
    }
}

/// Counts how often each job was done; jobs of one kind and bundle are told apart by their time.
#[derive(Default)]
struct Tally(Mutex<BTreeMap<(usize, Time), usize>>);

impl Work for Tally {
    fn run(&self, bundle: usize, until: Time) {
        // Others go on in the middle of a job.
        shuttle::thread::yield_now();
        *self.0.lock().unwrap().entry((bundle, until)).or_default() += 1;
    }
}

/// A round that was begun: its jobs.
type Round = Vec<(usize, Time)>;

/// Begins a round of 1 to 3 bundles; each has a time of its own.
fn begin(rounds: &mut Rounds<Tally>, kind: Kind, time: &mut i64) -> Round {
    *time += 1;
    let until = Time(*time);
    let n_bundles = thread_rng().gen_range(1..=3);
    let busy: Vec<(Duration, usize)> = (0..n_bundles).map(|it| (WORTH_SHARING, it)).collect();
    rounds.begin(kind, &busy, until);
    busy.iter().map(|it| (it.1, until)).collect()
}

/// What the deterministic engine does: a round ahead is under way while rounds of single moments are begun and joined, then it is joined itself.
fn run(n_threads: usize) {
    let (tally, is_abandoned) = (Arc::new(Tally::default()), Arc::new(AtomicBool::new(false)));
    let mut rounds = Rounds::new(n_threads, &tally, &is_abandoned);
    let (mut time, all) = (0, RefCell::new(Vec::new()));
    let joined = |rounds: &mut Rounds<Tally>, kind: Kind, round: Round| {
        assert!(rounds.join(kind), "nobody gave the run up");
        let done = tally.0.lock().unwrap();
        round.iter().for_each(|it| assert_eq!(done.get(it), Some(&1), "{kind:?}: bundle and time {it:?}"));
        all.borrow_mut().extend(round);
    };
    for _ in 0..2 {
        let ahead = begin(&mut rounds, Kind::Ahead, &mut time);
        for _ in 0..thread_rng().gen_range(0..3) {
            let moment = begin(&mut rounds, Kind::Moment, &mut time);
            joined(&mut rounds, Kind::Moment, moment);
        }
        joined(&mut rounds, Kind::Ahead, ahead);
    }
    rounds.end();
    let done: Vec<(usize, Time)> = tally.0.lock().unwrap().keys().copied().collect();
    let mut begun = all.into_inner();
    begun.sort_unstable();
    assert_eq!(done, begun, "jobs that were done and that were begun");
}

fn check(scheduler: impl Scheduler + 'static, n_threads: usize) {
    Runner::new(scheduler, Config::new()).run(move || run(n_threads));
}

#[test]
fn no_job_is_lost_in_any_schedule() {
    for n_threads in 2..=3 {
        check(RandomScheduler::new_from_seed(7, 3000), n_threads);
        // Few changes of threads, at unlikely places.
        check(PctScheduler::new_from_seed(7, 3, 3000), n_threads);
    }
}
