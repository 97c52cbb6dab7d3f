//! The level table of a task as a continuous space, for strategies that sample between levels.
//!
//! Each param that the table changes is an axis. A position on an axis is a row number, from 0 to the last row, and
//! between two rows the value is interpolated. Strategies step in positions, not in values: half way from 100 units of
//! fuel to 1.5 is still plenty, and a radar that sees everything has an arbitrary large number for its range.

use super::settings::TaskPlan;

/// Axes of a task's level table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LevelScale<'a> {
    plan: &'a TaskPlan,
    axes: Vec<ParamAxis>,
}

/// Param that the level table changes.
#[derive(Debug, Clone, PartialEq)]
struct ParamAxis {
    name: String,
    /// Column of the table, easy to hard.
    values: Vec<f64>,
    /// True if the param takes whole numbers only.
    is_whole: bool,
}

impl<'a> LevelScale<'a> {
    pub(crate) fn new(plan: &'a TaskPlan) -> Self {
        let specs = env_core::task(&plan.task).map_or(&[][..], |task| task.params());
        let axis = |(column, name): (usize, &String)| {
            let value = |level| plan.levels.params(level).nth(column).map(|(_, value)| value);
            let values = (0..plan.levels.len()).filter_map(value).collect();
            let is_whole = specs.iter().any(|spec| spec.name == name && spec.whole);
            ParamAxis { name: name.clone(), values, is_whole }
        };
        let axes = plan.levels.columns().iter().enumerate().map(axis);
        // A constant column is no axis.
        let axes = axes.filter(|axis| axis.values.windows(2).any(|two| two[0] != two[1])).collect();
        Self { plan, axes }
    }

    /// Number of axes, which are params.
    pub(crate) const fn len(&self) -> usize {
        self.axes.len()
    }

    /// Names of the params, one for each axis.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.axes.iter().map(|axis| axis.name.as_str())
    }

    /// Position of the last row; 1 for a table of one row, which has no axes.
    pub(crate) fn last_position(&self) -> f64 {
        f64::from(self.plan.hardest_level().max(1))
    }

    /// All params of the task at these positions; params without an axis are as in the first row.
    pub(crate) fn params(&self, positions: &[f64]) -> Vec<(String, f64)> {
        let mut params = self.plan.params(Some(0));
        for (axis, position) in self.axes.iter().zip(positions) {
            if let Some((_, value)) = params.iter_mut().find(|(name, _)| *name == axis.name) {
                *value = axis.value(*position);
            }
        }
        params
    }

    /// Positions of these params. A value that several rows share is at the middle of those rows.
    pub(crate) fn positions(&self, params: &[(String, f64)]) -> Vec<f64> {
        let position = |axis: &ParamAxis| {
            let value = params.iter().find(|(name, _)| *name == axis.name).map(|(_, value)| *value);
            value.map_or(0.0, |value| axis.position(value))
        };
        self.axes.iter().map(position).collect()
    }

    /// Positions of these params as fractions of the table, 0 for the first row and 1 for the last.
    pub(crate) fn fractions(&self, params: &[(String, f64)]) -> Vec<f64> {
        self.positions(params).into_iter().map(|position| position / self.last_position()).collect()
    }
}

/// Difficulty of params in rows of the task's level table: the mean of their positions. The params of a row have that
/// row's number as their difficulty.
#[must_use]
pub fn difficulty(plan: &TaskPlan, params: &[(String, f64)]) -> f64 {
    let positions = LevelScale::new(plan).positions(params);
    if positions.is_empty() { 0.0 } else { positions.iter().sum::<f64>() / positions.len() as f64 }
}

impl ParamAxis {
    /// Value at a position, interpolated between rows.
    fn value(&self, position: f64) -> f64 {
        let last = self.values.len().saturating_sub(1);
        let position = position.clamp(0.0, last as f64);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the position was clamped to the table"
        )]
        let row = position as usize;
        let (from, to) = (self.values[row], self.values[(row + 1).min(last)]);
        let value = from + (to - from) * (position - row as f64);
        let value = if self.is_whole { value.round() } else { value };
        value.clamp(from.min(to), from.max(to))
    }

    /// Position of a value: the middle of the first run of rows that have it, a point between two rows, or the nearest
    /// row if the value is outside the table.
    fn position(&self, value: f64) -> f64 {
        let has_value = |row: &usize| self.values[*row] == value;
        if let Some(first) = (0..self.values.len()).find(has_value) {
            let last = (first..self.values.len()).take_while(has_value).last().unwrap_or(first);
            return f64::midpoint(first as f64, last as f64);
        }
        let between = self.values.windows(2).position(|two| {
            let (low, high) = (two[0].min(two[1]), two[0].max(two[1]));
            low < value && value < high
        });
        match between {
            Some(row) => row as f64 + (value - self.values[row]) / (self.values[row + 1] - self.values[row]),
            None => {
                let distance = |row: &usize| (self.values[*row] - value).abs();
                (0..self.values.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0) as f64
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn params_and_positions_agree_at_every_row() {
        for task in env_core::tasks() {
            let plan = TaskPlan::standard(task.id()).unwrap();
            let scale = LevelScale::new(&plan);
            assert!(scale.len() > 0, "{}", task.id());
            for level in 0..=plan.hardest_level() {
                let params = plan.params(Some(level));
                assert_eq!(
                    scale.params(&vec![f64::from(level); scale.len()]),
                    params,
                    "{} at {level}",
                    task.id()
                );
                // The positions that are found lead to the same params.
                assert_eq!(scale.params(&scale.positions(&params)), params, "{} at {level}", task.id());
                assert!(scale.fractions(&params).iter().all(|fraction| (0.0..=1.0).contains(fraction)));
            }
        }
    }

    #[test]
    fn task_accepts_params_between_rows() {
        for task in env_core::tasks() {
            let plan = TaskPlan::standard(task.id()).unwrap();
            let scale = LevelScale::new(&plan);
            for step in 0..100 {
                let params = scale.params(&vec![f64::from(step) / 99.0 * scale.last_position(); scale.len()]);
                let named = params.iter().map(|(name, value)| (name.as_str(), *value));
                assert!(env_core::Recipe::with_params(task, named).is_ok(), "{} {params:?}", task.id());
                let positions = scale.positions(&params);
                let back = scale.params(&positions);
                assert!(
                    params.iter().zip(&back).all(|(a, b)| (a.1 - b.1).abs() < 1e-9),
                    "{params:?} {back:?}"
                );
            }
        }
    }

    #[test]
    fn values_between_rows_are_interpolated() {
        let plan = TaskPlan::standard("kessler/survival").unwrap();
        let params = LevelScale::new(&plan).params(&[0.5, 2.5, 3.25]);
        let value = |name: &str| params.iter().find(|(known, _)| known == name).unwrap().1;
        // 25 to 35 debris, a spread of 0.4 to 0.8, 20 to 10 units of fuel.
        assert_eq!((value("debris"), value("fuel")), (30.0, 17.5));
        assert!((value("spread") - 0.6).abs() < 1e-12);
    }

    #[test]
    fn table_of_one_row_has_no_axes() {
        let mut plan = TaskPlan::standard("kessler/survival").unwrap();
        let spec = env_core::task(&plan.task).unwrap();
        let levels = env_core::space::Levels::new(spec.params(), vec!["fuel".to_owned()], vec![vec![5.0]]);
        plan.levels = levels.unwrap();
        let scale = LevelScale::new(&plan);
        assert_eq!(scale.len(), 0);
        assert_eq!(scale.params(&[]), plan.params(Some(0)));
    }
}
