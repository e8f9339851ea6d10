//! The surfaces examined: a seeded order, followed as far as the work allows.

use crate::Model;
use crate::sampling::splitmix;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Surfaces handed to a thread at once.
const CHUNK: usize = 64;

/// A hash of a number by a seed.
pub(super) fn hash(seed: u64, number: u64) -> u64 {
    splitmix::hash(seed ^ (number + 1).wrapping_mul(splitmix::STEP))
}

/// The surfaces of a geometry by a hash of their patch: any beginning of this list is a random sample of them.
pub(super) fn order(model: &Model, seed: u64) -> Vec<u32> {
    let surfaces = &model.geometry().surfaces;
    let mut keys: Vec<(u64, u32)> = (0u32..)
        .zip(surfaces)
        .map(|(index, surface)| (hash(seed, surface.front.0.into()), index))
        .collect();
    keys.sort_unstable();
    keys.into_iter().map(|(_, index)| index).collect()
}

/// Examines `order` from its beginning, on `threads`, until the work counted by `look` reaches `limit`. Returns the
/// findings, in order, and the number examined; neither depends on the threads.
pub(super) fn examine<T: Send>(
    order: &[u32],
    threads: usize,
    limit: u64,
    look: impl Fn(&[u32], &mut u64) -> T + Sync,
) -> (Vec<T>, usize) {
    let chunks: Vec<&[u32]> = order.chunks(CHUNK).collect();
    let threads = match threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    }
    .clamp(1, chunks.len().max(1));
    let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
    let found = Mutex::new(Vec::new());
    let work_through = || {
        // The finished work is never more than that of all chunks before the next one: no chunk of the result is left
        // out.
        while done.load(Ordering::Relaxed) < limit {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some(chunk) = chunks.get(place) else { break };
            let mut work = 0;
            let result = look(chunk, &mut work);
            found
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push((place, work, result));
            done.fetch_add(work, Ordering::Relaxed);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work_through);
        }
        work_through();
    });
    let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    found.sort_unstable_by_key(|&(place, _, _)| place);
    let (mut results, mut examined, mut sum) = (Vec::with_capacity(found.len()), 0, 0u64);
    for (place, work, result) in found {
        if sum >= limit {
            break;
        }
        sum = sum.saturating_add(work);
        examined += chunks[place].len();
        results.push(result);
    }
    (results, examined)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_work_decides_how_far_and_the_threads_do_not() {
        let order: Vec<u32> = (0..10_000).collect();
        let run = |threads, limit| {
            examine(&order, threads, limit, |chunk, work| {
                *work += chunk.iter().map(|&p| u64::from(p % 97)).sum::<u64>();
                chunk[0]
            })
        };
        let (all, examined) = run(1, u64::MAX);
        assert_eq!((all.len(), examined), (10_000usize.div_ceil(CHUNK), 10_000));
        let (some, examined) = run(1, 50_000);
        assert!(examined > 500 && examined < 2000, "{examined}");
        for threads in [2, 3, 8] {
            assert_eq!(run(threads, 50_000), (some.clone(), examined));
        }
        assert_eq!(run(2, 0), (Vec::new(), 0));
    }
}
