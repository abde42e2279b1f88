//! Rounds of work of two kinds, shared between the thread that begins them and others.
//!
//! All that threads wait and wake each other by comes from [`super::primitives`], so that `tests/schedules.rs` runs this file under a model checker.

use std::sync::atomic::Ordering;
use std::time::Duration;

use foveate_messages::Time;

use super::primitives::{Arc, AtomicBool, JoinHandle, Receiver, Sender, either, spawn, unbounded};

/// What there is to do in rounds.
pub(crate) trait Work: Send + Sync + 'static {
    /// Works on this bundle of lanes: sources that are due before `until` are activated.
    fn run(&self, bundle: usize, until: Time);
}

/// A round that takes less is not worth waking threads for.
pub(crate) const WORTH_SHARING: Duration = Duration::from_micros(150);
/// How often a waiting thread checks whether the run was abandoned.
const LOOK: Duration = Duration::from_millis(50);

/// Which rounds there are; the first kind goes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Of one moment: everything else waits for it.
    Moment = 0,
    /// Of lanes that are ahead of the rest.
    Ahead = 1,
}

/// The part that one bundle of lanes has in a round.
struct Job {
    bundle: usize,
    /// Sources that are due before this are activated.
    until: Time,
    kind: Kind,
}

type Queue = (Sender<Job>, Receiver<Job>);

/// The threads, and what they are at.
pub(crate) struct Rounds<W> {
    work: Arc<W>,
    threads: Vec<JoinHandle<()>>,
    /// By kind.
    jobs: [Queue; 2],
    done: Receiver<Kind>,
    /// By kind: jobs that were begun and are not known to be done.
    open: [usize; 2],
    is_abandoned: Arc<AtomicBool>,
}

impl<W: Work> Rounds<W> {
    /// `n_threads` in all, with the one that calls.
    pub(crate) fn new(n_threads: usize, work: &Arc<W>, is_abandoned: &Arc<AtomicBool>) -> Self {
        let (jobs, (done, finished)) = ([unbounded(), unbounded()], unbounded());
        let threads = (1..n_threads).map(|_| {
            let (work, [moment, ahead], done) =
                (Arc::clone(work), jobs.each_ref().map(|it: &Queue| it.1.clone()), done.clone());
            spawn(move || {
                loop {
                    let Ok(job) = moment.try_recv().or_else(|_| either(&moment, &ahead)) else { return };
                    work.run(job.bundle, job.until);
                    let _ = done.send(job.kind); // nobody listens any more: the run is over
                }
            })
        });
        let threads = threads.collect();
        Self {
            work: Arc::clone(work),
            threads,
            jobs,
            done: finished,
            open: [0; 2],
            is_abandoned: Arc::clone(is_abandoned),
        }
    }

    /// Begins a round until `until` of the bundles `busy`, each with its recent duration.
    pub(crate) fn begin(&mut self, kind: Kind, busy: &[(Duration, usize)], until: Time) {
        let expected: Duration = busy.iter().map(|it| it.0).sum();
        let is_shared =
            !self.threads.is_empty() && expected >= WORTH_SHARING && (kind == Kind::Ahead || busy.len() > 1);
        for &(_, bundle) in busy {
            if is_shared {
                self.open[kind as usize] += 1;
                let _ = self.jobs[kind as usize].0.send(Job { bundle, until, kind }); // its receiver is ours
            } else {
                self.work.run(bundle, until);
            }
        }
    }

    /// Waits until the round of this kind is done, and works on it meanwhile; `false`: the run was abandoned before.
    pub(crate) fn join(&mut self, kind: Kind) -> bool {
        loop {
            while let Ok(done) = self.done.try_recv() {
                self.open[done as usize] -= 1;
            }
            if self.open[kind as usize] == 0 {
                return true;
            }
            if self.is_abandoned.load(Ordering::Relaxed) {
                return false;
            }
            // Where others are at the rest, the time is used for what comes next.
            let next = [kind, Kind::Ahead].into_iter().find_map(|it| self.jobs[it as usize].1.try_recv().ok());
            if let Some(job) = next {
                self.work.run(job.bundle, job.until);
                self.open[job.kind as usize] -= 1;
            } else if let Ok(done) = self.done.recv_timeout(LOOK) {
                self.open[done as usize] -= 1;
            }
        }
    }

    /// Ends all threads; waits for them unless the run was abandoned.
    pub(crate) fn end(self) {
        let Rounds { threads, jobs, is_abandoned, .. } = self;
        drop(jobs);
        if !is_abandoned.load(Ordering::Relaxed) {
            threads.into_iter().for_each(|it| {
                let _ = it.join(); // what panics in a bundle is caught there
            });
        }
    }
}
