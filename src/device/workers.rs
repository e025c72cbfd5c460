//! The CPU's workers.

use std::sync::Once;

/// Stack of a worker [bytes]; recursive builders of trees and factors need more than 2 MiB.
const STACK: usize = 64 << 20;

static POOL: Once = Once::new();

/// Runs `work` on one of the CPU's workers and waits for it.
///
/// The twins are many short parallel loops. From any other thread each of them is handed over to
/// the workers and waited for asleep, which costs more than most of the loops; from a worker they
/// start at once.
pub fn on_worker<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    // Who has built the pool before keeps it, with its stacks.
    POOL.call_once(|| drop(rayon::ThreadPoolBuilder::new().stack_size(STACK).build_global()));
    rayon::scope(|_| work())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_runs_on_a_worker_and_its_panic_comes_back() {
        assert!(on_worker(rayon::current_thread_index).is_some());
        let panicked = std::panic::catch_unwind(|| on_worker(|| std::panic::resume_unwind(Box::new(7))));
        assert_eq!(panicked.unwrap_err().downcast_ref(), Some(&7));
    }
}
