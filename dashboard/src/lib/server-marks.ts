/** Whether the figures of the server's health are good. Limits are those of the server: its readiness, queues and alert rules. */
import type { Alert, AlertPage, ServerHealth } from "./api-types";
import { count } from "./format";

export interface Mark {
  state: "good" | "warn" | "bad";
  /** Limits of the figure in a sentence. */
  limit: string;
}

/** Words of the states. */
export const MARK_WORDS: Record<Mark["state"], string> = { good: "good", warn: "warning", bad: "bad" };

/** Number of waiting episodes above which a run has only a sample of its episodes criticised. */
const SAMPLED_CRITIQUES = 2000;
/** 99 % quantiles of commits that delay the answers to trainers: noticeably, and as long as a step, in milliseconds. */
const SLOW_COMMIT_MS = { warn: 100, bad: 1000 };

/** Returns the mark of a value whose limits are lower bounds of `warn` and `bad`. */
function markAbove(value: number, warn: number, bad: number, limit: string): Mark {
  return { state: value >= bad ? "bad" : value >= warn ? "warn" : "good", limit };
}

/** Readiness, as `GET /readyz` answers. */
export function readyMark({ outage }: Pick<ServerHealth, "outage">): Mark {
  return {
    state: outage ? "bad" : "good",
    limit: "Good while the database can be read and written, as GET /readyz says",
  };
}

/** Changes that wait in a queue of the writer: a full one rejects more with the status 429. */
export function queueMark(waiting: number, capacity: number): Mark {
  const limit = `Warning from ${count(capacity / 2)} changes in a queue; bad at ${count(capacity)}: the server then rejects changes (429)`;
  return markAbove(waiting, capacity / 2, capacity, limit);
}

/** Duration of commits; null without any. */
export function commitMark(p99: number | null | undefined): Mark | null {
  if (p99 === null || p99 === undefined) return null;
  const { warn, bad } = SLOW_COMMIT_MS;
  const limit = `Warning from a p99 of ${String(warn)} ms, bad from ${count(bad)} ms: reports wait as long for their receipts`;
  return markAbove(p99, warn, bad, limit);
}

/** Failed commits of the last minute; their changes are not stored. */
export function failedCommitsMark(failed: number): Mark {
  return markAbove(failed, 1, 1, "Bad from one failed commit: its changes are not stored");
}

/** Free space, as the alert rule `low_disk` judges it; null if it is unknown or the rule is off. */
export function diskMark(
  free: number | null | undefined,
  shard: string | null | undefined,
  alerts: Pick<AlertPage, "rules"> & { alerts: Pick<Alert, "rule" | "shard" | "ended_at">[] },
): Mark | null {
  const rule = alerts.rules.find((one) => one.rule === "low_disk");
  if (free === null || free === undefined || !rule) return null;
  const lasts = alerts.alerts.some(
    (alert) => alert.rule === "low_disk" && !alert.ended_at && (alert.shard ?? null) === (shard ?? null),
  );
  return { state: lasts ? "bad" : "good", limit: `Bad if ${rule.condition}: the alert rule low_disk` };
}

/** Sessions: the server refuses one beyond its limit. */
export function sessionsMark(sessions: number, limit: number): Mark {
  const text = `Warning from ${count(Math.ceil(0.8 * limit))} sessions; bad at ${count(limit)}: the server then refuses new ones`;
  return markAbove(sessions, 0.8 * limit, limit, text);
}

/** Alerts that last. */
export function alertsMark(alerts: number): Mark {
  return markAbove(alerts, 1, Infinity, "Warning while an alert lasts");
}

/** Backlog of the critique of all runs. */
export function critiquesMark(waiting: number): Mark {
  const limit = `Warning above ${count(SAMPLED_CRITIQUES)} episodes: a run with as many has only a sample of its episodes criticised`;
  return markAbove(waiting, SAMPLED_CRITIQUES + 1, Infinity, limit);
}
