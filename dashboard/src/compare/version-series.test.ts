import { expect, test } from "vitest";
import { bestVersion, closeToBest, versionSeries } from "./version-series";

const evaluation = (
  id: string,
  run: string | null,
  policy_version: number | null,
  suite = "s",
  state: "complete" | "open" = "complete",
  tasks: string[] | null = null,
) => ({ id, run, policy_version, suite, state, tasks, policy: "p" });

test("series of runs with several evaluated versions", () => {
  const series = versionSeries([
    evaluation("9", "a", 5, "s", "open"),
    evaluation("8", "a", 3),
    evaluation("7", "b", 1),
    evaluation("6", "a", 3),
    evaluation("5", "a", 1, "s", "complete", ["x"]),
    evaluation("4", "a", 1),
    evaluation("3", null, null),
    evaluation("2", null, null),
  ]);
  expect(series.map(({ key }) => key)).toEqual(["a s"]);
  expect(series[0]?.evaluations.map(({ id }) => id)).toEqual(["4", "8"]);
});

test("the best version, and those as good within the intervals", () => {
  const point = (version: number, mean: number, half: number) => ({
    id: String(version),
    version,
    estimate: { mean, low: mean - half, high: mean + half, scenarios: 10 },
  });
  const points = [point(1, 0.1, 0.05), point(2, 0.6, 0.1), point(3, 0.6, 0.1), point(4, 0.45, 0.1)];
  expect(bestVersion(points)?.version).toBe(2);
  expect(closeToBest(points)).toEqual([3, 4]);
  expect(bestVersion([])).toBeUndefined();
  expect(closeToBest([])).toEqual([]);
});
