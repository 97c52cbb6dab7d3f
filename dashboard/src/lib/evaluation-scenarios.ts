/** Scenarios of an evaluation, from all pages of the API. */
import { client, unwrap } from "./api";
import type { EvaluationScenario } from "./api-types";

/** Loads all scenarios of an evaluation; null if `isCurrent` becomes false meanwhile. */
export async function loadScenarios(
  evaluation: string,
  isCurrent: () => boolean,
): Promise<EvaluationScenario[] | null> {
  const all: EvaluationScenario[] = [];
  let cursor: string | undefined;
  do {
    const query = { limit: 500, ...(cursor ? { cursor } : {}) };
    const params = { path: { evaluation }, query };
    const page = await unwrap(client.GET("/v1/evaluations/{evaluation}/scenarios", { params }));
    if (!isCurrent()) return null;
    all.push(...page.scenarios);
    cursor = page.next ?? undefined;
  } while (cursor);
  return all;
}
