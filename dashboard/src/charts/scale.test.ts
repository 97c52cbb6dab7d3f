import { expect, test } from "vitest";
import { drawnValues, MIN_RELATIVE_WIDTH, valueRange } from "./scale";

/** Range of the drawn values, as the chart computes it. */
function rangeOf(values: (number | null)[]): [number, number] {
  const known = drawnValues(values).filter((value): value is number => value !== null);
  return known.length === 0 ? valueRange(null, null) : valueRange(Math.min(...known), Math.max(...known));
}

test.each([
  ["a constant of 17 digits", [1e16, 1e16]],
  ["a time in nanoseconds", [1.2e18]],
  ["times that differ in the last bit", [1.2e18, 1.2e18 + 256]],
  ["a value beyond the drawn ones", [1e308]],
  ["the largest drawn values", [-1e300, 1e300]],
  ["zero", [0, 0]],
  ["a negative constant", [-1e16]],
  ["a tiny constant", [1e-300]],
  ["the smallest double", [5e-324]],
  ["a tiny and a huge value", [1e-300, 1e308, 1e299]],
  ["values of both signs", [-3, null, 5e15]],
  ["no values", [null]],
])("the range of %s is finite, and wide enough to be divided", (_, values) => {
  const [from, to] = rangeOf(values);
  expect(Number.isFinite(to - from)).toBe(true);
  const size = Math.max(Math.abs(from), Math.abs(to));
  expect(to - from).toBeGreaterThan(MIN_RELATIVE_WIDTH * size);
  expect(from + (to - from) / 1000).toBeGreaterThan(from);
  for (const value of drawnValues(values)) {
    if (value === null) continue;
    expect(from).toBeLessThan(value);
    expect(to).toBeGreaterThan(value);
  }
});

test("a constant has a margin of 5 % of its size, other values of their width", () => {
  expect(rangeOf([200])).toEqual([190, 210]);
  expect(rangeOf([-200])).toEqual([-210, -190]);
  expect(rangeOf([0])).toEqual([-1, 1]);
  expect(rangeOf([100, 300])).toEqual([90, 310]);
  expect(rangeOf([1.7e9, 1.7e9 + 100])).toEqual([1.7e9 - 5, 1.7e9 + 105]);
});

test("bounds are kept", () => {
  expect(valueRange(0.2, 0.4, { min: 0, max: 1 })).toEqual([0, 1]);
  expect(valueRange(0, 0, { min: 0 })).toEqual([0, 1]);
  expect(valueRange(null, null, { min: 0 })).toEqual([0, 1.05]);
});

test("values that are too large to draw are gaps", () => {
  expect(drawnValues([1, -1e301, null, 1e308, 1e300])).toEqual([1, null, null, null, 1e300]);
});
