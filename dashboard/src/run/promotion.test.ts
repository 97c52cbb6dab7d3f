import { expect, test } from "vitest";
import { curriculumChoice, masteryThresholds, promotionText } from "./promotion";

const block = { n: 12, size: 32, low: 9, high: 9, mean: 0.75, missing: 0, open: 0, waiting: 0 };
const task = (status: Record<string, unknown>) => ({ status, level: 3 });

test("a promotion names its condition and the progress of the block", () => {
  const move_conditions = { up: "one block of 32 with a mean above 0.7", down: null };
  expect(promotionText(task({ block, move_conditions }))).toBe(
    "One block of 32 with a mean above 0.7. Now: 12 of 32 scenarios have results, mean success 0.75.",
  );
  expect(promotionText(task({ block: { ...block, n: 0, mean: null, open: 1 }, move_conditions }))).toBe(
    "One block of 32 with a mean above 0.7. Now: 0 of 32 scenarios have results, 1 leased scenario without a result.",
  );
});

test("the hardest level and tasks without levels have no promotion", () => {
  expect(promotionText(task({ block, move_conditions: { up: null, down: "below" } }))).toBe(
    "The hardest level is reached.",
  );
  expect(promotionText(task({ block: null, move_conditions: null }))).toBe("");
});

test("only a ladder with the target mastery has thresholds of mastery", () => {
  const choice = (strategy: string, target: string) =>
    masteryThresholds(curriculumChoice({ settings: { curriculum: { strategy, target } } }));
  expect(choice("ladder", "mastery")).toEqual([0.3, 0.7]);
  expect(choice("ladder", "half")).toEqual([]);
  expect(choice("auto", "mastery")).toEqual([]);
  expect(masteryThresholds(curriculumChoice(null))).toEqual([]);
});

test("the level tables are those of the run", () => {
  const table = { columns: ["debris"], rows: [[1], [2]] };
  const settings = { curriculum: { tasks: [{ task: "kessler/survival", weight: 1, ...table }] } };
  expect(curriculumChoice({ settings }).levels.get("kessler/survival")).toEqual(table);
});
