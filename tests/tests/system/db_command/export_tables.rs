//! `sparring db export --format csv|parquet`: a folder of tables, complete or not there at all.

use std::collections::BTreeMap;
use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::{Field, Row};
use serde_json::{Value, json};

use super::{assert_output, db, output_text, serve_compacted_run};

/// Reads a table of a CSV export: rows as maps from column to text.
fn read_csv(file: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    reader.deserialize().map(|row| row.unwrap()).collect()
}

/// Reads a table of a Parquet export.
fn read_parquet(file: &Path) -> Vec<Row> {
    let reader = SerializedFileReader::new(std::fs::File::open(file).unwrap()).unwrap();
    reader.get_row_iter(None).unwrap().map(|row| row.unwrap()).collect()
}

fn cell<'a>(row: &'a Row, column: &str) -> &'a Field {
    row.get_column_iter().find(|(name, _)| *name == column).map(|(_, field)| field).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn tables_have_the_records_of_ndjson() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("db.sqlite3");
    let server = serve_compacted_run(&file).await;
    let metrics = json!({"step": 7, "metrics": {"loss": 0.25, "kl": null}});
    let _ = server.api().post("/v1/runs/run/metrics", metrics).await.expect(200);
    let lines = output_text(&db(&file, &["export", "--run", "run"]));
    let records: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of_kind = |kind: &str| records.iter().filter(|record| record["kind"] == kind).collect::<Vec<_>>();
    for format in ["csv", "parquet"] {
        let out = folder.path().join(format);
        let written = db(&file, &["export", "--format", format, "--out", out.to_str().unwrap()]);
        assert_output(&written, 0, &format!("{} rows are in the files of", records.len()));
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 8);
    }
    let (csv, parquet) = (folder.path().join("csv"), folder.path().join("parquet"));
    for (table, kind, rows) in [
        ("runs", "run", 1..=1),
        ("episodes", "episode", 24..=24),
        ("groups", "group", 24..=24),
        ("mastery", "mastery", 1..=10),
        ("trainer_metrics", "trainer_metric", 2..=2),
        ("claims", "claim", 0..=0),
    ] {
        let count = of_kind(kind).len();
        assert!(rows.contains(&count), "{kind}: {count}");
        assert_eq!(read_csv(&csv.join(format!("{table}.csv"))).len(), count, "{table}");
        assert_eq!(read_parquet(&parquet.join(format!("{table}.parquet"))).len(), count, "{table}");
    }
    let (csv_rows, parquet_rows) =
        (read_csv(&csv.join("episodes.csv")), read_parquet(&parquet.join("episodes.parquet")));
    for ((record, text), row) in of_kind("episode").into_iter().zip(&csv_rows).zip(&parquet_rows) {
        assert_eq!(record["episode"], text["episode"]);
        assert_eq!(cell(row, "episode"), &Field::Str(text["episode"].clone()));
        assert_eq!(cell(row, "score"), &Field::Double(record["score"].as_f64().unwrap()));
        assert_eq!(text["score"].parse::<f64>().ok(), record["score"].as_f64());
        assert_eq!(cell(row, "success"), &Field::Bool(record["success"].as_bool().unwrap()));
        let steps = record["outcome"]["steps"].as_i64();
        assert_eq!(cell(row, "steps"), &steps.map_or(Field::Null, Field::Long));
        let at: jiff::Timestamp = record["at"].as_str().unwrap().parse().unwrap();
        assert_eq!(cell(row, "at"), &Field::TimestampMillis(at.as_millisecond()));
    }
    let losses = read_csv(&csv.join("trainer_metrics.csv"));
    assert_eq!((losses[0]["name"].as_str(), losses[0]["value"].as_str()), ("kl", ""));
    assert_eq!((losses[1]["name"].as_str(), losses[1]["value"].as_str()), ("loss", "0.25"));

    let again = db(&file, &["export", "--format", "csv", "--out", csv.to_str().unwrap()]);
    assert_output(&again, 2, "already exists");
    assert_output(&db(&file, &["export", "--format", "parquet"]), 2, "need --out FOLDER");
    let nowhere = db(&file, &["export", "--format", "csv", "--out", "/nowhere/tables"]);
    assert_output(&nowhere, 2, "cannot be written");
    assert_eq!(server.terminate(), Some(0));
}
