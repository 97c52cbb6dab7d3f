/** Choice of the evaluations that stand for runs in a comparison. */
import type { EvaluationSummary } from "../lib/api-types";

type Choice = Pick<EvaluationSummary, "id" | "run" | "suite" | "state" | "policy_version">;

/** Returns the suites on which runs have complete evaluations, the one of most runs first. */
export function suitesOf(evaluations: Choice[], runs: string[]): string[] {
  const byRun = (suite: string) =>
    runs.filter((run) => newestEvaluation(evaluations, run, suite) !== undefined).length;
  const suites = [...new Set(evaluations.map(({ suite }) => suite))].filter((suite) => byRun(suite) > 0);
  return suites.sort((a, b) => byRun(b) - byRun(a));
}

/** Returns the complete evaluation of a run's highest policy version on a suite; of several, the newest. */
export function newestEvaluation<T extends Choice>(
  evaluations: T[],
  run: string,
  suite: string,
): T | undefined {
  const version = (one: T) => one.policy_version ?? -1;
  return evaluations
    .filter((one) => one.run === run && one.suite === suite && one.state === "complete")
    .reduce<T | undefined>(
      (best, one) => (best === undefined || version(one) > version(best) ? one : best),
      undefined,
    );
}
