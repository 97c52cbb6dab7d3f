/** Actions on many runs, in requests that the server accepts. */
import { client, unwrap } from "./api";
import { groupByShard } from "./shards";

/** Number of runs of a request; the server accepts 1,000. */
const CHUNK = 500;

/** Archives runs. `progress` gets the number of archived runs after each request. */
export async function archiveRuns(
  runs: readonly string[],
  progress: (done: number) => void = () => undefined,
) {
  let done = 0;
  // All runs of a request are of one shard.
  for (const group of groupByShard(runs)) {
    for (let first = 0; first < group.length; first += CHUNK) {
      const chunk = group.slice(first, first + CHUNK);
      await unwrap(client.POST("/v1/archive", { body: { runs: chunk } }));
      done += chunk.length;
      progress(done);
    }
  }
}

/** Restores archived runs, one after the other. `progress` gets the number of restored runs. */
export async function restoreRuns(
  runs: readonly string[],
  progress: (done: number) => void = () => undefined,
) {
  for (const [at, run] of runs.entries()) {
    await unwrap(client.POST("/v1/runs/{run}/resume", { params: { path: { run } } }));
    progress(at + 1);
  }
}
