/** Texts, order and numbers of the page of workers. */
import type { JobCounters, RemoteWorker, RemoteWorkerList, RemoteWorkerState } from "../lib/api-types";
import { ago, countOf } from "../lib/format";

/** Connection of the server to its workers. */
export interface ConnectionSummary {
  name: "not distributed" | "degraded" | "connected";
  /** Class of the badge. */
  badge: "" | "good" | "warn";
  /** The state in one sentence. */
  text: string;
}

/** States in the order of the table: those that need an operator come first. */
const STATE_ORDER: readonly RemoteWorkerState[] = ["expelled", "refused", "stalled", "active"];

/** Classes of the badges of states. */
export const STATE_BADGES: Record<RemoteWorkerState, "good" | "warn" | "bad"> = {
  active: "good",
  stalled: "warn",
  refused: "warn",
  expelled: "bad",
};

/** Explanations of the states, for a title. */
export const STATE_TITLES: Record<RemoteWorkerState, string> = {
  active: "The worker takes jobs",
  stalled: "No heartbeat for four seconds or more; other workers or the server do its jobs",
  refused: "The worker computes other worlds than the server, and gets no jobs: install the server's version",
  expelled: "A result of the worker was wrong; its host gets no jobs until the server is restarted",
};

/** Returns the state of the connection to NATS and the workers. */
export function connectionOf({ distributed, degraded, workers }: RemoteWorkerList): ConnectionSummary {
  if (!distributed) return { name: "not distributed", badge: "", text: "The server does all jobs itself." };
  if (typeof degraded === "string") return { name: "degraded", badge: "warn", text: sentence(degraded) };
  const active = workers.filter(({ state }) => state === "active").length;
  const verb = active === 1 ? "does" : "do";
  return {
    name: "connected",
    badge: "good",
    text: `${countOf(active, "worker")} ${verb} jobs of the server.`,
  };
}

/** Returns a text of the server as a sentence. */
function sentence(text: string): string {
  const capital = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(capital) ? capital : `${capital}.`;
}

/** Orders the numbers within names by their value: host2 before host10. */
const byName = new Intl.Collator("en", { numeric: true });

/** Returns the workers whose host, version or state has all words of `filter`: those with problems first, then by host. */
export function orderedWorkers(workers: readonly RemoteWorker[], filter = ""): RemoteWorker[] {
  const words = filter.toLowerCase().split(/\s+/);
  return workers
    .filter(({ host, version, state, kinds }) => {
      const text = [host, version, state, ...kinds].join(" ").toLowerCase();
      return words.every((word) => text.includes(word));
    })
    .sort(
      (a, b) =>
        STATE_ORDER.indexOf(a.state) - STATE_ORDER.indexOf(b.state) ||
        byName.compare(a.host, b.host) ||
        byName.compare(a.id, b.id),
    );
}

/** Returns the number of workers in each state that occurs, in the order of the table: "1 expelled, 20 active". */
export function stateCounts(workers: readonly RemoteWorker[]): string {
  return STATE_ORDER.map((state) => ({ state, n: workers.filter((worker) => worker.state === state).length }))
    .filter(({ n }) => n > 0)
    .map(({ state, n }) => `${String(n)} ${state}`)
    .join(", ");
}

/** Returns the accepted jobs a second of all workers. */
export function totalRate(workers: readonly RemoteWorker[]): number {
  return workers.reduce((sum, { jobs_per_s }) => sum + jobs_per_s, 0);
}

/** Quantities for each job; null before the first one. */
export interface JobMeans {
  /** Share of the jobs that workers did, 0 to 1. */
  remoteShare: number | null;
  /** Mean size of a job that was sent, in bytes. */
  bytesSent: number | null;
  /** Mean size of a result of a worker, in bytes. */
  bytesReceived: number | null;
}

/** Returns the means of the counters. */
export function jobMeans(counters: JobCounters): JobMeans {
  const { done_remotely, done_locally, ignored_results, sent, bytes_sent, bytes_received } = counters;
  const mean = (sum: number, n: number) => (n > 0 ? sum / n : null);
  return {
    remoteShare: mean(done_remotely, done_remotely + done_locally),
    bytesSent: mean(bytes_sent, sent),
    bytesReceived: mean(bytes_received, done_remotely + ignored_results),
  };
}

/** Formats the time since the last heartbeat, in seconds: "0.4 s ago", "2 min. ago". */
export function lastSeenText(seconds: number): string {
  return seconds < 10 ? `${seconds.toFixed(1)} s ago` : ago(-1000 * seconds, 0);
}
