//! Panics of nodes: each becomes the failure of one instance, with its message and place.

use std::{
    any::Any,
    cell::{Cell, RefCell},
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Once,
};

use rayon::{ThreadPool, ThreadPoolBuilder};

thread_local! {
    /// Where this thread panicked last, while it was being watched.
    static PANIC: RefCell<Option<String>> = const { RefCell::new(None) };
    static WATCHED: Cell<bool> = const { Cell::new(false) };
}

/// Runs something that may panic; the error is the panic's message with its place.
pub fn guarded<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    let before = WATCHED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(run));
    WATCHED.set(before);
    result.map_err(|panic| PANIC.take().unwrap_or_else(|| panic_message(&*panic)))
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("a panic without a message")
        .to_owned()
}

/// A pool for jobs of several threads; panics of its threads are watched as well.
pub fn pool(threads: usize) -> ThreadPool {
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("kernel {index}"))
        .start_handler(|_| WATCHED.set(true))
        .build()
        .expect("the machine has threads left")
}

/// A pool of this thread alone: kernels that go parallel must not find rayon's global pool.
pub fn own_pool() -> ThreadPool {
    let pool = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    pool.expect("a pool of the current thread needs nothing")
}

/// Keeps watched panics off the terminal.
pub fn catch_panic_places() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !WATCHED.get() {
                return before(info);
            }
            let place = info.location().map(|it| format!(" ({}:{})", it.file(), it.line()));
            let message = panic_message(info.payload());
            PANIC.set(Some(format!("{message}{}", place.unwrap_or_default())));
        }));
    });
}
