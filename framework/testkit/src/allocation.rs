//! An allocator that counts, for tests that hold a steady state to allocating nothing.
#![allow(unsafe_code, reason = "a global allocator cannot be written without it; this one only counts and forwards")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Of one thread alone: the test harness has threads of its own, which allocate when they like.
    static COUNT: Cell<u64> = const { Cell::new(0) };
    static HELD: Cell<i64> = const { Cell::new(0) };
}

/// The system's allocator, counting. A test binary makes it its own:
///
/// ```
/// #[global_allocator]
/// static ALLOCATOR: foveate_testkit::allocation::Counting = foveate_testkit::allocation::Counting;
/// ```
pub struct Counting;

/// Allocations of this thread so far, growing a block included; 0 for ever where [`Counting`] is not the global allocator.
pub fn count() -> u64 {
    COUNT.get()
}

/// What this thread has allocated and not given back [byte]; less than 0 where it has given back what others allocated, and 0
/// for ever where [`Counting`] is not the global allocator.
pub fn held_bytes() -> i64 {
    HELD.get()
}

/// A thread that is ending may have no counter any more.
fn count_one() {
    let _ = COUNT.try_with(|it| it.set(it.get() + 1));
}

fn hold(bytes: i64) {
    let _ = HELD.try_with(|it| it.set(it.get() + bytes));
}

// SAFETY: every call is passed on to the system's allocator unchanged; counting touches no memory of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        hold(layout.size() as i64);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        hold(-(layout.size() as i64));
        // SAFETY: the caller's promises are passed on: `pointer` came from the system's allocator, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count_one();
        hold(size as i64 - layout.size() as i64);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[global_allocator]
    static ALLOCATOR: Counting = Counting;

    #[track_caller]
    fn counted(work: impl FnOnce()) -> u64 {
        let before = count();
        work();
        count() - before
    }

    #[test]
    fn taking_and_growing_a_block_count_and_giving_it_back_does_not() {
        let mut block = Vec::<u64>::new();
        assert_eq!(counted(|| block.reserve_exact(4)), 1);
        block.extend([1, 2, 3, 4]);
        assert_eq!(counted(|| block.reserve_exact(100)), 1, "growing");
        assert_eq!(block, [1, 2, 3, 4]);
        assert_eq!(counted(|| drop(block)), 0);
        assert_eq!(counted(|| drop(std::hint::black_box(vec![0_u8; 100]))), 1, "a block of zeros");
    }

    #[test]
    fn each_thread_has_a_count_of_its_own() {
        let other = std::thread::spawn(|| counted(|| drop(std::hint::black_box(Box::new([1_u64; 8]))))).join();
        assert_eq!(other.ok(), Some(1));
        // A block that another thread made may be given back here.
        let block = std::thread::spawn(|| vec![7_u8; 64]).join();
        assert_eq!(block.map(|it| it.len()).ok(), Some(64));
    }
}
