import { expect, test } from "vitest";
import { isReal, meanDifference } from "./welch";

test("the interval of a difference is Welch's", () => {
  // Variances of 0.001425 and 0.0016333 have 4.26 degrees of freedom by Welch's formula; Student's t has 2.71 there.
  const found = meanDifference([0.61, 0.66, 0.64, 0.7], [0.5, 0.58, 0.55]);
  const se = Math.sqrt(0.001425 / 4 + 0.00163333333 / 3);
  expect(found?.difference).toBeCloseTo(0.6525 - 0.5433333, 6);
  expect(((found?.high ?? 0) - (found?.low ?? 0)) / 2 / se).toBeCloseTo(2.71, 2);
  expect(found && isReal(found)).toBe(true);
});

test("fewer than three runs have no interval", () => {
  expect(meanDifference([0.6, 0.7], [0.1, 0.2, 0.3])).toBeUndefined();
  expect(meanDifference([0.6, 0.7, 0.8], [0.1])).toBeUndefined();
});

test("equal values differ by a number without width", () => {
  expect(meanDifference([4, 4, 4], [3, 3, 3])).toEqual({ difference: 1, low: 1, high: 1 });
  const none = meanDifference([4, 4, 4], [4, 4, 4]);
  expect(none && isReal(none)).toBe(false);
});
