import { expect, test } from "vitest";
import type { FailureModeCounts } from "./api-types";
import { avoidableShare, frequentModes, meanStepsLeft, rateTrend } from "./failure-rates";

const cell = { count: 1, episodes: [], last_at: "", weight: 1 };
const mode = (cells: object[], weight = 1, count = 1) =>
  ({
    mode: String(weight),
    description: "",
    count,
    weight,
    inertial_sectors: [],
    cells,
  }) as FailureModeCounts;

test("a rate rises or falls by at least a tenth", () => {
  expect(rateTrend({ overall: 0.5, recent: 0.6 })).toBe("▲ Rising");
  expect(rateTrend({ overall: 0.5, recent: 0.4 })).toBe("▼ Falling");
  expect(rateTrend({ overall: 0.5, recent: 0.52 })).toBe("Unchanged");
  expect(rateTrend({ overall: 0, recent: 0 })).toBe("");
  expect(rateTrend(null)).toBe("");
});

test("means over cells are weighted by failures and skip unknown values", () => {
  const some = mode([
    { ...cell, count: 3, mean_steps_left: 2, avoidable_share: 1 },
    { ...cell, count: 1, mean_steps_left: 6, avoidable_share: 0 },
    { ...cell, count: 9, mean_steps_left: null },
  ]);
  expect(meanStepsLeft(some)).toBe(3);
  expect(avoidableShare(some)).toBe(0.75);
  expect(meanStepsLeft(mode([cell]))).toBeNull();
});

test("frequent failure modes come first, and absent ones are left out", () => {
  const modes = [mode([], 1), mode([], 5), mode([], 9, 0)];
  expect(frequentModes(modes).map(({ weight }) => weight)).toEqual([5, 1]);
});
