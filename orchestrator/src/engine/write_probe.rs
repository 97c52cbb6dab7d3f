//! Probes whether the writer can store changes, for `/readyz` and the metrics.

use store::write_probe;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Writes a row, so that its answer says whether the writer can write. After a change that could not be stored it writes as much as
/// a large change: a full disk may still have room for one row.
#[derive(Debug)]
pub struct WriteProbe;

impl Change for WriteProbe {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        write_probe::write(&mut tx.conn, tx.now, tx.has_outage).await?;
        tx.has_outage = false; // the writer sets it again if this is not committed
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::signals::WorkerSignals;
    use crate::engine::writer::Writer;
    use clock::Clock;
    use store::Outage;

    /// Writes a blob of this many bytes.
    struct WriteBlob(i64);

    impl Change for WriteBlob {
        type Output = ();

        async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
            let write = sqlx::query(
                "INSERT INTO write_probe (id, at, padding) VALUES (1, 0, zeroblob(?))
                 ON CONFLICT DO UPDATE SET padding = excluded.padding",
            );
            write.bind(self.0).execute(&mut tx.conn).await.map_err(store::StoreError::from)?;
            Ok(())
        }
    }

    /// Limits the database file to this many pages.
    struct LimitPages(i64);

    impl Change for LimitPages {
        type Output = ();

        async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
            let set = format!("PRAGMA max_page_count = {}", self.0);
            sqlx::query(sqlx::AssertSqlSafe(set))
                .execute(&mut tx.conn)
                .await
                .map_err(store::StoreError::from)?;
            Ok(())
        }
    }

    #[tokio::test]
    async fn probe_fails_on_a_file_with_room_for_one_row_only() {
        let folder = tempfile::tempdir().unwrap();
        let conn = store::open_writer(&folder.path().join("db.sqlite3")).await.unwrap();
        let (writer, _) = Writer::start(conn, None, Clock::manual(1_000).clock, WorkerSignals::default());
        writer.change(LimitPages(1)).await.unwrap(); // no more than the file has
        writer.change(WriteProbe).await.unwrap();
        let full = |answer: Result<(), ServiceError>| {
            assert_eq!(answer.unwrap_err().outage(), Some(Outage::Full));
        };
        full(writer.change(WriteBlob(1 << 18)).await);
        for _ in 0..3 {
            full(writer.change(WriteProbe).await);
        }
        writer.change(LimitPages(1 << 20)).await.unwrap();
        writer.change(WriteProbe).await.unwrap();
        writer.change(WriteBlob(1 << 18)).await.unwrap();
    }
}
