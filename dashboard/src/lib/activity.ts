/** What a run does now, by its latest results. */
import type { RunOverview } from "./api-types";
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
