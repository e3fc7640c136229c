//! Distributes the samples of a run among its threads.
//!
//! Every thread claims a shard and writes it, as long as there are shards without an owner; after that it renders
//! samples of the others' shards. The samples of a shard are handed out and written in order, and its owner writes what
//! is ready before it renders another one. So even one shard keeps all threads busy, and while there are shards for all
//! threads no sample waits for others.

use std::collections::{BTreeMap, VecDeque};
use std::ops::ControlFlow;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Samples of a shard, per thread, that may be rendered ahead of a slow one. They wait for it in memory.
const AHEAD: usize = 4;

/// The threads of a run and the work left for them. `S` is a shard, `I` says what to make of it, and `T` was made.
pub struct Workers<S, I, T> {
    left: Mutex<WorkState<S, I, T>>,
    /// Notified whenever the state has changed.
    changed: Condvar,
    ahead: usize,
}

struct WorkState<S, I, T> {
    unclaimed: VecDeque<S>,
    /// Shards that are being written, by the number of their claim.
    claimed: BTreeMap<usize, ShardQueue<I, T>>,
    claims: usize,
}

/// The samples of a shard that a thread is writing.
struct ShardQueue<I, T> {
    /// What says which they are, once they may be rendered.
    samples: Option<Vec<I>>,
    handed_out: usize,
    written: usize,
    /// Samples that wait for earlier ones, by their place in the shard.
    ready: BTreeMap<usize, T>,
}

/// A sample that a thread has to make.
struct SampleTask<I> {
    claim: usize,
    place: usize,
    item: I,
}

impl<I: Clone, T> ShardQueue<I, T> {
    fn hand_out(&mut self, claim: usize, ahead: usize) -> Option<SampleTask<I>> {
        let place = self.handed_out;
        let item = self.samples.as_ref()?.get(place).filter(|_| place < self.written + ahead)?.clone();
        self.handed_out += 1;
        Some(SampleTask { claim, place, item })
    }

    /// Returns true if all samples are handed out.
    fn is_handed_out(&self) -> bool {
        self.samples.as_ref().is_some_and(|samples| samples.len() == self.handed_out)
    }
}

impl<S, I: Clone, T> Workers<S, I, T> {
    /// Makes the state for a run of `threads` threads that writes `shards`, at most `together` of which are written at
    /// once by a thread.
    pub fn new(shards: Vec<S>, threads: usize, together: usize) -> Self {
        let left = WorkState { unclaimed: shards.into(), claimed: BTreeMap::new(), claims: 0 };
        Self {
            left: Mutex::new(left),
            changed: Condvar::new(),
            ahead: AHEAD.div_ceil(together.max(1)) * threads.max(1),
        }
    }

    /// Claims the next shard that has no owner for this thread. Returns `None` if there is none.
    pub fn claim_shard(&self) -> Option<ShardClaim<'_, S, I, T>> {
        let mut left = self.lock_state();
        let shard = left.unclaimed.pop_front()?;
        left.claims += 1;
        let number = left.claims;
        left.claimed.insert(number, ShardQueue { samples: None, handed_out: 0, written: 0, ready: BTreeMap::new() });
        Some(ShardClaim { workers: self, shard, number })
    }

    /// Makes samples of other threads' shards, until all of them are made or being made.
    pub fn help_others(&self, make: impl Fn(I) -> T) {
        let task = |left: &mut WorkState<S, I, T>| {
            // The oldest claim comes first, so that its shard is finished soon.
            let task = left.claimed.iter_mut().find_map(|(claim, line)| line.hand_out(*claim, self.ahead));
            let nothing_comes = || left.claimed.values().all(ShardQueue::is_handed_out);
            if task.is_some() || nothing_comes() { ControlFlow::Break(task) } else { ControlFlow::Continue(()) }
        };
        while let Some(task) = self.wait_for(task) {
            let SampleTask { claim, place, item } = task;
            self.hand_in(claim, place, make(item));
        }
    }

    fn hand_in(&self, claim: usize, place: usize, made: T) {
        self.change_state(|left| {
            // The owner may have given up after an error; the sample is then dropped.
            let line = left.claimed.get_mut(&claim);
            line.map(|line| line.ready.insert(place, made));
        });
    }

    fn change_state(&self, how: impl FnOnce(&mut WorkState<S, I, T>)) {
        how(&mut self.lock_state());
        self.changed.notify_all();
    }

    /// Waits until `look` finds something in the state, and returns it.
    fn wait_for<R>(&self, mut look: impl FnMut(&mut WorkState<S, I, T>) -> ControlFlow<R>) -> R {
        let mut left = self.lock_state();
        loop {
            match look(&mut left) {
                ControlFlow::Break(found) => return found,
                ControlFlow::Continue(()) => left = self.changed.wait(left).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    /// Locks the state, even if a thread has panicked: none panics between two changes that belong together.
    fn lock_state(&self) -> MutexGuard<'_, WorkState<S, I, T>> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A shard that this thread owns as long as the claim lives.
pub struct ShardClaim<'a, S, I: Clone, T> {
    workers: &'a Workers<S, I, T>,
    /// The shard.
    pub shard: S,
    number: usize,
}

/// What the owner of a shard does next.
enum NextStep<I, T> {
    Make(SampleTask<I>),
    Write(T),
    Nothing,
}

impl<S, I: Clone, T> ShardClaim<'_, S, I, T> {
    /// Makes `samples`, with the help of other threads, and gives them to `write` in order. Stops at the first error of
    /// `write`.
    pub fn make_in_order<E>(
        &self,
        samples: Vec<I>,
        make: impl Fn(I) -> T,
        mut write: impl FnMut(T) -> Result<(), E>,
    ) -> Result<(), E> {
        self.workers.change_state(|left| self.shard_queue(left).samples = Some(samples));
        loop {
            match self.next_step() {
                NextStep::Write(made) => write(made)?,
                NextStep::Make(SampleTask { claim, place, item }) => self.workers.hand_in(claim, place, make(item)),
                NextStep::Nothing => return Ok(()),
            }
        }
    }

    fn next_step(&self) -> NextStep<I, T> {
        let next = self.workers.wait_for(|left| {
            let line = self.shard_queue(left);
            if let Some(made) = line.ready.remove(&line.written) {
                line.written += 1;
                return ControlFlow::Break(NextStep::Write(made));
            }
            match line.hand_out(self.number, self.workers.ahead) {
                Some(task) => ControlFlow::Break(NextStep::Make(task)),
                None if line.written == line.handed_out => ControlFlow::Break(NextStep::Nothing),
                None => ControlFlow::Continue(()),
            }
        });
        if matches!(next, NextStep::Write(_)) {
            // Other threads may now render further ahead.
            self.workers.changed.notify_all();
        }
        next
    }

    fn shard_queue<'l>(&self, left: &'l mut WorkState<S, I, T>) -> &'l mut ShardQueue<I, T> {
        left.claimed.get_mut(&self.number).expect("it is there while the claim lives")
    }
}

impl<S, I: Clone, T> Drop for ShardClaim<'_, S, I, T> {
    fn drop(&mut self) {
        self.workers.change_state(|left| drop(left.claimed.remove(&self.number)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
    use std::thread::{scope, sleep};
    use std::time::Duration;

    /// Runs `threads` threads over shards of `counts` samples. Sample `index` is 1000 times its shard's number plus its
    /// place.
    /// Returns what every shard got, in order, and how many samples were made by threads that do not own its shard.
    fn run(counts: &[u64], threads: usize, make: &(dyn Fn(u64) -> u64 + Sync)) -> (Vec<Vec<u64>>, usize) {
        let workers = Workers::new((0..counts.len()).collect(), threads, 1);
        let written: Vec<Mutex<Vec<u64>>> = counts.iter().map(|_| Mutex::default()).collect();
        let helped = AtomicUsize::new(0);
        scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    while let Some(claim) = workers.claim_shard() {
                        let first = 1000 * claim.shard as u64;
                        let write = |made: u64| -> Result<(), ()> {
                            written[claim.shard].lock().unwrap().push(made);
                            Ok(())
                        };
                        let samples = (first..first + counts[claim.shard]).collect();
                        claim.make_in_order(samples, make, write).expect("nothing fails");
                    }
                    workers.help_others(|index| {
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
        // Some samples take long, so that others overtake them.
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
        // The first sample is made only once nobody else may begin another one.
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
        let workers = Workers::<_, _, u64>::new(vec!["held", "broken"], 2, 1);
        scope(|scope| {
            let held = workers.claim_shard().expect("a shard");
            let broken = workers.claim_shard().expect("another one");
            assert!(workers.claim_shard().is_none());
            scope.spawn(|| workers.help_others(|index| index));
            sleep(Duration::from_millis(5));
            drop(held);
            let fails = |made: u64| if made == 2 { Err(made) } else { Ok(()) };
            assert_eq!(broken.make_in_order((0..30).collect(), |index| index, fails), Err(2));
        });
    }
}
