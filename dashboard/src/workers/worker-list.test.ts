import { expect, test } from "vitest";
import { NO_JOBS } from "../../gallery/fixtures/workers";
import type { RemoteWorker, RemoteWorkerList } from "../lib/api-types";
import { connectionOf, jobMeans, lastSeenText, orderedWorkers, stateCounts, totalRate } from "./worker-list";

const worker = (host: string, state: RemoteWorker["state"] = "active"): RemoteWorker => ({
  id: `id-${host}`,
  host,
  version: "0.1.0",
  world: "w1",
  state,
  kinds: ["prepare", "audit", "critique"],
  concurrency: 4,
  active_jobs: 2,
  jobs: 100,
  jobs_per_s: 2.5,
  errors: 0,
  verified: 3,
  last_seen_s: 0.4,
});

const list = (workers: RemoteWorker[], degraded?: string): RemoteWorkerList => ({
  distributed: true,
  waiting: 0,
  ...(degraded === undefined ? {} : { degraded }),
  workers,
  counters: NO_JOBS,
});

test("the connection is one of three states with a sentence", () => {
  expect(connectionOf({ ...list([]), distributed: false })).toMatchObject({ name: "not distributed" });
  expect(connectionOf(list([], "no worker is connected"))).toEqual({
    name: "degraded",
    badge: "warn",
    text: "No worker is connected.",
  });
  expect(connectionOf(list([worker("a"), worker("b", "stalled")])).text).toBe(
    "1 worker does jobs of the server.",
  );
  expect(connectionOf(list([worker("a"), worker("b")])).text).toBe("2 workers do jobs of the server.");
});

test("workers with problems come first, then hosts by their numbers", () => {
  const workers = [worker("host10"), worker("host9"), worker("z", "stalled"), worker("y", "expelled")];
  expect(orderedWorkers(workers).map(({ host }) => host)).toEqual(["y", "z", "host9", "host10"]);
  expect(orderedWorkers(workers, "HOST 9").map(({ host }) => host)).toEqual(["host9"]);
  expect(orderedWorkers(workers, "expelled audit").map(({ host }) => host)).toEqual(["y"]);
  expect(stateCounts(workers)).toBe("1 expelled, 1 stalled, 2 active");
  expect(totalRate(workers)).toBe(10);
});

test("means are undefined before the first job", () => {
  expect(jobMeans(NO_JOBS)).toEqual({ remoteShare: null, bytesSent: null, bytesReceived: null });
  const counters = { ...NO_JOBS, sent: 10, done_remotely: 6, done_locally: 2, ignored_results: 2 };
  expect(jobMeans({ ...counters, bytes_sent: 60_000, bytes_received: 1600 })).toEqual({
    remoteShare: 0.75,
    bytesSent: 6000,
    bytesReceived: 200,
  });
});

test("the last heartbeat has tenths of seconds while it is recent", () => {
  expect(lastSeenText(0.42)).toBe("0.4 s ago");
  expect(lastSeenText(65)).toBe("1 min. ago");
});
