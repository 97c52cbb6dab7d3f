import { expect, test } from "vitest";
import type { TaskSampler, TaskSeries } from "../lib/api-types";
import { finalValue, gridOf, groupCurve, meanRungs, resample, runPoints } from "./curves";

const line = (x: number[], values: number[], stepped = false) => ({ x, values, stepped });

test("values lie between the points, and only there", () => {
  const run = line([10, 20], [0, 1]);
  expect(resample(run, [0, 5, 10, 15, 20, 25])).toEqual([null, null, 0, 0.5, 1, null]);
  expect(resample(line([10, 20], [0, 1], true), [5, 10, 15, 20])).toEqual([null, 0, 0, 1]);
  expect(resample(line([], []), [0, 1])).toEqual([null, null]);
});

test("a single point has the nearest position", () => {
  expect(resample(line([11], [3]), [0, 10, 20])).toEqual([null, 3, null]);
});

test("points at one position do not divide by zero", () => {
  const values = resample(line([1, 2, 2, 3], [0, 1, 5, 6]), [1, 2, 3]);
  expect(values).toEqual([0, 5, 6]);
});

test("the mean of a group ends with its shortest run", () => {
  const curve = groupCurve([line([0, 10], [0, 10]), line([0, 20], [2, 22])], [0, 5, 10, 15], "extremes");
  expect(curve.values).toEqual([1, 6, 11, null]);
  expect(curve.low).toEqual([0, 5, 10, null]);
  expect(curve.high).toEqual([2, 7, 12, null]);
  // A group of one run has no band.
  expect(groupCurve([line([0, 10], [0, 10])], [0, 5], "interval")).toEqual({ values: [0, 5] });
});

test("the grid covers the range", () => {
  const grid = gridOf([line([3], [1])], 0, 30);
  expect([grid[0], grid.at(-1)]).toEqual([0, 30]);
  expect(gridOf([line([], [])], 0, 30)).toEqual([]);
});

test("points of a series by axis and quantity", () => {
  const series = {
    at: [100, 110],
    until: [110, 130],
    first_episode: [0, 4],
    first_step: [0, 40],
    steps: [40, 60],
    episodes: [4, 6],
    claimed: [0, 0],
    version_high: [0, 2],
    level: [0, 1],
    skill: [null, 0.5],
    success: [0, 1],
  } as unknown as TaskSeries;
  const of = { series, sampler: undefined };
  expect(runPoints("level", of, "episodes", 90, 0)).toEqual(line([4, 10], [0, 1], true));
  expect(runPoints("skill", of, "elapsed", 90, 0)).toEqual(line([30], [0.5]));
  expect(runPoints("success", of, "steps", 90, 0)).toEqual(line([20, 70], [0, 1]));
  expect(runPoints("rung", of, "steps", 90, 0).x).toEqual([]);
  expect(runPoints("level", { series: undefined, sampler: undefined }, "time", 0, 0).x).toEqual([]);
});

test("the mean rung weighs rungs by their groups", () => {
  const rungs = [
    { rung: 0, groups: [3, 0] },
    { rung: 4, groups: [1, 0] },
  ];
  expect(meanRungs({ until: [1, 2], rungs } as unknown as TaskSampler)).toEqual([1, null]);
});

test("the final value is the mean of the last tenth", () => {
  const x = Array.from({ length: 20 }, (_, i) => i);
  expect(finalValue(line(x, x))).toBe(18.5);
  expect(finalValue(line(x, x, true))).toBe(19);
  expect(finalValue(line([1], [7]))).toBe(7);
  expect(finalValue(line([], []))).toBeNull();
});
