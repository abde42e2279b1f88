//! The guard around every call of foreign code: turns a panic inside into a sentence with its file and line.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// Guards that this thread is inside of.
    static DEPTH: Cell<u32> = const { Cell::new(0) };
    /// File and line of the last panic inside a guard.
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// The result of `work`, or the text of its panic: "panicked at FILE:LINE: TEXT". Nothing is printed. What `work` had borrowed stays as it was at
/// the panic: the caller must not trust it any more, or must repair it.
///
/// # Errors
/// The text of the panic.
pub fn guarded<R>(work: impl FnOnce() -> R) -> Result<R, String> {
    install_hook();
    DEPTH.set(DEPTH.get() + 1);
    let result = catch_unwind(AssertUnwindSafe(work));
    DEPTH.set(DEPTH.get() - 1);
    result.map_err(|payload| {
        let payload = match payload.downcast::<Caught>() {
            Ok(caught) => return caught.0,
            Err(payload) => payload,
        };
        let text = in_words(&*payload).to_owned();
        // A payload may panic when it is dropped.
        let _ = catch_unwind(AssertUnwindSafe(|| drop(payload)));
        match PLACE.take() {
            Some(place) => format!("panicked at {place}: {text}"),
            None => format!("panicked: {text}"),
        }
    })
}

/// Resumes a panic that was caught elsewhere, such as in a library whose panics this program cannot catch: the enclosing guard returns `said`,
/// the text from the first guard.
pub fn resume(said: String) -> ! {
    resume_unwind(Box::new(Caught(said)))
}

/// The text of a panic that another guard caught.
struct Caught(String);

fn in_words(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("without a text")
}

/// Inside a guard a panic leaves its place; outside, what was there before does as it did.
fn install_hook() {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            if DEPTH.get() == 0 {
                return before(panic);
            }
            PLACE.set(panic.location().map(|it| format!("{}:{}", it.file(), it.line())));
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_told_with_its_file_and_line() {
        let line = line!() + 1;
        let told = guarded(|| panic!("no hands: {}", 3)).unwrap_err();
        assert_eq!(told, format!("panicked at {}:{line}: no hands: 3", file!()));
        assert_eq!(guarded(|| 5), Ok(5));
    }

    #[test]
    fn a_panic_that_was_caught_before_keeps_its_words() {
        let first = guarded(|| panic!("no feet")).unwrap_err();
        assert_eq!(guarded(|| resume(first.clone())), Err::<(), _>(first));
    }

    #[test]
    fn a_payload_that_panics_when_dropped_is_told_too() {
        struct Bomb;
        impl Drop for Bomb {
            fn drop(&mut self) {
                panic!("again");
            }
        }
        let told = guarded(|| std::panic::panic_any(Bomb)).unwrap_err();
        assert!(told.ends_with("without a text") || told.contains("guard.rs"), "{told}");
    }
}
