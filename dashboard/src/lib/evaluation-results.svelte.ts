/** Results of complete evaluations, which never change: loaded once, one after the other. */
import { SvelteMap } from "svelte/reactivity";
import { client, unwrap } from "./api";
import type { Evaluation, EvaluationEstimates, EvaluationSummary } from "./api-types";

const results = new SvelteMap<string, Evaluation>();
const waiting: string[] = [];
let isLoading = false;

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

/** Loads the results of the evaluations that are complete and not loaded yet. An unreadable evaluation keeps no results. */
export function loadEvaluationResults(evaluations: Pick<EvaluationSummary, "id" | "state">[]) {
  for (const { id, state } of evaluations)
    if (state === "complete" && !results.has(id) && !waiting.includes(id)) waiting.push(id);
  if (!isLoading) void loadWaiting();
}

async function loadWaiting() {
  isLoading = true;
  for (let id = waiting[0]; id !== undefined; id = waiting[0]) {
    try {
      await fetchEvaluation(id);
    } catch {
      // The page of the evaluation shows the error.
    }
    waiting.shift();
  }
  isLoading = false;
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
