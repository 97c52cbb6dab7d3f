import { expect, test } from "vitest";
import { groupMetrics, metricCurve, shortName } from "./metrics";

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
  expect(metricCurve(resumed, resumed.step)).toEqual({ x: [10, 20, 30], values: [3, null, 1] });
  expect(metricCurve(resumed, resumed.at)).toEqual({ x: [100, 300, 400], values: [3, 1, null] });
});
