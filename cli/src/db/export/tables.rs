//! Tables of an export: their columns, and how a record becomes a row.

use serde_json::Value;

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColumnKind {
    Text,
    Integer,
    Real,
    Boolean,
    /// Time in RFC 3339.
    Time,
    /// JSON value as text.
    Json,
}

/// Column of a table.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    /// Name of the column.
    pub(super) name: &'static str,
    pub(super) kind: ColumnKind,
    /// JSON pointer of the value in a record.
    pointer: &'static str,
}

/// Value of a row in a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    Null,
    Text(String),
    Integer(i64),
    Real(f64),
    Boolean(bool),
}

/// Table of an export.
#[derive(Debug, Clone, Copy)]
pub(super) struct Table {
    /// Name of the table, which is that of its file.
    pub(super) name: &'static str,
    /// Kind of its records in NDJSON.
    pub(super) kind: &'static str,
    pub(super) columns: &'static [Column],
}

macro_rules! columns {
    ($($kind:ident: $($name:literal $(= $pointer:literal)?),+;)+) => {
        &[$($(Column { name: $name, kind: ColumnKind::$kind, pointer: columns!(@ $name $($pointer)?) }),+),+]
    };
    (@ $name:literal) => { concat!("/", $name) };
    (@ $name:literal $pointer:literal) => { $pointer };
}

/// All tables, in the order of their files.
pub(super) const TABLES: [Table; 8] = [
    Table {
        name: "runs",
        kind: "run",
        columns: columns! {
            Text: "run", "name"; Integer: "seed"; Text: "status"; Integer: "policy_version"; Time: "at"; Json: "settings";
        },
    },
    Table {
        name: "moves",
        kind: "move",
        columns: columns! {
            Text: "run"; Integer: "seq"; Text: "task", "move"; Integer: "from_level" = "/from", "to_level" = "/to"; Json: "evidence";
            Time: "at";
        },
    },
    Table {
        name: "layouts",
        kind: "layout",
        columns: columns! {
            Text: "run", "layout", "task"; Integer: "level";
            Text: "designer", "name", "state", "retirement_reason", "gate_check", "refusal_reason", "layout_kind", "aim";
            Json: "design"; Integer: "groups", "episodes", "successes"; Time: "at";
        },
    },
    Table {
        name: "claims",
        kind: "claim",
        columns: columns! { Text: "run", "lease", "state"; Integer: "episodes", "failed"; },
    },
    Table {
        name: "groups",
        kind: "group",
        columns: columns! {
            Text: "run", "lease"; Integer: "group_number"; Text: "purpose", "task"; Integer: "level"; Text: "role", "layout";
            Boolean: "contested", "slot"; Text: "state"; Integer: "episodes", "finished", "failed", "successes", "policy_version";
            Time: "leased_at"; Text: "replay";
        },
    },
    Table {
        name: "episodes",
        kind: "episode",
        columns: columns! {
            Text: "run", "episode", "purpose", "task"; Integer: "level"; Text: "role", "layout"; Boolean: "contested"; Text: "state";
            Real: "score", "skill"; Boolean: "success"; Real: "floor", "reference", "total_reward" = "/outcome/total_reward";
            Integer: "steps" = "/outcome/steps", "lost" = "/outcome/lost"; Real: "fuel_used" = "/outcome/fuel_used", "time_s" = "/outcome/time_s"; Text: "reason";
            Json: "metrics"; Integer: "policy_version"; Time: "at"; Text: "replay"; Json: "scenario", "actions";
        },
    },
    Table {
        name: "mastery",
        kind: "mastery",
        columns: columns! {
            Text: "run", "task"; Time: "at"; Integer: "seconds", "level"; Real: "mean", "q10", "q90";
            Integer: "episodes", "successes", "failed", "expired"; Real: "score", "skill"; Integer: "contested_groups";
            Real: "contested_success";
        },
    },
    Table {
        name: "trainer_metrics",
        kind: "trainer_metric",
        columns: columns! { Text: "run", "name"; Integer: "step"; Real: "value"; Time: "at"; },
    },
];

impl Table {
    /// Converts a record to a row. A value of another type than the column's is null.
    pub(super) fn row(&self, record: &Value) -> Vec<Cell> {
        self.columns.iter().map(|column| column.cell(record)).collect()
    }
}

impl Column {
    fn cell(&self, record: &Value) -> Cell {
        let Some(value) = record.pointer(self.pointer).filter(|value| !value.is_null()) else {
            return Cell::Null;
        };
        let cell = match self.kind {
            ColumnKind::Text | ColumnKind::Time => value.as_str().map(|text| Cell::Text(text.to_owned())),
            ColumnKind::Integer => value.as_i64().map(Cell::Integer),
            ColumnKind::Real => value.as_f64().map(Cell::Real),
            ColumnKind::Boolean => value.as_bool().map(Cell::Boolean),
            ColumnKind::Json => Some(Cell::Text(value.to_string())),
        };
        cell.unwrap_or(Cell::Null)
    }
}
