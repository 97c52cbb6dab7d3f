import { expect, test } from "vitest";
import { smooth } from "./smoothing";

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
