import { expect, test } from "vitest";
import { TimeRange, endOf } from "./range.svelte";
import { csv } from "./series";

test("CSV has a row for each point, its intervals, and quotes where a name has them", () => {
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

test("a stretch stays within what there is", () => {
  const range = new TimeRange();
  range.whole = { from: 0, to: 10_000 };
  range.choose(-500, 4_000);
  expect(range.shown).toEqual({ from: 0, to: 4_000 });
  range.pan(10);
  expect(range.shown).toEqual({ from: 6_000, to: 10_000 });
  range.zoom(0.5);
  expect(range.shown).toEqual({ from: 7_000, to: 9_000 });
  range.choose(5, 10); // shorter than can be told apart
  expect(range.shown).toEqual({ from: 7_000, to: 9_000 });
  range.zoom(10);
  expect(range.chosen).toBeNull();
  range.last(1_000);
  expect(range.shown).toEqual({ from: 9_000, to: 10_000 });
});

test("all there is ends a little after the last data where nothing came for long", () => {
  expect(endOf({ from: 0, to: 10_000 }, 9_500)).toBe(10_000); // they come
  expect(endOf({ from: 0, to: 100_000 }, 10_000)).toBe(10_300);
  expect(endOf({ from: 0, to: 100 }, undefined)).toBe(100);
});
