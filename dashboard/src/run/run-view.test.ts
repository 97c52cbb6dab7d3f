import { expect, test } from "vitest";
import { EVENT_FILTERS, kindsOf } from "./event-filters";
import { chosenTasks, isOtherPlace, parseRunView, runViewQuery, type RunView } from "./run-view";

const DEFAULT: RunView = { tab: "learning", task: "", events: "all", metrics: "" };

test("the address holds tab, task and filters", () => {
  expect(runViewQuery(DEFAULT)).toBe("");
  expect(
    runViewQuery({ ...DEFAULT, tab: "trainer", task: "kessler/survival", metrics: "train/ loss&1" }),
  ).toBe("tab=trainer&task=kessler/survival&metrics=train/%20loss%261");
  const views: Partial<RunView>[] = [
    { tab: "activity", events: "failures" },
    { task: "all" },
    { tab: "parameters", task: "docking/single" },
    { tab: "trainer", metrics: "a+b = c" },
  ];
  for (const view of views)
    expect(parseRunView(runViewQuery({ ...DEFAULT, ...view }))).toEqual({ ...DEFAULT, ...view });
  expect(parseRunView("tab=nonsense&x=episodes&events=move")).toEqual(DEFAULT);
});

test("the back button undoes a choice, not a word of a search", () => {
  expect(isOtherPlace(DEFAULT, { ...DEFAULT, tab: "activity" })).toBe(true);
  expect(isOtherPlace(DEFAULT, { ...DEFAULT, task: "all" })).toBe(true);
  expect(isOtherPlace(DEFAULT, { ...DEFAULT, events: "moves" })).toBe(true);
  expect(isOtherPlace(DEFAULT, { ...DEFAULT, metrics: "loss" })).toBe(false);
});

test("every filter of events has kinds of its own", () => {
  expect(kindsOf("failures")).toBe("design,failures");
  expect(new Set(EVENT_FILTERS.map(({ kinds }) => kinds)).size).toBe(EVENT_FILTERS.length);
});

test("an unknown task stands for the first one", () => {
  const tasks = [{ task: "a" }, { task: "b" }];
  expect(chosenTasks(tasks, "b")).toEqual([{ task: "b" }]);
  expect(chosenTasks(tasks, "")).toEqual([{ task: "a" }]);
  expect(chosenTasks(tasks, "c")).toEqual([{ task: "a" }]);
  expect(chosenTasks(tasks, "all")).toEqual(tasks);
  expect(chosenTasks([], "a")).toEqual([]);
});
