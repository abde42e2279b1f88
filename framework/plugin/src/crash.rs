//! Names the library node that was running when a signal (such as a segmentation fault) ends the program, on standard error.

use std::cell::Cell;

thread_local! {
    /// The message that names the library node which this thread is running.
    static INSIDE: Cell<Option<*const str>> = const { Cell::new(None) };
}

/// Runs `work`, which does not unwind. A signal that ends the program meanwhile prints `words` first.
pub(crate) fn named<R>(words: &str, work: impl FnOnce() -> R) -> R {
    let before = INSIDE.replace(Some(words));
    let result = work();
    INSIDE.set(before);
    result
}

#[cfg(not(unix))]
pub(crate) fn listen() {}
#[cfg(unix)]
pub(crate) use signals::listen;

#[cfg(unix)]
mod signals {
    #![allow(unsafe_code, reason = "handlers of signals: each block says why it is sound")]

    use std::ptr::null_mut;
    use std::sync::OnceLock;

    use libc::{SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, sigaction};

    use super::INSIDE;

    const SIGNALS: [i32; 5] = [SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGABRT];
    /// The handlers that were installed before ours.
    static BEFORE: [OnceLock<sigaction>; SIGNALS.len()] = [const { OnceLock::new() }; SIGNALS.len()];

    /// Installs the handlers, once: from now on a fatal signal prints the words of [`named`](super::named).
    pub(crate) fn listen() {
        for (signal, before) in SIGNALS.into_iter().zip(&BEFORE) {
            before.get_or_init(|| {
                // SAFETY: an action of zeros is valid, the default; the handler only does what is async-signal-safe.
                unsafe {
                    let [mut action, mut before]: [sigaction; 2] = std::mem::zeroed();
                    action.sa_sigaction = tell as extern "C" fn(i32) as usize;
                    // Rust gives each thread a stack for handlers, for when its own has overflowed.
                    action.sa_flags = libc::SA_ONSTACK;
                    sigaction(signal, &raw const action, &raw mut before);
                    before
                }
            });
        }
    }

    /// Prints the words and restores the earlier handler: Rust's own, or the default of the system. The faulting instruction then raises the signal again.
    extern "C" fn tell(signal: i32) {
        // SAFETY: the thread that the signal interrupted borrows the words; `write` and `sigaction` may be called in handlers.
        unsafe {
            if let Some(words) = INSIDE.get() {
                libc::write(2, words.cast(), (&*words).len());
            }
            let before = SIGNALS.iter().position(|it| *it == signal).and_then(|it| BEFORE[it].get());
            if let Some(before) = before {
                sigaction(signal, before, null_mut());
            }
        }
    }

    #[cfg(test)]
    mod tests {
        use std::os::unix::process::ExitStatusExt;
        use std::process::Command;

        use super::*;
        use crate::crash::named;

        #[test]
        fn a_crash_is_named_and_keeps_its_signal_and_the_words_of_rust() {
            const HOW: &str = "FOVEATE_TEST_CRASH";
            fn endless(n: u64) -> u64 {
                if std::hint::black_box(n) == u64::MAX { 0 } else { endless(n + 1) + std::hint::black_box(1) }
            }
            match std::env::var(HOW).as_deref() {
                Ok("null") => {
                    listen();
                    // SAFETY: none; it is what the test is about.
                    return named("in null\n", || unsafe {
                        std::ptr::without_provenance_mut::<u8>(8).write_volatile(0)
                    });
                }
                Ok("stack") => {
                    listen();
                    return named("in stack\n", || assert_eq!(endless(0), 0));
                }
                _ => {}
            }
            for (how, signal, also) in [("null", SIGSEGV, ""), ("stack", SIGABRT, "has overflowed its stack")] {
                let name = "crash::signals::tests::a_crash_is_named_and_keeps_its_signal_and_the_words_of_rust";
                let mut command = Command::new(std::env::current_exe().unwrap());
                let output = command.args([name, "--exact", "--nocapture"]).env(HOW, how).output().unwrap();
                let said = String::from_utf8_lossy(&output.stderr);
                assert_eq!(output.status.signal(), Some(signal), "{said}");
                assert!(said.contains(&format!("in {how}\n")) && said.contains(also), "{said}");
            }
        }
    }
}
