/** Results of complete evaluations, which never change: each is loaded once, when a page shows it. */
import { untrack } from "svelte";
import { SvelteMap } from "svelte/reactivity";
import { client, unwrap } from "./api";
import type { Evaluation, EvaluationEstimates, EvaluationSummary } from "./api-types";
import { RequestQueue } from "./request-queue";

/** Number of requests for results that are under way at most. */
const AT_ONCE = 4;

const results = new SvelteMap<string, Evaluation>();
const queue = new RequestQueue(AT_ONCE, fetchEvaluation);

/** Returns an evaluation with its results if it is loaded. */
export function evaluationResults(id: string): Evaluation | undefined {
  return results.get(id);
}

/** Returns an evaluation with its results; loads it unless it is loaded. */
export async function fetchEvaluation(id: string): Promise<Evaluation> {
  const known = results.get(id);
  if (known) return known;
  const path = { path: { evaluation: id } };
  const loaded = await unwrap(client.GET("/v1/evaluations/{evaluation}", { params: path }));
  if (loaded.state === "complete") results.set(id, loaded);
  return loaded;
}

/**
 * Loads the results of the evaluations that are complete and not loaded yet. Returns a function that withdraws the requests that have
 * not begun. An unreadable evaluation keeps no results: its page shows the error.
 */
export function loadEvaluationResults(evaluations: Pick<EvaluationSummary, "id" | "state">[]): () => void {
  // Effects that call this function need not run again after each result.
  const wanted = untrack(() =>
    evaluations.filter(({ id, state }) => state === "complete" && !results.has(id)),
  );
  const withdrawals = wanted.map(({ id }) => queue.add(id));
  return () => {
    for (const withdraw of withdrawals) withdraw();
  };
}

/** Returns the estimates of the evaluated policy over all scenarios of a task, or of the whole suite. */
export function overallRow(rows: EvaluationEstimates[], task = "all"): EvaluationEstimates | undefined {
  const own = rows.filter(({ part, policy }) => part === "all" && policy !== "blind_panel");
  // A suite with a single task has no row for all tasks.
  return own.find((row) => row.task === task) ?? own.find((row) => row.task === "all") ?? own[0];
}

/** Loads all evaluations, the newest first. */
export async function listEvaluations(): Promise<EvaluationSummary[]> {
  const all: EvaluationSummary[] = [];
  let cursor: string | undefined;
  do {
    const query = { limit: 500, ...(cursor ? { cursor } : {}) };
    const page = await unwrap(client.GET("/v1/evaluations", { params: { query } }));
    all.push(...page.evaluations);
    cursor = page.next ?? undefined;
  } while (cursor);
  return all;
}
