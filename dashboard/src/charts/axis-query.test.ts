import { expect, test } from "vitest";
import { axisQuery, parseAxisQuery } from "./axis-query";
import { DEFAULT_SMOOTHING as smoothing } from "./smoothing";
import { DEFAULT_VALUE_AXIS as values } from "./value-axis";

test("the address holds axes, selection and smoothing", () => {
  expect(axisQuery({ kind: "time", selected: null, smoothing, values })).toBe("");
  const selected = { from: 10.2, to: 99.9 };
  expect(axisQuery({ kind: "episodes", selected, smoothing: 0.8, values })).toBe(
    "x=episodes&smooth=0.8&from=10&to=100",
  );
  const chosen = { scale: "log", clip: true, shared: true } as const;
  expect(axisQuery({ kind: "time", selected: null, smoothing, values: chosen })).toBe(
    "y=log&outliers=clip&range=group",
  );
  for (const selection of [
    { kind: "time", selected: { from: 1_800_000_000.125, to: 1_800_000_010 }, smoothing: 0, values },
    { kind: "version", selected: { from: 4, to: 96 }, smoothing, values: { ...values, clip: true } },
    { kind: "elapsed", selected: null, smoothing: 0.95, values: chosen },
    { kind: "step", selected: { from: 5.5, to: 6 }, smoothing, values: { ...values, scale: "log" } },
  ] as const)
    expect(parseAxisQuery(axisQuery(selection))).toEqual(selection);
});

test("invalid parts of an address are the defaults", () => {
  for (const query of [
    "x=nonsense",
    "from=5",
    "from=9&to=8",
    "from=a&to=b",
    "from=0&to=Infinity",
    "smooth=1",
    "y=square&outliers=1&range=all",
  ])
    expect(parseAxisQuery(query)).toEqual({ kind: "time", selected: null, smoothing, values });
});
