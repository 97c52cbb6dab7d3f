import { expect, test } from "vitest";
import { chosenTasks, parseRunView, runViewQuery } from "./run-view";

test("the address holds tab and task", () => {
  expect(runViewQuery({ tab: "learning", task: "" })).toBe("");
  expect(runViewQuery({ tab: "trainer", task: "kessler/survival" })).toBe(
    "tab=trainer&task=kessler/survival",
  );
  for (const view of [
    { tab: "activity", task: "" },
    { tab: "learning", task: "all" },
    { tab: "parameters", task: "docking/single" },
  ] as const)
    expect(parseRunView(runViewQuery(view))).toEqual(view);
  expect(parseRunView("tab=nonsense&x=episodes")).toEqual({ tab: "learning", task: "" });
});

test("an unknown task stands for the first one", () => {
  const tasks = [{ task: "a" }, { task: "b" }];
  expect(chosenTasks(tasks, "b")).toEqual([{ task: "b" }]);
  expect(chosenTasks(tasks, "")).toEqual([{ task: "a" }]);
  expect(chosenTasks(tasks, "c")).toEqual([{ task: "a" }]);
  expect(chosenTasks(tasks, "all")).toEqual(tasks);
  expect(chosenTasks([], "a")).toEqual([]);
});
