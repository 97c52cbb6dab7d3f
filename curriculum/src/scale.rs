//! A task's table as a space: what strategies without levels move in.
//!
//! Each param has a place of its own in the table, from 0 (its first row) to the last, and between two rows a value between theirs.
//! Places are what a step of difficulty is; values are not: half way from 100 units of fuel to 1.5 is still plenty, and a radar that
//! sees everything has some large number for its range.

use super::settings::TaskPlan;

/// The params that a task's table moves.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scale<'a> {
    plan: &'a TaskPlan,
    axes: Vec<Axis>,
}

/// One of them.
#[derive(Debug, Clone, PartialEq)]
struct Axis {
    name: String,
    /// The table's column, easy to hard.
    values: Vec<f64>,
    whole: bool,
}

impl<'a> Scale<'a> {
    pub(super) fn of(plan: &'a TaskPlan) -> Self {
        let specs = env_core::task(&plan.task).map_or(&[][..], |task| task.params());
        let axis = |(at, name): (usize, &String)| {
            let value = |level| plan.levels.params(level).nth(at).map(|(_, value)| value);
            let values = (0..plan.levels.len()).filter_map(value).collect();
            let whole = specs.iter().any(|spec| spec.name == name && spec.whole);
            Axis { name: name.clone(), values, whole }
        };
        let axes = plan.levels.columns().iter().enumerate().map(axis);
        // What the table never moves is no axis.
        Self { plan, axes: axes.filter(|axis| axis.values.windows(2).any(|two| two[0] != two[1])).collect() }
    }

    /// How many params move.
    pub(super) const fn len(&self) -> usize {
        self.axes.len()
    }

    /// The names of the params that move.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.axes.iter().map(|axis| axis.name.as_str())
    }

    /// The place of the last row; 1 in a table of one row, in which nothing moves.
    pub(super) fn top(&self) -> f64 {
        f64::from(self.plan.top().max(1))
    }

    /// The params at these places, over the task's own; what does not move is as in the first row.
    pub(super) fn params(&self, places: &[f64]) -> Vec<(String, f64)> {
        let mut params = self.plan.params(Some(0));
        for (axis, place) in self.axes.iter().zip(places) {
            if let Some((_, held)) = params.iter_mut().find(|(name, _)| *name == axis.name) {
                *held = axis.value(*place);
            }
        }
        params
    }

    /// The places of these params: in the middle of the stretch where a value stands in several rows.
    pub(super) fn places(&self, params: &[(String, f64)]) -> Vec<f64> {
        let of = |axis: &Axis| {
            let value = params.iter().find(|(name, _)| *name == axis.name).map(|(_, value)| *value);
            value.map_or(0.0, |value| axis.place(value))
        };
        self.axes.iter().map(of).collect()
    }

    /// Places as shares of the way through the table.
    pub(super) fn shares(&self, params: &[(String, f64)]) -> Vec<f64> {
        self.places(params).into_iter().map(|place| place / self.top()).collect()
    }
}

/// How hard params are, in rows of the task's table: the mean of the rows at which each param has its value; a row's number for
/// the row itself.
#[must_use]
pub fn difficulty(plan: &TaskPlan, params: &[(String, f64)]) -> f64 {
    let places = Scale::of(plan).places(params);
    if places.is_empty() { 0.0 } else { places.iter().sum::<f64>() / places.len() as f64 }
}

impl Axis {
    fn value(&self, place: f64) -> f64 {
        let last = self.values.len().saturating_sub(1);
        let place = place.clamp(0.0, last as f64);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it was clamped to places of the table"
        )]
        let low = place as usize;
        let (from, to) = (self.values[low], self.values[(low + 1).min(last)]);
        let value = from + (to - from) * (place - low as f64);
        let value = if self.whole { value.round() } else { value };
        value.clamp(from.min(to), from.max(to))
    }

    /// The first stretch of the table that has the value; the nearest row where none has.
    fn place(&self, value: f64) -> f64 {
        let same = |at: &usize| self.values[*at] == value;
        if let Some(first) = (0..self.values.len()).find(same) {
            let last = (first..self.values.len()).take_while(same).last().unwrap_or(first);
            return f64::midpoint(first as f64, last as f64);
        }
        let between = self.values.windows(2).position(|two| {
            let (low, high) = (two[0].min(two[1]), two[0].max(two[1]));
            low < value && value < high
        });
        match between {
            Some(at) => at as f64 + (value - self.values[at]) / (self.values[at + 1] - self.values[at]),
            None => {
                let gap = |at: &usize| (self.values[*at] - value).abs();
                (0..self.values.len()).min_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap_or(0) as f64
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_every_table_are_places() {
        for task in env_core::tasks() {
            let plan = TaskPlan::standard(task.id()).unwrap();
            let scale = Scale::of(&plan);
            assert!(scale.len() > 0, "{}", task.id());
            for level in 0..=plan.top() {
                let params = plan.params(Some(level));
                assert_eq!(
                    scale.params(&vec![f64::from(level); scale.len()]),
                    params,
                    "{} at {level}",
                    task.id()
                );
                // A place that is found means the same params.
                assert_eq!(scale.params(&scale.places(&params)), params, "{} at {level}", task.id());
                assert!(scale.shares(&params).iter().all(|share| (0.0..=1.0).contains(share)));
            }
        }
    }

    #[test]
    fn between_rows_lie_values_that_the_task_takes() {
        for task in env_core::tasks() {
            let plan = TaskPlan::standard(task.id()).unwrap();
            let scale = Scale::of(&plan);
            for step in 0..100 {
                let params = scale.params(&vec![f64::from(step) / 99.0 * scale.top(); scale.len()]);
                let told = params.iter().map(|(name, value)| (name.as_str(), *value));
                assert!(env_core::Recipe::with_params(task, told).is_ok(), "{} {params:?}", task.id());
                let places = scale.places(&params);
                let back = scale.params(&places);
                assert!(
                    params.iter().zip(&back).all(|(a, b)| (a.1 - b.1).abs() < 1e-9),
                    "{params:?} {back:?}"
                );
            }
        }
    }

    #[test]
    fn validate_half_a_row_is_half_the_way() {
        let plan = TaskPlan::standard("kessler/survival").unwrap();
        let params = Scale::of(&plan).params(&[0.5, 2.5, 3.25]);
        let of = |name: &str| params.iter().find(|(known, _)| known == name).unwrap().1;
        // 25 to 35 debris, a spread of 0.4 to 0.8, 20 to 10 units of fuel.
        assert_eq!((of("debris"), of("fuel")), (30.0, 17.5));
        assert!((of("spread") - 0.6).abs() < 1e-12);
    }

    #[test]
    fn a_table_of_one_row_moves_nothing() {
        let mut plan = TaskPlan::standard("kessler/survival").unwrap();
        let spec = env_core::task(&plan.task).unwrap();
        let levels = env_core::space::Levels::new(spec.params(), vec!["fuel".to_owned()], vec![vec![5.0]]);
        plan.levels = levels.unwrap();
        let scale = Scale::of(&plan);
        assert_eq!(scale.len(), 0);
        assert_eq!(scale.params(&[]), plan.params(Some(0)));
    }
}
