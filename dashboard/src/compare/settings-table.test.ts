import { expect, test } from "vitest";
import { settingsKey, settingsTable } from "./settings-table";

const run = (seed: number, strategy: string, weight = 1) => ({
  seed,
  settings: {
    group_size: 12,
    curriculum: {
      strategy,
      tasks: [
        { task: "kessler/survival", weight, rows: [[1, 2]] },
        { task: "docking/single", weight: 1, rows: [] },
      ],
    },
  },
});

test("the table has only leaves, with the names of tasks in their paths", () => {
  const rows = settingsTable([run(1, "ladder"), run(2, "uniform", 3)]);
  expect(rows[0]).toEqual({ path: "seed", values: ["1", "2"], differs: true });
  expect(rows.filter(({ differs }) => differs).map(({ path }) => path)).toEqual([
    "seed",
    "curriculum.strategy",
    "curriculum.tasks.kessler/survival.weight",
  ]);
  expect(rows.find(({ path }) => path === "curriculum.tasks.kessler/survival.rows")?.values[0]).toBe(
    "[[1,2]]",
  );
});

test("a setting that a run does not have is undefined", () => {
  const rows = settingsTable([
    { seed: 1, settings: { judge: null } },
    { seed: 1, settings: {} },
  ]);
  expect(rows).toEqual([
    { path: "seed", values: ["1", "1"], differs: false },
    { path: "judge", values: ["null", undefined], differs: true },
  ]);
});

test("the key ignores the seed alone", () => {
  expect(settingsKey(run(1, "ladder"))).toBe(settingsKey(run(2, "ladder")));
  expect(settingsKey(run(1, "ladder"))).not.toBe(settingsKey(run(1, "uniform")));
});
