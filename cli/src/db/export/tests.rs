//! The documented columns are those of the tables and the views.

use sqlx::Row as _;

use super::tables::{ColumnKind, TABLES};

const PAGE: &str = include_str!("../../../../docs/reference/data.md");

/// Rows of the first table below a heading, cell by cell.
fn documented(heading: &str) -> Vec<Vec<&'static str>> {
    let section = PAGE.split(&format!("\n{heading}\n")).nth(1).unwrap_or_default();
    let rows = section.lines().skip_while(|line| !line.starts_with("| --"));
    let rows = rows.take_while(|line| line.starts_with('|')).filter(|line| !line.starts_with("| --"));
    rows.map(|line| line.trim_matches('|').split('|').map(str::trim).collect()).collect()
}

#[test]
fn page_of_data_has_the_columns_of_all_tables() {
    for table in TABLES {
        let columns: Vec<Vec<String>> = table
            .columns
            .iter()
            .map(|column| {
                let kind = match column.kind {
                    ColumnKind::Text => "text",
                    ColumnKind::Integer => "integer",
                    ColumnKind::Real => "real",
                    ColumnKind::Boolean => "boolean",
                    ColumnKind::Time => "time",
                    ColumnKind::Json => "JSON",
                };
                vec![format!("`{}`", column.name), kind.to_owned()]
            })
            .collect();
        let found: Vec<Vec<&str>> =
            documented(&format!("### {}", table.name)).into_iter().map(|row| row[..2].to_vec()).collect();
        assert_eq!(found, columns, "docs/reference/data.md: {}", table.name);
    }
}

/// Columns of a table that its view has, too.
fn columns_of(table: &str, without: &[&str], more: &[&str]) -> Vec<String> {
    let table = TABLES.iter().find(|known| known.name == table).unwrap();
    let kept = table.columns.iter().map(|column| column.name).filter(|name| !without.contains(name));
    let mut columns: Vec<String> = kept.chain(more.iter().copied()).map(str::to_owned).collect();
    columns.sort();
    columns
}

#[tokio::test]
async fn views_have_the_documented_columns() {
    let folder = tempfile::tempdir().unwrap();
    let mut conn = store::open_writer(&folder.path().join("db")).await.unwrap();
    let expected = [
        ("view_runs", columns_of("runs", &["at"], &["owner", "created_at", "archived_at"])),
        ("view_moves", columns_of("moves", &[], &[])),
        ("view_groups", columns_of("groups", &["replay"], &["counted", "counted_successes", "closed_at"])),
        (
            "view_episodes",
            columns_of("episodes", &["replay", "scenario", "actions"], &["lease", "group_number"]),
        ),
        ("view_mastery", columns_of("mastery", &[], &[])),
        ("view_trainer_metrics", columns_of("trainer_metrics", &[], &[])),
    ];
    let rows = documented("## Views");
    let views = sqlx::query("SELECT name FROM sqlite_master WHERE type = 'view' ORDER BY name");
    let views: Vec<String> = views.fetch_all(&mut conn).await.unwrap().iter().map(|row| row.get(0)).collect();
    assert_eq!(views.len(), expected.len());
    assert_eq!(rows.len(), expected.len());
    for ((view, columns), row) in expected.iter().zip(rows) {
        assert_eq!(row[0], format!("`{view}`"));
        assert!(views.contains(&(*view).to_owned()));
        let found = sqlx::query("SELECT name FROM pragma_table_info(?) ORDER BY name").bind(*view);
        let found: Vec<String> =
            found.fetch_all(&mut conn).await.unwrap().iter().map(|row| row.get(0)).collect();
        assert_eq!(&found, columns, "{view}");
    }
}
