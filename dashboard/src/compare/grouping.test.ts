import { expect, test } from "vitest";
import { groupRuns, parseGrouping, runLabel } from "./grouping";

const run = (id: string, seed: number, strategy: string, tags: string[] = [], name = id) => ({
  id,
  name,
  seed,
  tags,
  settings: { strategy, group_size: 8 },
});
const RUNS = [
  run("a", 1, "ladder", ["paper", "arm-1"]),
  run("b", 2, "uniform", ["paper", "arm-2"]),
  run("c", 3, "ladder", ["paper", "arm-1"]),
  run("d", 4, "plr", ["paper"]),
];

test("runs that differ by their seed alone are one group", () => {
  expect(groupRuns(RUNS, "settings")).toEqual([
    { label: "arm-1, strategy ladder", runs: ["a", "c"] },
    { label: "arm-2, strategy uniform", runs: ["b"] },
    { label: "strategy plr", runs: ["d"] },
  ]);
  const seeds = [1, 2].map((seed) => run(`s${String(seed)}`, seed, "plr", [`seed-${String(seed)}`]));
  expect(groupRuns(seeds, "settings").map(({ runs }) => runs)).toEqual([["s1", "s2"]]);
  expect(groupRuns(RUNS.slice(0, 1), "settings")).toEqual([{ label: "a", runs: ["a"] }]);
});

test("tags that all runs have do not separate groups", () => {
  expect(groupRuns(RUNS, "tags")).toEqual([
    { label: "arm-1", runs: ["a", "c"] },
    { label: "arm-2", runs: ["b"] },
    { label: "without a tag", runs: ["d"] },
  ]);
});

test("runs of different learners, which only tags name, are different groups", () => {
  const runs = [run("a", 1, "plr", ["demo", "demo-learn"]), run("b", 1, "plr", ["demo", "demo-hold"])];
  expect(groupRuns(runs, "settings").map(({ label }) => label)).toEqual(["demo-learn", "demo-hold"]);
});

test("groups by a setting", () => {
  expect(groupRuns(RUNS, "setting:strategy").map(({ label }) => label)).toEqual(["ladder", "uniform", "plr"]);
  expect(groupRuns(RUNS, "setting:group_size")).toEqual([{ label: "8", runs: ["a", "b", "c", "d"] }]);
  expect(groupRuns(RUNS, "setting:nothing")).toEqual([{ label: "–", runs: ["a", "b", "c", "d"] }]);
});

test("every run has a label of its own", () => {
  const same = [run("x", 1, "plr", [], "demo"), run("y", 2, "plr", [], "demo")];
  expect(groupRuns(same, "run").map(({ label }) => label)).toEqual(["demo, seed 1", "demo, seed 2"]);
  const equal = [run("x", 1, "plr", [], "demo"), run("y", 1, "plr", [], "demo")];
  expect(runLabel(equal[1], equal)).toBe("demo, y");
  // Groups whose short settings agree, but whose long ones differ.
  const long = [1, 2].map((n) => ({
    ...run(String(n), n, "plr"),
    settings: { list: [n, ...Array(30).fill(0)] },
  }));
  expect(new Set(groupRuns(long, "settings").map(({ label }) => label)).size).toBe(2);
});

test("an address names the grouping", () => {
  expect(parseGrouping(null)).toBe("run");
  expect(parseGrouping("nonsense")).toBe("run");
  expect(parseGrouping("setting:curriculum.strategy")).toBe("setting:curriculum.strategy");
});
