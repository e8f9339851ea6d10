//! The barrier for panics: nothing unwinds into the host.
//!
//! A cdylib has its own copy of the standard library: the host's panic hook never hears of a plugin's panic, and the
//! default hook would print a trace into the middle of the host's output. A hook of ours stands before it. During a
//! guarded call it keeps message and place for the host and prints nothing; elsewhere (a plugin's own threads) it steps
//! aside.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::sync::Once;

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
    static CAUGHT: RefCell<String> = const { RefCell::new(String::new()) };
}

static HOOK: Once = Once::new();

fn install_hook() {
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if GUARDED.try_with(Cell::get).unwrap_or(false) {
                keep(info);
            } else {
                before(info);
            }
        }));
    });
}

fn keep(info: &PanicHookInfo<'_>) {
    let payload = info.payload();
    let text = payload
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("without a message");
    let text = match info.location() {
        Some(place) => format!("{text} ({}:{})", place.file(), place.line()),
        None => text.to_owned(),
    };
    // The slot is borrowed for a moment only; a panic in that moment would lose one message.
    let _ = CAUGHT.try_with(|caught| {
        if let Ok(mut caught) = caught.try_borrow_mut() {
            *caught = text;
        }
    });
}

/// Runs `call`. Returns its result, or the place and message of its panic.
pub(crate) fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    install_hook();
    let outer = GUARDED.replace(true);
    // State left half done by a panic is never used again: the session takes only `close` from then on.
    let result = catch_unwind(AssertUnwindSafe(call));
    GUARDED.set(outer);
    result.map_err(|payload| {
        // Dropping a payload runs its author's code, which may panic in turn.
        std::mem::forget(payload);
        CAUGHT.take()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Spiteful;

    impl Drop for Spiteful {
        fn drop(&mut self) {
            panic!("dropped");
        }
    }

    #[test]
    fn message_and_place_are_kept() {
        assert_eq!(guarded(|| 7), Ok(7));
        let caught = guarded(|| panic!("no {}", "way")).expect_err("it panicked");
        assert!(
            caught.starts_with("no way (") && caught.contains("panics.rs:"),
            "{caught}"
        );
        let caught = guarded(|| std::panic::panic_any(Spiteful)).expect_err("it panicked");
        assert!(caught.starts_with("without a message"), "{caught}");
    }

    #[test]
    fn elsewhere_panics_are_as_ever() {
        guarded(|| ()).expect("no panic");
        let thread = std::thread::Builder::new().name("a plugin's own".to_owned());
        let thread = thread.spawn(|| GUARDED.get()).expect("a thread");
        assert!(!thread.join().expect("no panic"));
        assert!(!GUARDED.get());
    }
}
