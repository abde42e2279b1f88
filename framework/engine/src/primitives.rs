//! What threads wait and wake each other by in [`crate::rounds`]; a test puts those of a model checker in its place.

pub(crate) use std::sync::Arc;
pub(crate) use std::sync::atomic::AtomicBool;
pub(crate) use std::thread::{JoinHandle, spawn};

pub(crate) use crossbeam::channel::{Receiver, RecvError, Sender, unbounded};

/// Waits for a message of either; an error once one of them has no sender any more.
pub(crate) fn either<T>(one: &Receiver<T>, other: &Receiver<T>) -> Result<T, RecvError> {
    crossbeam::channel::select! { recv(one) -> it => it, recv(other) -> it => it }
}
