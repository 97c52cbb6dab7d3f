import { expect, test } from "vitest";
import { levelList, levelRange } from "./run-levels";

test("a run has one level, the range of its tasks, or none", () => {
  const tasks = (...levels: (number | null)[]) =>
    levels.map((level, i) => ({ task: `w/task_${String(i)}`, level }));
  expect([tasks(3), tasks(2, 0, 2), tasks(2, 2), tasks(null), tasks(1, null), []].map(levelRange)).toEqual([
    "3",
    "0–2",
    "2",
    "–",
    "1",
    "–",
  ]);
  expect(levelList(tasks(3, null))).toBe("task 0: level 3, task 1: level –");
  expect(levelList(tasks(null))).toBe("No task has a level");
});
