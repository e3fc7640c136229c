//! Who renders which sample of a run.
//!
//! Every thread writes shards of its own while there are any that nobody writes, and renders samples of the others' from then on.
//! The samples of a shard are handed out and written in order; its owner writes what is ready before it renders another one. So
//! one shard keeps all threads at work, and where there are shards for everybody no sample waits for others.

use std::collections::{BTreeMap, VecDeque};
use std::ops::ControlFlow;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// How many samples of a shard, for each thread, may be rendered while one that takes long is: they wait for it in memory.
const AHEAD: usize = 4;

/// The threads of a run, and what is left for them. `S` is a shard, `T` a sample made.
pub struct Workers<S, T> {
    left: Mutex<Left<S, T>>,
    /// Something of it is another one now.
    changed: Condvar,
    ahead: usize,
}

struct Left<S, T> {
    unclaimed: VecDeque<S>,
    /// By the number of the claim.
    claimed: BTreeMap<usize, Line<T>>,
    claims: usize,
}

/// The samples of a shard that somebody writes.
struct Line<T> {
    /// Their indices, once they may be rendered.
    samples: Option<Vec<u64>>,
    handed_out: usize,
    written: usize,
    /// What waits for those before it, by its place in the shard.
    ready: BTreeMap<usize, T>,
}

/// A sample that is to be made.
struct Task {
    claim: usize,
    place: usize,
    index: u64,
}

impl<T> Line<T> {
    fn hand_out(&mut self, claim: usize, ahead: usize) -> Option<Task> {
        let place = self.handed_out;
        let index = *self.samples.as_ref()?.get(place).filter(|_| place < self.written + ahead)?;
        self.handed_out += 1;
        Some(Task { claim, place, index })
    }

    /// Nothing is left to be handed out.
    fn is_handed_out(&self) -> bool {
        self.samples.as_ref().is_some_and(|samples| samples.len() == self.handed_out)
    }
}

impl<S, T> Workers<S, T> {
    /// Of so many threads, with `shards` to be written.
    pub fn new(shards: Vec<S>, threads: usize) -> Self {
        let left = Left { unclaimed: shards.into(), claimed: BTreeMap::new(), claims: 0 };
        Self { left: Mutex::new(left), changed: Condvar::new(), ahead: AHEAD * threads.max(1) }
    }

    /// The next shard that has no owner, for this thread.
    pub fn claim(&self) -> Option<Claim<'_, S, T>> {
        let mut left = self.left();
        let shard = left.unclaimed.pop_front()?;
        left.claims += 1;
        let number = left.claims;
        left.claimed.insert(number, Line { samples: None, handed_out: 0, written: 0, ready: BTreeMap::new() });
        Some(Claim { workers: self, shard, number })
    }

    /// Makes samples of other threads' shards, until there is none left that is not under way.
    pub fn help(&self, make: impl Fn(u64) -> T) {
        let task = |left: &mut Left<S, T>| {
            let task = left.claimed.iter_mut().find_map(|(claim, line)| line.hand_out(*claim, self.ahead));
            let nothing_comes = || left.claimed.values().all(Line::is_handed_out);
            if task.is_some() || nothing_comes() { ControlFlow::Break(task) } else { ControlFlow::Continue(()) }
        };
        while let Some(task) = self.wait_for(task) {
            self.hand_in(&task, make(task.index));
        }
    }

    fn hand_in(&self, task: &Task, made: T) {
        self.change(|left| {
            // Its owner may have given up.
            let line = left.claimed.get_mut(&task.claim);
            line.map(|line| line.ready.insert(task.place, made));
        });
    }

    fn change(&self, how: impl FnOnce(&mut Left<S, T>)) {
        how(&mut self.left());
        self.changed.notify_all();
    }

    /// What `look` finds, sooner or later.
    fn wait_for<R>(&self, mut look: impl FnMut(&mut Left<S, T>) -> ControlFlow<R>) -> R {
        let mut left = self.left();
        loop {
            match look(&mut left) {
                ControlFlow::Break(found) => return found,
                ControlFlow::Continue(()) => left = self.changed.wait(left).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    /// Nothing panics between two changes of it that belong together.
    fn left(&self) -> MutexGuard<'_, Left<S, T>> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A shard that this thread is the owner of while this lives.
pub struct Claim<'a, S, T> {
    workers: &'a Workers<S, T>,
    /// The shard.
    pub shard: S,
    number: usize,
}

/// What an owner does next.
enum Next<T> {
    Make(Task),
    Write(T),
    Nothing,
}

impl<S, T> Claim<'_, S, T> {
    /// Makes `samples`, with the threads that help, and gives them to `write` in order, until that fails.
    pub fn in_order<E>(
        &self,
        samples: Vec<u64>,
        make: impl Fn(u64) -> T,
        mut write: impl FnMut(T) -> Result<(), E>,
    ) -> Result<(), E> {
        self.workers.change(|left| self.line(left).samples = Some(samples));
        loop {
            match self.next() {
                Next::Write(made) => write(made)?,
                Next::Make(task) => self.workers.hand_in(&task, make(task.index)),
                Next::Nothing => return Ok(()),
            }
        }
    }

    fn next(&self) -> Next<T> {
        let next = self.workers.wait_for(|left| {
            let line = self.line(left);
            if let Some(made) = line.ready.remove(&line.written) {
                line.written += 1;
                return ControlFlow::Break(Next::Write(made));
            }
            match line.hand_out(self.number, self.workers.ahead) {
                Some(task) => ControlFlow::Break(Next::Make(task)),
                None if line.written == line.handed_out => ControlFlow::Break(Next::Nothing),
                None => ControlFlow::Continue(()),
            }
        });
        if matches!(next, Next::Write(_)) {
            // Those who wait may go further ahead.
            self.workers.changed.notify_all();
        }
        next
    }

    fn line<'l>(&self, left: &'l mut Left<S, T>) -> &'l mut Line<T> {
        left.claimed.get_mut(&self.number).expect("it is there while the claim lives")
    }
}

impl<S, T> Drop for Claim<'_, S, T> {
    fn drop(&mut self) {
        self.workers.change(|left| drop(left.claimed.remove(&self.number)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
    use std::thread::{scope, sleep};
    use std::time::Duration;

    /// Runs `threads` of them over shards of `counts` samples. Sample `index` is 1000 times its shard's number and its place.
    /// What every shard got, in order, and how many samples were made by threads that do not own its shard.
    fn run(counts: &[u64], threads: usize, make: &(dyn Fn(u64) -> u64 + Sync)) -> (Vec<Vec<u64>>, usize) {
        let workers = Workers::new((0..counts.len()).collect(), threads);
        let written: Vec<Mutex<Vec<u64>>> = counts.iter().map(|_| Mutex::default()).collect();
        let helped = AtomicUsize::new(0);
        scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    while let Some(claim) = workers.claim() {
                        let first = 1000 * claim.shard as u64;
                        let write = |made: u64| -> Result<(), ()> {
                            written[claim.shard].lock().unwrap().push(made);
                            Ok(())
                        };
                        let samples = (first..first + counts[claim.shard]).collect();
                        claim.in_order(samples, make, write).expect("nothing fails");
                    }
                    workers.help(|index| {
                        helped.fetch_add(1, Ordering::Relaxed);
                        make(index)
                    });
                });
            }
        });
        (written.into_iter().map(|shard| shard.into_inner().unwrap()).collect(), helped.into_inner())
    }

    #[test]
    fn every_shard_gets_its_samples_in_order_whoever_makes_them() {
        // Some take long, so that others overtake them.
        let make = |index: u64| {
            sleep(Duration::from_micros(index * 7919 % 300));
            index
        };
        for counts in [&[][..], &[0], &[1], &[40], &[3, 0, 50, 1], &[7; 9]] {
            for threads in [1, 2, 5, 16] {
                let (written, helped) = run(counts, threads, &make);
                for (shard, (written, count)) in written.iter().zip(counts).enumerate() {
                    let first = 1000 * shard as u64;
                    assert_eq!(*written, (first..first + count).collect::<Vec<_>>(), "{counts:?} on {threads}");
                }
                assert!(threads > 1 || helped == 0);
            }
        }
    }

    #[test]
    fn one_shard_is_made_by_all_and_not_far_ahead_of_what_is_written() {
        let (begun, first_done) = (AtomicU64::new(0), AtomicU64::new(0));
        // The first sample is made when nobody else may begin another one.
        let make = |index: u64| {
            begun.fetch_add(1, Ordering::SeqCst);
            if index == 0 {
                while begun.load(Ordering::SeqCst) < 4 * AHEAD as u64 {
                    sleep(Duration::from_millis(1));
                }
                sleep(Duration::from_millis(20));
                first_done.store(begun.load(Ordering::SeqCst), Ordering::SeqCst);
            }
            index
        };
        let (written, helped) = run(&[100], 4, &make);
        assert_eq!(written[0], (0..100).collect::<Vec<_>>());
        assert_eq!(first_done.into_inner(), 4 * AHEAD as u64);
        assert!(helped >= 4 * AHEAD - 1, "{helped}");
    }

    #[test]
    fn who_helps_waits_for_no_shard_that_was_given_up() {
        let workers = Workers::<_, u64>::new(vec!["held", "broken"], 2);
        scope(|scope| {
            let held = workers.claim().expect("a shard");
            let broken = workers.claim().expect("another one");
            assert!(workers.claim().is_none());
            scope.spawn(|| workers.help(|index| index));
            sleep(Duration::from_millis(5));
            drop(held);
            let fails = |made: u64| if made == 2 { Err(made) } else { Ok(()) };
            assert_eq!(broken.in_order((0..30).collect(), |index| index, fails), Err(2));
        });
    }
}
