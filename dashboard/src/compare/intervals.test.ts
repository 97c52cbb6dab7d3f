import { expect, test } from "vitest";
import { meanBand, tQuantile } from "./intervals";

test("quantiles of Student's t distribution", () => {
  expect(tQuantile(1)).toBeCloseTo(12.706, 3);
  expect(tQuantile(9)).toBeCloseTo(2.262, 3);
  expect(tQuantile(60)).toBeCloseTo(2.0003, 2);
  expect(tQuantile(1e9)).toBeCloseTo(1.96, 2);
});

test("the interval of the mean of ten seeds", () => {
  const values = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10];
  const band = meanBand(values, "interval");
  // Mean 5.5, standard deviation 3.0277, t = 2.262.
  expect(band?.mean).toBe(5.5);
  expect(band?.low).toBeCloseTo(3.334, 3);
  expect(band?.high).toBeCloseTo(7.666, 3);
  expect(meanBand(values, "extremes")).toEqual({ mean: 5.5, low: 1, high: 10 });
  expect(meanBand(values, "deviation")?.high).toBeCloseTo(8.528, 3);
});

test("few values", () => {
  expect(meanBand([], "interval")).toBeUndefined();
  expect(meanBand([3], "interval")).toEqual({ mean: 3, low: 3, high: 3 });
  expect(meanBand([2, 2, 2], "interval")).toEqual({ mean: 2, low: 2, high: 2 });
  // Student's t of two values is 12.7 deviations.
  expect(meanBand([1, 2], "interval")).toEqual({ mean: 1.5, low: 1, high: 2 });
});

test("a band stays within the bounds of the quantity", () => {
  const band = meanBand([0, 0.5, 1], "interval", { min: 0, max: 1 });
  expect(band).toEqual({ mean: 0.5, low: 0, high: 1 });
  expect(meanBand([0, 0.5, 1], "interval", { min: 0 })?.high).toBeCloseTo(1.742, 3);
});
