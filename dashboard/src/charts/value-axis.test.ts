import { expect, test } from "vitest";
import {
  axisRange,
  countOutside,
  DEFAULT_VALUE_AXIS,
  extentOf,
  jointExtent,
  logRange,
  logTicks,
} from "./value-axis";

const LINEAR = DEFAULT_VALUE_AXIS;
const LOG = { ...LINEAR, scale: "log" } as const;

test("the extent of values spans all columns", () => {
  expect(extentOf([[1, null, 3], [-2]], LINEAR)).toEqual({ from: -2, to: 3 });
  expect(extentOf([[null], []], LINEAR)).toBeNull();
});

test("a logarithmic axis shows positive values only", () => {
  expect(extentOf([[0, -5, 0.1, 10]], LOG)).toEqual({ from: 0.1, to: 10 });
  expect(extentOf([[0, -5]], LOG)).toBeNull();
});

test("clipping leaves out values that are far from the others", () => {
  const calm = Array.from({ length: 40 }, (_, i) => 10 + (i % 5));
  expect(extentOf([[...calm, 1e6, -400]], { ...LINEAR, clip: true })).toEqual({ from: 10, to: 14 });
  expect(extentOf([[...calm, 16]], { ...LINEAR, clip: true })).toEqual({ from: 10, to: 16 });
  // On a logarithmic axis the distances are ratios.
  expect(extentOf([[...calm, 20, 1e6]], { ...LOG, clip: true })).toEqual({ from: 10, to: 20 });
});

test("clipping keeps few values, curves that seldom move, and values of every size", () => {
  const clip = { ...LINEAR, clip: true };
  expect(extentOf([[1, 1, 1, 100]], clip)).toEqual({ from: 1, to: 100 });
  expect(extentOf([[...Array.from({ length: 20 }, () => 3), 4]], clip)).toEqual({ from: 3, to: 4 });
  const huge = Array.from({ length: 12 }, (_, i) => (i % 2 === 0 ? -1e300 : 1e300));
  expect(extentOf([huge], clip)).toEqual({ from: -1e300, to: 1e300 });
});

test("charts of a group have one range", () => {
  expect(jointExtent([{ from: 0, to: 1 }, null, { from: -3, to: 0.5 }])).toEqual({ from: -3, to: 1 });
  expect(jointExtent([null])).toBeNull();
});

test("values outside the range are counted", () => {
  expect(countOutside([[1, 2, null, 9], [-1]], { from: 0, to: 5 })).toBe(2);
});

test.each([
  [1, 1000],
  [5, 5],
  [5e-324, 5e-324],
  [1e-300, 1e300],
  [1e300, 1e300],
  [1.2e18, 1.2e18 + 256],
])("a logarithmic range contains %d to %d and is finite", (from, to) => {
  const [low, high] = logRange({ from, to });
  expect(low).toBeGreaterThan(0);
  expect(high).toBeLessThan(Infinity);
  expect(high).toBeGreaterThan(low);
  expect(high).toBeGreaterThan(to);
  if (from > 1e-305) expect(low).toBeLessThan(from);
});

test("an axis without positive values is linear", () => {
  expect(axisRange(null, "log", {})).toEqual([-0.05, 1.05]);
  expect(axisRange({ from: 100, to: 300 }, "linear", {})).toEqual([90, 310]);
  expect(axisRange({ from: 100, to: 300 }, "linear", { min: 0 })[0]).toBe(0);
});

test("logarithmic ticks are powers of ten, finer in a short range", () => {
  expect(logTicks(0.9, 1100, 5)).toEqual([1, 10, 100, 1000]);
  expect(logTicks(0.9, 11, 6)).toEqual([1, 2, 5, 10]);
  expect(logTicks(1e-300, 1e300, 5).length).toBeLessThanOrEqual(6);
  expect(logTicks(1e-3, 1.1, 4)).toEqual([1e-3, 1e-2, 1e-1, 1]);
  expect(logTicks(5.1, 5.9, 4)).toEqual([5.2, 5.4, 5.6, 5.8]);
  expect(logTicks(2, 9, 4)).toEqual([2, 4, 6, 8]);
});
