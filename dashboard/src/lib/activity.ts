/** What a run does now, by its latest results. */
import type { RunActivity, RunOverview, RunSummary } from "./api-types";
import { formatDuration } from "./format";

/** Time without results after which a run counts as idle, in milliseconds. */
const IDLE_MS = 60_000;

export interface Activity {
  state: "waiting" | "running" | "idle";
  /** How long the run has been in this state, after the name of the state. */
  text: string;
  /** Episodes per second: of the last five minutes, or of the whole run if it is idle; null before there are results. */
  rate: number | null;
  /** Meaning of the rate. */
  rateOf: string;
}

/** Returns the activity of a run at the moment `now`, in milliseconds since 1970. */
export function activityOf(
  overview: Pick<RunOverview, "episodes" | "episodes_per_s" | "first_results_at" | "last_results_at">,
  now: number,
): Activity {
  const { episodes, episodes_per_s, first_results_at, last_results_at } = overview;
  if (!first_results_at || !last_results_at)
    return { state: "waiting", text: "for its first results", rate: null, rateOf: "no results" };
  const [first, last] = [new Date(first_results_at).getTime(), new Date(last_results_at).getTime()];
  if (now - last <= IDLE_MS) {
    const text = `for ${formatDuration(Math.max(0, now - first))}`;
    return { state: "running", text, rate: episodes_per_s, rateOf: "last 5 min" };
  }
  const rate = last > first ? (1000 * episodes) / (last - first) : null;
  const text = `for ${formatDuration(now - last)}, after ${formatDuration(last - first)} with results`;
  return { state: "idle", text, rate, rateOf: "whole run" };
}

/** Returns what a run of a list does at the moment `now`: its activity, and a sentence about it. */
export function activityOfRun(
  run: Pick<RunSummary, "status" | "archived_at" | "episodes" | "first_results_at" | "last_results_at">,
  now: number,
): { state: RunActivity; text: string } {
  if (run.archived_at) return { state: "archived", text: "Archived: the run is left out of lists" };
  if (run.status === "paused") return { state: "paused", text: "Paused: the run grants no leases" };
  const { state, text } = activityOf(
    {
      episodes: run.episodes,
      episodes_per_s: 0,
      first_results_at: run.first_results_at ?? null,
      last_results_at: run.last_results_at ?? null,
    },
    now,
  );
  return { state, text: `${state} ${text}` };
}
