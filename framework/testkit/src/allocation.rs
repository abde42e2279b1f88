//! An allocator that counts, for tests that hold a steady state to allocating nothing.
#![allow(unsafe_code, reason = "a global allocator cannot be written without it; this one only counts and forwards")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Of one thread alone: the test harness has threads of its own, which allocate when they like.
    static COUNT: Cell<u64> = const { Cell::new(0) };
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

/// A thread that is ending may have no counter any more.
fn count_one() {
    let _ = COUNT.try_with(|it| it.set(it.get() + 1));
}

// SAFETY: every call is passed on to the system's allocator unchanged; counting touches no memory of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on: `pointer` came from the system's allocator, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count_one();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}
