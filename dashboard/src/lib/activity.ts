/** What a run does now, by its status and its latest results. */
import type { RunActivity, RunOverview, RunSummary } from "./api-types";
import { formatDuration } from "./format";

/** Time without results after which a run counts as idle, in milliseconds: trainers may take as long between two reports. */
const IDLE_MS = 60_000;
/** Time without results after which the text names it, in milliseconds. */
const NAMED_MS = 10_000;

/** Status of a run as lists show it: it decides before the results do, unless it is active. */
export type ListedStatus = "active" | "paused" | "archived";

export interface Activity {
  state: RunActivity;
  /** How long the run has been in this state, after the name of the state. */
  text: string;
  /** Episodes per second: of the last five minutes, or of the whole run if it does not run; null before there are results. */
  rate: number | null;
  /** Meaning of the rate. */
  rateOf: string;
}

/** Returns the activity of a run at the moment `now`, in milliseconds since 1970. */
export function activityOf(
  overview: Pick<RunOverview, "episodes" | "episodes_per_s" | "first_results_at" | "last_results_at">,
  now: number,
  status: ListedStatus = "active",
): Activity {
  const { episodes, episodes_per_s, first_results_at, last_results_at } = overview;
  if (!first_results_at || !last_results_at) {
    const [state, text] =
      status === "active"
        ? (["waiting", "for its first results"] as const)
        : ([status, "without results"] as const);
    return { state, text, rate: null, rateOf: "no results" };
  }
  const [first, last] = [new Date(first_results_at).getTime(), new Date(last_results_at).getTime()];
  const sinceLast = now - last;
  if (status === "active" && sinceLast <= IDLE_MS) {
    const latest = sinceLast > NAMED_MS ? `, latest results ${formatDuration(sinceLast)} ago` : "";
    const text = `for ${formatDuration(Math.max(0, now - first))}${latest}`;
    return { state: "running", text, rate: episodes_per_s, rateOf: "last 5 min" };
  }
  const rate = last > first ? (1000 * episodes) / (last - first) : null;
  const after = `after ${formatDuration(last - first)} with results`;
  return status === "active"
    ? { state: "idle", text: `for ${formatDuration(sinceLast)}, ${after}`, rate, rateOf: "whole run" }
    : { state: status, text: after, rate, rateOf: "whole run" };
}

/** What the states that a user sets mean, after the sentence about the activity. */
const MEANINGS: Partial<Record<RunActivity, string>> = {
  paused: ": the run grants no leases",
  archived: ": lists leave the run out",
};

/** Returns what a run of a list does at the moment `now`: its activity, and a sentence about it. */
export function activityOfRun(
  run: Pick<RunSummary, "status" | "archived_at" | "episodes" | "first_results_at" | "last_results_at">,
  now: number,
): { state: RunActivity; text: string } {
  const overview = {
    episodes: run.episodes,
    episodes_per_s: 0,
    first_results_at: run.first_results_at ?? null,
    last_results_at: run.last_results_at ?? null,
  };
  const { state, text } = activityOf(overview, now, run.archived_at ? "archived" : run.status);
  return { state, text: `${state} ${text}${MEANINGS[state] ?? ""}` };
}
