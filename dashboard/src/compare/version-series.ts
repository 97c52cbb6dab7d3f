/** Evaluations of the policy versions of a run, as curves. */
import type { Estimate, EvaluationSummary } from "../lib/api-types";

type Evaluated = Pick<
  EvaluationSummary,
  "id" | "run" | "suite" | "tasks" | "state" | "policy" | "policy_version"
>;

/** Evaluations of one run on one suite, the lowest version first. */
export interface VersionSeries<T extends Evaluated = EvaluationSummary> {
  /** Unique key, for addresses. */
  key: string;
  run: string;
  suite: string;
  /** Evaluated tasks; null for all of the suite. */
  tasks: string[] | null;
  evaluations: T[];
}

/** Least number of versions of a curve. */
const MIN_VERSIONS = 2;

/** Returns the key of the series of an evaluation. */
export function seriesKey({ run, suite, tasks }: Pick<Evaluated, "run" | "suite" | "tasks">): string {
  return [run ?? "", suite, ...(tasks ? [tasks.toSorted().join("+")] : [])].join(" ");
}

/**
 * Returns the curves of all runs with several evaluated versions, in the order of their newest evaluations. Of several
 * evaluations of a version, the newest counts. `evaluations` has the newest first.
 */
export function versionSeries<T extends Evaluated>(evaluations: T[]): VersionSeries<T>[] {
  const found = new Map<string, VersionSeries<T>>();
  for (const one of evaluations) {
    const { run, suite, policy_version: version } = one;
    if (!run || version === null || version === undefined || one.state !== "complete") continue;
    const key = seriesKey(one);
    const series = found.get(key) ?? { key, run, suite, tasks: one.tasks ?? null, evaluations: [] };
    if (!series.evaluations.some((other) => other.policy_version === version)) series.evaluations.push(one);
    found.set(key, series);
  }
  const series = [...found.values()].filter((one) => one.evaluations.length >= MIN_VERSIONS);
  for (const one of series) one.evaluations.sort((a, b) => (a.policy_version ?? 0) - (b.policy_version ?? 0));
  return series;
}

/** Point of a curve over policy versions. */
export interface VersionPoint {
  id: string;
  version: number;
  estimate: Estimate;
}

/** Returns the point with the highest mean; of equal ones, the lowest version. */
export function bestVersion(points: VersionPoint[]): VersionPoint | undefined {
  return points.reduce<VersionPoint | undefined>(
    (best, point) => (best === undefined || point.estimate.mean > best.estimate.mean ? point : best),
    undefined,
  );
}

/** Returns the other versions whose intervals overlap that of the best one. */
export function closeToBest(points: VersionPoint[]): number[] {
  const best = bestVersion(points);
  if (!best) return [];
  return points
    .filter(({ id, estimate }) => id !== best.id && estimate.high >= best.estimate.low)
    .map(({ version }) => version);
}
