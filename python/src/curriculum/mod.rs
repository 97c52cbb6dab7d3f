//! The curriculum of a run: leases are taken ahead and results handed in by two threads, so that stepping waits for nobody while
//! there is something to fly.

mod fetch;
mod lease;
mod link;
mod report;
mod stock;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use env_core::Scenario;
use env_core::batch::book::Book;
use pyo3::create_exception;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use serde_json::json;

use self::fetch::Wish;
pub(crate) use self::lease::Episode;
use self::link::Link;
pub(crate) use self::link::{NativeLink, is_local};
use self::stock::{Shared, Stock};
use crate::errors::invalid;

create_exception!(
    sparring,
    CurriculumError,
    PyRuntimeError,
    "The curriculum gives no more episodes, or does not take what was flown: why is in the words."
);

/// A century, in seconds.
const AGES_S: f64 = 3.2e9;
/// How often a trainer that waits looks up, for one that interrupts it too.
const LOOK: Duration = Duration::from_millis(200);

/// Why nothing is begun.
pub(crate) enum Stop {
    /// In words.
    Why(String),
    /// Python's user interrupted it.
    Interrupted(PyErr),
}

impl From<String> for Stop {
    fn from(why: String) -> Self {
        Self::Why(why)
    }
}

impl Stop {
    /// As Python's exception.
    pub(crate) fn error(self) -> PyErr {
        match self {
            Self::Why(why) => failed(why),
            Self::Interrupted(error) => error,
        }
    }
}

/// When so many seconds from now are over.
fn until(field: &str, seconds: f64) -> PyResult<Instant> {
    // Without end is longer than any program runs.
    let seconds = if seconds == f64::INFINITY { AGES_S } else { seconds };
    let most = Duration::try_from_secs_f64(seconds).map_err(|error| invalid(field, error))?;
    Instant::now().checked_add(most).ok_or_else(|| invalid(field, "longer than a clock goes"))
}

/// What a trainer and its threads share.
pub(crate) struct Desk {
    shared: Shared,
    link: Link,
    wish: Wish,
    patience: Duration,
    buffer: usize,
}

impl Desk {
    /// Waits for a change, unless nothing will come of that; whoever waits may be interrupted.
    fn wait<'a>(
        &'a self,
        stock: MutexGuard<'a, Stock>,
        until: Instant,
        without: &dyn Fn(&Stock) -> String,
    ) -> Result<MutexGuard<'a, Stock>, Stop> {
        stock.usable()?;
        if Instant::now() >= until || stock.gone.is_some() {
            return Err(format!("{}; {}", without(&stock), away(&stock)).into());
        }
        self.look(stock).map_err(Stop::Interrupted)
    }

    /// Waits for a change, or some time; whoever waits may be interrupted.
    fn look<'a>(&'a self, stock: MutexGuard<'a, Stock>) -> PyResult<MutexGuard<'a, Stock>> {
        drop(self.shared.wait(stock, LOOK));
        // The interpreter is asked for only by those who hold nothing that others wait for with it.
        Python::attach(|py| py.check_signals())?;
        Ok(self.shared.lock())
    }

    /// Finds episodes for all that will begin; waits where none are ready, or too many wait to be handed in.
    pub(crate) fn assign(
        &self,
        book: &mut Book<Episode>,
        reset: Option<Option<&[bool]>>,
    ) -> Result<(), Stop> {
        let until = Instant::now() + self.patience;
        let mut stock = self.shared.lock();
        loop {
            // What was refused is told before anything else is begun.
            stock.usable()?;
            book.version = stock.version;
            if stock.waiting >= self.buffer && book.needs(reset) {
                let full = |stock: &Stock| {
                    format!("{} episodes wait to be handed in, and no more are kept", stock.waiting)
                };
                stock = self.wait(stock, until, &full)?;
                continue;
            }
            let without = book.assign(&mut *stock, reset);
            if stock.ready() < stock.wanted {
                self.shared.tell();
            }
            if without == 0 {
                return Ok(());
            }
            if stock.exhausted {
                if let Some(mask) = reset {
                    book.again(mask);
                }
                return Ok(());
            }
            stock = self.wait(stock, until, &|_| format!("{without} environment(s) have nothing to fly"))?;
        }
    }

    /// What is flown by those that are reset goes back.
    pub(crate) fn give_up(&self, book: &mut Book<Episode>, mask: Option<&[bool]>) {
        book.give_up(&mut *self.shared.lock(), mask);
    }

    /// What is flown is given up for good: nobody flies it to its end.
    pub(crate) fn abandon(&self, book: &mut Book<Episode>) {
        let mut stock = self.shared.lock();
        book.abandon().iter().for_each(|episode| stock.abandon(episode));
        drop(stock);
        self.shared.tell();
    }

    /// Takes what was flown to its end.
    pub(crate) fn finish(&self, book: &mut Book<Episode>) {
        let finished = book.finished();
        if finished.is_empty() {
            return;
        }
        let mut stock = self.shared.lock();
        finished.into_iter().for_each(|flown| stock.flown(flown));
        drop(stock);
        self.shared.tell();
    }

    /// Everything that is flown goes back: environments are closed.
    pub(crate) fn leave(&self, book: &mut Book<Episode>, envs: usize) {
        let mut stock = self.shared.lock();
        book.close(&mut *stock);
        stock.wanted = stock.wanted.saturating_sub(2 * envs).max(1);
    }

    /// Has so many environments' episodes ready, and says what the first is.
    pub(crate) fn join(&self, envs: usize) -> Result<Scenario, Stop> {
        let until = Instant::now() + self.patience;
        let mut stock = self.shared.lock();
        stock.wanted += 2 * envs;
        self.shared.tell();
        loop {
            if let Some(first) = stock.first() {
                return Ok(first);
            }
            stock.usable()?;
            if stock.exhausted {
                return Err("there is nothing to fly: the evaluation is flown".to_owned().into());
            }
            stock = self.wait(stock, until, &|_| "no lease came".to_owned())?;
        }
    }
}

fn away(stock: &Stock) -> String {
    if let Some(why) = stock.gone.as_ref().or(stock.paused.as_ref()) {
        return why.clone();
    }
    match &stock.away {
        Some((since, why)) => format!("the server is away for {:.0} s: {why}", since.elapsed().as_secs_f64()),
        None => "the server is slow".to_owned(),
    }
}

/// As Python's exception.
pub(crate) fn failed(why: String) -> PyErr {
    CurriculumError::new_err(why)
}

/// A run's curriculum, as a trainer takes part in it.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativeCurriculum {
    pub(crate) desk: Arc<Desk>,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

#[pymethods]
impl NativeCurriculum {
    /// Begins to take leases of a run.
    #[new]
    #[pyo3(signature = (url, run, token, *, columns, groups, otherwise, group_size, purpose, evaluation, ttl_s, ahead, buffer, patience_s))]
    #[expect(clippy::too_many_arguments, reason = "one call, from one place, by keywords")]
    fn new(
        url: &str,
        run: String,
        token: Option<String>,
        columns: bool,
        groups: u32,
        otherwise: Option<u32>,
        group_size: Option<u32>,
        purpose: String,
        evaluation: Option<String>,
        ttl_s: u32,
        ahead: usize,
        buffer: usize,
        patience_s: f64,
    ) -> PyResult<Self> {
        let patience =
            Duration::try_from_secs_f64(patience_s).map_err(|error| invalid("patience_s", error))?;
        let ttl = Duration::from_secs(u64::from(ttl_s));
        let wish = Wish { run, columns, groups, otherwise, group_size, purpose, evaluation, ttl };
        let desk = Desk { shared: Shared::default(), link: Link::new(url, token), wish, patience, buffer };
        desk.shared.lock().wanted = ahead.max(1);
        let desk = Arc::new(desk);
        let spawn = |name: &str, work: fn(&Desk)| {
            let desk = Arc::clone(&desk);
            std::thread::Builder::new().name(name.to_owned()).spawn(move || work(&desk))
        };
        let threads = [
            spawn("sparring-fetch", |desk| fetch::fetch(&desk.shared, &desk.link, &desk.wish)),
            spawn("sparring-report", |desk| report::report(&desk.shared, &desk.link, &desk.wish.run)),
        ];
        let threads = threads.into_iter().collect::<Result<Vec<_>, _>>()?;
        Ok(Self { desk, threads: Mutex::new(threads) })
    }

    /// Which policy flies what is flown from now on.
    #[getter]
    fn policy_version(&self, py: Python<'_>) -> u32 {
        py.detach(|| self.desk.shared.lock().version)
    }

    #[setter]
    fn set_policy_version(&self, py: Python<'_>, version: u32) {
        py.detach(|| self.desk.shared.lock().version = version);
    }

    /// What became of everything, as JSON.
    fn stats(&self, py: Python<'_>) -> String {
        py.detach(|| {
            let stock = self.desk.shared.lock();
            let mut told = serde_json::to_value(&stock.tally).unwrap_or_default();
            told["ready"] = json!(stock.ready());
            told["unclaimed"] = json!(stock.unclaimed());
            told["waiting"] = json!(stock.waiting);
            told["away_s"] = json!(stock.away.as_ref().map(|(since, _)| since.elapsed().as_secs_f64()));
            told["paused"] = json!(stock.paused.is_some());
            told["fault"] = json!(stock.fault);
            told.to_string()
        })
    }

    /// Waits until what was flown of whole leases is handed in.
    fn flush(&self, py: Python<'_>, timeout_s: f64) -> PyResult<()> {
        let until = until("timeout_s", timeout_s)?;
        py.detach(|| {
            let mut stock = self.desk.shared.lock();
            while stock.outbox.iter().any(|parcel| parcel.episodes() > 0) || stock.sending {
                if stock.fault.is_some() {
                    break;
                }
                if Instant::now() >= until || stock.gone.is_some() {
                    return Err(failed(format!(
                        "{} episodes wait to be handed in; {}",
                        stock.waiting,
                        away(&stock)
                    )));
                }
                stock = self.desk.look(stock)?;
            }
            stock.trouble().map_or(Ok(()), |fault| Err(failed(fault)))
        })
    }

    /// The server was this process's own and has ended, in words: nobody waits for it any more, unless it answers all the same.
    fn gone(&self, py: Python<'_>, how: String) {
        py.detach(|| {
            self.desk.shared.lock().gone = Some(how);
            self.desk.shared.tell();
        });
    }

    /// Hands in all there is, gives back what was not flown, and ends. What could not be handed in in time is an error. Who is
    /// interrupted may close once more.
    fn close(&self, py: Python<'_>, timeout_s: f64) -> PyResult<()> {
        let until = until("timeout_s", timeout_s)?;
        py.detach(|| {
            let shared = &self.desk.shared;
            let mut stock = shared.lock();
            if !stock.closing {
                stock.closing = true;
                stock.give_up();
            }
            shared.tell();
            while !stock.ended && stock.gone.is_none() && Instant::now() < until {
                stock = self.desk.look(stock)?;
            }
            let (ended, lost, fault, why) = (stock.ended, stock.forsake(), stock.trouble(), away(&stock));
            stock.fault = None;
            drop(stock);
            let threads = std::mem::take(&mut *self.threads.lock().unwrap_or_else(PoisonError::into_inner));
            if ended {
                for thread in threads {
                    let _ = thread.join();
                }
            }
            match (lost, fault) {
                (0, None) => Ok(()),
                (0, Some(fault)) => Err(failed(fault)),
                (lost, _) => {
                    Err(failed(format!("{lost} episodes that were flown could not be handed in; {why}")))
                }
            }
        })
    }
}
