//! Buffers that are reused, so that the steady state allocates nothing.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// Keeps the values that a node has emitted, and reuses each once every receiver has dropped it.
#[derive(Debug)]
pub struct Pool<T> {
    lent: Vec<Arc<T>>,
}

/// A value with one owner: fill it, then [`Pool::share`] it.
#[derive(Debug)]
pub struct Fresh<T>(Arc<T>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self { lent: Vec::new() }
    }
}

impl<T> Pool<T> {
    /// A value of an earlier activation with whatever is still in it, or `make()`.
    pub fn take(&mut self, make: impl FnOnce() -> T) -> Fresh<T> {
        match self.lent.iter_mut().position(|it| Arc::get_mut(it).is_some()) {
            Some(free) => Fresh(self.lent.swap_remove(free)),
            None => Fresh(Arc::new(make())),
        }
    }

    /// Ready to be emitted; comes back to this pool when all receivers have dropped it.
    pub fn share(&mut self, value: Fresh<T>) -> Arc<T> {
        self.lent.push(Arc::clone(&value.0));
        value.0
    }
}

impl<T> Deref for Fresh<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T> DerefMut for Fresh<T> {
    fn deref_mut(&mut self) -> &mut T {
        match Arc::get_mut(&mut self.0) {
            Some(value) => value,
            None => unreachable!(
                "a fresh value has one owner: it was taken out of the pool, and weak handles are never made"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_comes_back_only_when_its_receivers_have_let_go() {
        let mut pool = Pool::default();
        let mut first = pool.take(Vec::<u8>::new);
        first.push(7);
        let held = pool.share(first);
        let second = pool.take(Vec::new);
        assert!(second.is_empty(), "the first one is still held");
        drop(held);
        assert_eq!(*pool.take(Vec::new), [7]);
    }
}
