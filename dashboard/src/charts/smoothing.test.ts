import { expect, test } from "vitest";
import { smooth } from "./smoothing";
import { DEFAULT_VALUE_AXIS, fencesOf } from "./value-axis";

test("without a weight the values stay as they are", () => {
  expect(smooth([1, null, 3], 0)).toEqual([1, null, 3]);
});

test("a constant stays constant, and unknown values stay unknown", () => {
  expect(smooth([2, 2, null, 2], 0.9).map((value) => value?.toFixed(6))).toEqual([
    "2.000000",
    "2.000000",
    undefined,
    "2.000000",
  ]);
});

test("a step is followed with the weight of the earlier values", () => {
  const values = smooth([0, 0, 0, 0, 0, 0, 0, 0, 1, 1], 0.5);
  expect(values[8]).toBeCloseTo(0.5, 2);
  expect(values[9]).toBeCloseTo(0.75, 2);
});

test("a value outside of the kept interval does not move the average", () => {
  const kept = { from: 0, to: 10 };
  expect(smooth([2, 2, 5e4, 2, -1e9, 2], 0.9, kept).map((value) => value?.toFixed(6))).toEqual(
    Array.from({ length: 6 }, () => "2.000000"),
  );
  // Without a kept value so far there is no average.
  expect(smooth([99, 4], 0.5, kept)).toEqual([null, 4]);
  expect(smooth([2, null, 5e4], 0.5, kept)).toEqual([2, null, 2]);
});

test("outliers are left out before the values are smoothed", () => {
  const calm = Array.from({ length: 40 }, (_, i) => 10 + (i % 5));
  const values = [...calm.slice(0, 20), 1e6, ...calm.slice(20)];
  const axis = { ...DEFAULT_VALUE_AXIS, clip: true };
  const smoothed = smooth(values, 0.5, fencesOf([values], axis));
  expect(Math.max(...smoothed.map((value) => value ?? 0))).toBeLessThanOrEqual(14);
  expect(smooth(values, 0.5, fencesOf([values], DEFAULT_VALUE_AXIS))[20]).toBeGreaterThan(1e5);
});
