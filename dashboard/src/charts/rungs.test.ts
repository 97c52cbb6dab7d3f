import { expect, test } from "vitest";
import type { SamplerRung, TaskSampler } from "../lib/api-types";
import { courseCells, courseCurves, labelInterval, rungLabel } from "./rungs";
import { spans } from "./x-axis";

function rung(number: number, groups: number[], success: (number | null)[]): SamplerRung {
  return {
    rung: number,
    start_scale: [0.0136, 1][number] ?? null,
    probability: 0.5,
    chains: null,
    successes: 1,
    attempts: 2,
    success: 0.5,
    draws: 3,
    share: 0.5,
    groups,
    group_success: success,
  };
}

const sampler: TaskSampler = {
  task: "docking/single",
  name: "staircase",
  reason: null,
  state: "all chains are at the easiest rung",
  kind: "start",
  proposals: 6,
  quartiles: null,
  at: [60, 120],
  until: [120, 180],
  first_episode: [0, 4],
  first_step: [0, 40],
  episodes: [4, 2],
  steps: [40, 20],
  version_high: [0, 1],
  rungs: [rung(0, [3, 0], [1, null]), rung(1, [1, 2], [0.25, null])],
};

test("cells have the shares of their point", () => {
  const [first, second] = [
    { from: 0, to: 4 },
    { from: 4, to: 6 },
  ];
  expect(courseCells(sampler, spans("episodes", sampler, 0))).toEqual([
    { place: first, until: 120, rung: 0, groups: 3, share: 0.75, success: 1 },
    { place: first, until: 120, rung: 1, groups: 1, share: 0.25, success: 0.25 },
    { place: second, until: 180, rung: 1, groups: 2, share: 1, success: null },
  ]);
  expect(courseCells({ ...sampler, rungs: [] }, [])).toEqual([]);
});

test("labels are start scales, or levels without them", () => {
  expect(sampler.rungs.map(rungLabel)).toEqual(["0.014", "1"]);
  expect(rungLabel({ ...rung(7, [], []), start_scale: null })).toBe("7");
});

test("the course is exported with two columns for each rung", () => {
  const curves = courseCurves(sampler);
  expect(curves.map(({ label }) => label)).toEqual([
    "start scale 0.014, groups",
    "start scale 0.014, success rate",
    "start scale 1, groups",
    "start scale 1, success rate",
  ]);
  expect(curves[3]?.values).toEqual([0.25, null]);
  expect(courseCurves({ ...sampler, kind: null })).toEqual([]);
});

test("labels keep their distance", () => {
  expect(labelInterval(16, 480, 30)).toBe(1);
  expect(labelInterval(16, 240, 30)).toBe(2);
  expect(labelInterval(16, 0, 30)).toBe(480);
});
