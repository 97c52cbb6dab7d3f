import { expect, test } from "vitest";
import { ShownRange, endOfData } from "./shown-range.svelte";
import { csv } from "./series";

test("CSV has a row for each point, columns for intervals, and escaped quotes", () => {
  const text = csv(
    [0, 60],
    [
      { label: 'a "b"', colour: "--c0", values: [0.5, null], low: [0.4, null], high: [0.6, null] },
      { label: "c", colour: "--c1", values: [1, 2] },
    ],
  );
  expect(text.split("\n")).toEqual([
    'time,"a ""b""","a ""b"", low","a ""b"", high","c"',
    "1970-01-01T00:00:00.000Z,0.5,0.4,0.6,1",
    "1970-01-01T00:01:00.000Z,,,,2",
    "",
  ]);
});

test("CSV of steps has no times", () => {
  expect(csv([20], [{ label: "loss", colour: "--c0", values: [0.5] }], "step")).toBe('step,"loss"\n20,0.5\n');
});

test("a selection stays within the available interval", () => {
  const range = new ShownRange();
  range.available = { from: 0, to: 10_000 };
  range.select(-500, 4_000);
  expect(range.shown).toEqual({ from: 0, to: 4_000 });
  range.pan(10);
  expect(range.shown).toEqual({ from: 6_000, to: 10_000 });
  range.zoom(0.5);
  expect(range.shown).toEqual({ from: 7_000, to: 9_000 });
  range.select(7_000.2, 7_000.9); // shorter than the minimum
  expect(range.shown).toEqual({ from: 7_000, to: 9_000 });
  range.zoom(10);
  expect(range.selected).toBeNull();
  range.last(1_000);
  expect(range.shown).toEqual({ from: 9_000, to: 10_000 });
});

test("the shown interval ends shortly after the last data", () => {
  expect(endOfData({ from: 0, to: 10_000 }, 9_500)).toBe(10_000); // data still arrive
  expect(endOfData({ from: 0, to: 100_000 }, 10_000)).toBe(10_300);
  expect(endOfData({ from: 0, to: 100 }, undefined)).toBe(100);
});
