//! Shared cache of recent results: each is computed once for all callers.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

type Entries<K, V> = VecDeque<(K, Arc<OnceLock<V>>)>;

/// The latest results.
pub(super) struct Recent<K, V> {
    most: usize,
    entries: Mutex<Entries<K, V>>,
}

impl<K: PartialEq, V: Clone> Recent<K, V> {
    /// A cache that keeps `most` results.
    pub fn new(most: usize) -> Self {
        Self { most, entries: Mutex::default() }
    }

    /// The result for `key`; a caller that needs one that is being computed waits for it.
    pub fn get(&self, key: K, answer: impl FnOnce() -> V) -> V {
        let cell = {
            let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
            match entries.iter().find(|it| it.0 == key) {
                Some((_, cell)) => Arc::clone(cell),
                None => {
                    entries.truncate(self.most.saturating_sub(1));
                    let cell = Arc::new(OnceLock::new());
                    entries.push_front((key, Arc::clone(&cell)));
                    cell
                }
            }
        };
        cell.get_or_init(answer).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_kept_until_others_come() {
        let recent = Recent::new(2);
        let mut n_asked = 0;
        for key in [1, 2, 1, 2, 3, 1] {
            assert_eq!(
                recent.get(key, || {
                    n_asked += 1;
                    key * 10
                }),
                key * 10
            );
        }
        // 3 drove out 1.
        assert_eq!(n_asked, 4);
    }
}
