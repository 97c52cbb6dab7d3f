import { expect, test } from "vitest";
import { groupMetrics, metricCurve, shortName, stepInterval, timesOfSteps } from "./metrics";

const metric = (name: string, step: number[] = [1], value: (number | null)[] = [0.5], at = step) => ({
  name,
  step,
  at,
  value,
  last_value: value.at(-1) ?? null,
});

test("metrics are grouped by the prefix before the last slash", () => {
  const names = ["entropy", "eval/a/return", "train/kl", "train/loss"].map((name) => metric(name));
  const groups = groupMetrics(names).map(({ prefix, metrics }) => [
    prefix,
    metrics.map(({ name }) => shortName(name)),
  ]);
  expect(groups).toEqual([
    ["", ["entropy"]],
    ["eval/a", ["return"]],
    ["train", ["kl", "loss"]],
  ]);
});

test("numbers within names are ordered by their value", () => {
  const names = ["layer10/kl", "layer2/loss10", "layer2/loss9", "Layer3/kl", "kl"].map((name) =>
    metric(name),
  );
  const ordered = groupMetrics(names).flatMap(({ metrics }) => metrics.map(({ name }) => name));
  expect(ordered).toEqual(["kl", "layer2/loss9", "layer2/loss10", "Layer3/kl", "layer10/kl"]);
});

test("a filter keeps names with all of its words", () => {
  const names = ["eval/loss", "train/KL", "train/loss"].map((name) => metric(name));
  const kept = (filter: string) =>
    groupMetrics(names, filter).flatMap(({ metrics }) => metrics.map(({ name }) => name));
  expect(kept("")).toHaveLength(3);
  expect(kept("  loss ")).toEqual(["eval/loss", "train/loss"]);
  expect(kept("kl TRAIN")).toEqual(["train/KL"]);
  expect(kept("absent")).toEqual([]);
});

test("a curve over time is ordered by time when a training resumed from an earlier step", () => {
  const resumed = metric("loss", [10, 20, 30], [3, null, 1], [100, 400, 300]);
  expect(metricCurve(resumed, "step")).toEqual({ x: [10, 20, 30], values: [3, null, 1] });
  expect(metricCurve(resumed, "time")).toEqual({ x: [100, 300, 400], values: [3, 1, null] });
});

test("the step axis has the steps of all metrics", () => {
  expect(stepInterval([metric("a", [5, 9], [1, 1]), metric("b", [2], [1])])).toEqual({ from: 2, to: 9 });
  expect(stepInterval([metric("a", [5])])).toEqual({ from: 5, to: 6 });
  expect(stepInterval([])).toEqual({ from: 0, to: 1 });
  const { from, to } = stepInterval([metric("a", [Number.MAX_SAFE_INTEGER])]);
  expect(from + (to - from) / 1000).toBeGreaterThan(from); // the axis can be divided
});

test("selected steps are the times at which they were reported", () => {
  const metrics = [metric("a", [10, 20, 30], [1, 1, 1], [100, 200, 300]), metric("b", [25], [1], [260])];
  expect(timesOfSteps(metrics, { from: 15, to: 26 })).toEqual({ from: 200, to: 260 });
  expect(timesOfSteps(metrics, { from: 31, to: 40 })).toBeUndefined();
});
