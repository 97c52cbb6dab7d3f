import { expect, test } from "vitest";
import { formatDifference, formatEstimate } from "./estimates";

const estimate = { mean: 0.02, low: -0.012, high: 0.05, scenarios: 200 };

test("shares are percentages, and their differences are percentage points", () => {
  expect(formatEstimate("success", { ...estimate, low: 0.01 })).toBe("2.0 % [1.0, 5.0]");
  expect(formatDifference("success", estimate)).toBe("+2.0 pp [−1.2, +5.0]");
  expect(formatDifference("skill", estimate)).toBe("+0.020 [−0.012, +0.050]");
  expect([formatEstimate("skill", null), formatDifference("skill", undefined)]).toEqual(["–", "–"]);
});
