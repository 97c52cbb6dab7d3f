import { expect, test } from "vitest";
import { newestEvaluation, suitesOf } from "./evaluation-choice";

const evaluation = (id: string, run: string | null, version: number, suite = "s", state = "complete") =>
  ({ id, run, suite, state, policy_version: version }) as Parameters<typeof newestEvaluation>[0][number];
/** The newest first, as the API lists them. */
const EVALUATIONS = [
  evaluation("5", "a", 3, "s", "open"),
  evaluation("4", "a", 2),
  evaluation("3", "a", 2),
  evaluation("2", "b", 9, "other"),
  evaluation("1", null, 0),
];

test("the highest complete policy version, and the newest of it", () => {
  expect(newestEvaluation(EVALUATIONS, "a", "s")?.id).toBe("4");
  expect(newestEvaluation(EVALUATIONS, "b", "s")).toBeUndefined();
});

test("suites of the runs, the one of most runs first", () => {
  expect(suitesOf(EVALUATIONS, ["a", "b"])).toEqual(["s", "other"]);
  expect(suitesOf([...EVALUATIONS, evaluation("0", "a", 1, "other")], ["a", "b"])).toEqual(["other", "s"]);
  expect(suitesOf(EVALUATIONS, ["c"])).toEqual([]);
});
