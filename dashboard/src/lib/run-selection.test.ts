import { expect, test } from "vitest";
import type { RunSummary } from "./api-types";
import { RunSelection } from "./run-selection.svelte";

const run = (id: string) => ({ id, name: id }) as RunSummary;
const runs = (count: number) => Array.from({ length: count }, (_, i) => run(`run-${String(i)}`));

/** List of `count` runs in pages of ten; `step` is called before each page. */
const list = (count: number, step: (loaded: number) => void = () => undefined) => ({
  fetchAll: async (progress: (loaded: number) => boolean) => {
    for (let loaded = 0; loaded < count; loaded += 10) {
      step(loaded);
      if (!progress(loaded)) return [];
      await Promise.resolve();
    }
    return runs(count);
  },
});

test("all runs of a view are selected, with progress", async () => {
  const selection = new RunSelection();
  const seen: (number | null)[] = [];
  await selection.selectAll([list(35, () => seen.push(selection.loaded))], "view");
  expect(selection.size).toBe(35);
  expect(seen).toEqual([0, 0, 10, 20]);
  expect([selection.loaded, selection.completed]).toEqual([null, "view"]);
  selection.toggle(run("run-3"));
  expect([selection.size, selection.has("run-3"), selection.completed]).toEqual([34, false, ""]);
});

test("a cancelled loading selects nothing more", async () => {
  const selection = new RunSelection();
  selection.add(runs(2));
  await selection.selectAll(
    [
      list(35, (loaded) => {
        if (loaded === 20) selection.cancel();
      }),
    ],
    "view",
  );
  expect([selection.size, selection.loaded, selection.completed]).toEqual([2, null, ""]);
});

test("a failed loading ends, and its error reaches the caller", async () => {
  const selection = new RunSelection();
  const failing = { fetchAll: () => Promise.reject(new Error("no answer")) };
  await expect(selection.selectAll([failing], "view")).rejects.toThrow("no answer");
  expect([selection.size, selection.loaded]).toEqual([0, null]);
});

test("newer states replace selected runs only", () => {
  const selection = new RunSelection();
  selection.add(runs(1));
  selection.update([{ ...run("run-0"), name: "renamed" }, run("other")]);
  expect(selection.runs.map(({ name }) => name)).toEqual(["renamed"]);
});

test("runs are selected by their ids, without those that do not exist", async () => {
  const selection = new RunSelection();
  const load = (id: string) =>
    id === "gone" ? Promise.reject(new Error("unknown")) : Promise.resolve(run(id));
  const restored = selection.restore(["run-1", "gone"], load);
  expect([selection.ids, selection.size]).toEqual([["run-1", "gone"], 0]);
  await restored;
  expect([selection.ids, selection.size]).toEqual([["run-1"], 1]);
  const late = selection.restore(["run-2"], load);
  selection.clear();
  await late;
  expect(selection.ids).toEqual([]);
});
