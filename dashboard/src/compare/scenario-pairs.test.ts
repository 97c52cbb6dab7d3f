import { expect, test } from "vitest";
import type { EvaluationScenario } from "../lib/api-types";
import { largestDifferences, pairScenarios } from "./scenario-pairs";

const scenario = (index: number, score: number | null, first_episode: string | null = null) =>
  ({ index, score, skill: null, success: 1, first_episode }) as EvaluationScenario;
const evaluation = (id: string, run: string | null, ...scenarios: EvaluationScenario[]) => ({
  evaluation: id,
  run,
  scenarios,
});

test("scenarios that both sides have are paired, and evaluations of a side averaged", () => {
  const a = [
    evaluation("eval-1", "r", scenario(0, 1, "ep_1_0"), scenario(1, 2, "ep_1_1"), scenario(2, null)),
    evaluation("eval-2", null, scenario(0, 3)),
  ];
  const b = [evaluation("eval-3", null, scenario(0, 5), scenario(2, 1), scenario(9, 1))];
  const pairs = pairScenarios(a, b, "score");
  expect(pairs.map(({ scenario, a, b }) => [scenario.index, a, b])).toEqual([[0, 2, 5]]);
  expect(pairs[0]?.replaysOfA).toEqual([{ evaluation: "eval-1", href: "#/runs/r/episodes/ep_1_0" }]);
  expect(pairs[0]?.replaysOfB).toEqual([]);
  // Scenarios without a skill have no point.
  expect(pairScenarios(a, b, "skill")).toEqual([]);
  expect(pairScenarios(a, b, "success").length).toBe(2);
});

test("the largest differences of both signs, each scenario once", () => {
  const pair = (index: number, a: number, b: number) => ({
    scenario: scenario(index, 0),
    a,
    b,
    replaysOfA: [],
    replaysOfB: [],
  });
  const pairs = [pair(0, 1, 1), pair(1, 5, 1), pair(2, 0, 9), pair(3, 2, 1), pair(4, 1, 2)];
  const indices = (count: number) => largestDifferences(pairs, count).map(({ scenario }) => scenario.index);
  expect(indices(1)).toEqual([1, 2]);
  expect(indices(10)).toEqual([1, 3, 4, 2]);
});
