//! What people change in a run: settings of nodes, and how far it goes on.

use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_messages::Time;
use foveate_node::given::Table;

/// The run does not wait for people.
const NOT_HELD: i64 = i64::MIN;
/// Why a change is not made any more.
const OVER: &str = "the run has ended";
/// Changes that wait, at most.
const MOST_WAITING: usize = 1024;

/// Controls of a run. Clones are the same.
#[derive(Clone)]
pub struct Controls(Arc<Shared>);

struct Shared {
    changes: Mutex<VecDeque<Change>>,
    n_changes: AtomicUsize,
    is_over: AtomicBool,
    until: AtomicI64,
    held: AtomicI64,
}

/// Other values of live settings of one node.
pub struct Change {
    /// The node, as numbered in the graph.
    pub instance: usize,
    /// Settings that change.
    pub values: Table,
    /// Callback with what became of it: nothing, or why the node keeps its settings.
    pub done: Box<dyn FnOnce(Result<(), String>) + Send>,
}

impl Default for Controls {
    fn default() -> Controls {
        let (changes, n_changes, is_over) = (Mutex::default(), AtomicUsize::new(0), AtomicBool::new(false));
        let (until, held) = (AtomicI64::new(i64::MAX), AtomicI64::new(NOT_HELD));
        Controls(Arc::new(Shared { changes, n_changes, is_over, until, held }))
    }
}

impl Controls {
    /// Hands a change to the run, which makes it between two activations of the node.
    ///
    /// # Errors
    /// That too many wait already, or that the run has ended.
    pub fn change(&self, change: Change) -> Result<(), String> {
        let mut changes = self.lock();
        if self.0.is_over.load(Ordering::Relaxed) {
            return Err(OVER.to_owned());
        }
        if changes.len() >= MOST_WAITING {
            return Err(format!("{MOST_WAITING} changes of settings wait already"));
        }
        changes.push_back(change);
        self.0.n_changes.store(changes.len(), Ordering::Release);
        Ok(())
    }

    /// A run that is not live goes on to this session time and waits there; `None`: it goes on.
    pub fn go_until(&self, time: Option<Time>) {
        self.0.until.store(time.map_or(i64::MAX, |it| it.0), Ordering::Relaxed);
    }

    /// Where the run waits, if it does.
    pub fn until(&self) -> Option<Time> {
        Some(Time(self.0.until.load(Ordering::Relaxed))).filter(|it| it.0 != i64::MAX)
    }

    /// The time of what happens next in a run that waits.
    pub fn held(&self) -> Option<Time> {
        Some(Time(self.0.held.load(Ordering::Relaxed))).filter(|it| it.0 != NOT_HELD)
    }

    /// Whether a run waits before what happens at `time`.
    pub(crate) fn holds(&self, time: Time) -> bool {
        let is_held = time.0 > self.0.until.load(Ordering::Relaxed);
        let held = if is_held { time.0 } else { NOT_HELD };
        // Nearly always it stands there already.
        if self.0.held.load(Ordering::Relaxed) != held {
            self.0.held.store(held, Ordering::Relaxed);
        }
        is_held
    }

    /// Whether a change waits.
    #[inline]
    pub(crate) fn is_waiting(&self) -> bool {
        self.0.n_changes.load(Ordering::Acquire) > 0
    }

    /// The changes of nodes that are `here`, in their order.
    pub(crate) fn take(&self, here: impl Fn(usize) -> bool) -> Vec<Change> {
        let mut changes = self.lock();
        let (taken, rest): (Vec<Change>, Vec<Change>) = changes.drain(..).partition(|it| here(it.instance));
        changes.extend(rest);
        self.0.n_changes.store(changes.len(), Ordering::Release);
        taken
    }

    /// Answers all changes that wait with why they are not made.
    pub(crate) fn refuse(&self, why: &str) {
        self.take(|_| true).into_iter().for_each(|it| (it.done)(Err(why.to_owned())));
    }

    /// No change is made from now on.
    pub(crate) fn end(&self) {
        let changes = self.lock();
        self.0.is_over.store(true, Ordering::Relaxed);
        drop(changes);
        self.refuse(OVER);
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Change>> {
        self.0.changes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for Controls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Controls").field("until", &self.until()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn after_the_end_every_change_has_an_answer() {
        let controls = Controls::default();
        let (answer, answers) = channel();
        let change = || {
            let answer = answer.clone();
            Change { instance: 3, values: Table::new(), done: Box::new(move |it| drop(answer.send(it))) }
        };
        assert!(controls.change(change()).is_ok() && controls.is_waiting());
        controls.end();
        assert_eq!(answers.try_recv(), Ok(Err(OVER.to_owned())));
        assert_eq!((controls.change(change()), controls.is_waiting()), (Err(OVER.to_owned()), false));
    }
}
