//! The designer without a model: samples designs from the failure profile and edits the best of the archive. Needs no
//! network and never fails; what another designer cannot do, it does.

use env_core::Draws;
use env_core::draws::Purpose;
use serde_json::Value;
use tokio::time::Instant;

use crate::brief::{Brief, Past};
use crate::gate::{Gate, Judged, Usage};
use crate::language::Language;
use crate::{Designed, Designer, Designing};

/// Designs tried for each that is wanted, at most.
const TRIES: usize = 40;
/// The share of tries that edit an earlier design, where there are some worth it.
const EDITED: f64 = 0.5;

/// Samples and edits.
#[derive(Debug, Clone, Copy, Default)]
pub struct Procedural;

impl Procedural {
    /// The first designs it would try for a brief, as they are before the gate has seen any: what would be aimed at.
    #[must_use]
    pub fn ideas(brief: &Brief, language: &dyn Language, count: usize) -> Vec<Value> {
        let parents = parents(brief, language);
        let thought = (0..count as u64).filter_map(|number| {
            let mut draws = Draws::new(Purpose::Design, brief.seed, number);
            think(brief, language, &parents, number, &mut draws).1
        });
        thought.collect()
    }

    /// Layouts for a brief: until as many passed as are wanted, or the tries are used up.
    #[must_use]
    pub fn layouts(brief: &Brief, gate: &mut Gate) -> Designed {
        let mut work = Work::new(brief, gate);
        while work.goes_on() {
            work.once(brief, gate);
        }
        work.designed
    }

    /// The same, letting others go first between tries, for as long as the brief has patience.
    async fn in_time(brief: &Brief, gate: &mut Gate) -> Designed {
        let begun = Instant::now();
        let mut work = Work::new(brief, gate);
        while work.goes_on() {
            if let Some(patience) = brief.patience.filter(|patience| begun.elapsed() >= *patience) {
                let words = format!("its time was over after {} s", patience.as_secs());
                work.designed.troubles.push(words);
                break;
            }
            work.once(brief, gate);
            tokio::task::yield_now().await;
        }
        work.designed
    }
}

/// Designing under way.
struct Work<'a> {
    parents: Parents<'a>,
    designed: Designed,
    wanted: usize,
    tried: u64,
}

impl<'a> Work<'a> {
    fn new(brief: &'a Brief, gate: &Gate) -> Self {
        let usage = Usage { rounds: 1, ..Usage::default() };
        let designed = Designed { usage, ..Designed::default() };
        Self { parents: parents(brief, gate.language()), designed, wanted: brief.count, tried: 0 }
    }

    fn goes_on(&self) -> bool {
        self.designed.admitted() < self.wanted && self.tried < (self.wanted * TRIES) as u64
    }

    /// One design more.
    fn once(&mut self, brief: &Brief, gate: &mut Gate) {
        let number = self.tried;
        self.tried += 1;
        let mut draws = Draws::new(Purpose::Design, brief.seed, number);
        let (sky, design) = think(brief, gate.language(), &self.parents, number, &mut draws);
        let Some(mut design) = design else { return };
        name(&mut design, number);
        let verdict = gate.judge(brief, &design, [sky]);
        let name = design.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
        self.designed.judged.push(Judged { name, design: Some(design), round: 1, verdict });
    }
}

impl Designer for Procedural {
    fn name(&self) -> &'static str {
        "procedural"
    }

    fn design<'a>(&'a mut self, brief: &'a Brief, gate: &'a mut Gate) -> Designing<'a> {
        Box::pin(async move { Ok(Self::in_time(brief, gate).await) })
    }
}

/// Earlier designs worth editing, with their weights: one over the rank of regret × novelty.
struct Parents<'a> {
    past: Vec<&'a Past>,
    weights: Vec<f64>,
}

fn parents<'a>(brief: &'a Brief, language: &dyn Language) -> Parents<'a> {
    let mut parents = Parents { past: Vec::new(), weights: Vec::new() };
    for (at, past) in brief.fates.iter().enumerate() {
        let Some(regret) = past.fate.worth() else { continue };
        let others = brief.fates.iter().enumerate().filter(|(other, _)| *other != at);
        let distances = others.map(|(_, other)| language.distance(&past.design, &other.design));
        let novelty = distances.fold(1.0, f64::min);
        let worth = regret * novelty;
        if worth > 0.0 {
            parents.past.push(past);
            parents.weights.push(worth);
        }
    }
    // By rank, as regrets lie close together once a designer knows what to do (Jiang et al. 2021, section 3).
    let worth = std::mem::take(&mut parents.weights);
    let rank = |of: &f64| 1 + worth.iter().filter(|other| *other > of).count();
    parents.weights = worth.iter().map(|of| 1.0 / rank(of) as f64).collect();
    parents
}

fn think(
    brief: &Brief,
    language: &dyn Language,
    parents: &Parents<'_>,
    number: u64,
    draws: &mut Draws,
) -> (env_core::Scenario, Option<Value>) {
    let edits = draws.chance(EDITED);
    match draws.weighted(&parents.weights).map(|at| parents.past[at]).filter(|_| edits) {
        Some(parent) => {
            let sky = parent.sky.map_or_else(|| brief.sky(number), |seed| brief.under(seed));
            let design = language.edit(&parent.design, brief, &sky, draws);
            (sky, design)
        }
        None => {
            let sky = brief.sky(number);
            let design = language.sample(brief, &sky, draws);
            (sky, design)
        }
    }
}

/// A name for people where the design has none.
fn name(design: &mut Value, number: u64) {
    let mode = design.pointer("/aim/mode").and_then(Value::as_str).unwrap_or("layout").to_owned();
    if let Some(named) = design.get_mut("name").filter(|name| name.as_str() == Some("")) {
        *named = Value::String(format!("{mode} {}", number + 1));
    }
}
