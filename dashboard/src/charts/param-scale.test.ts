import { expect, test } from "vitest";
import type { TaskParam } from "../lib/api-types";
import { changingParams, difficulty, paramCurves, paramEnds } from "./param-scale";
import { csv } from "./series";

const spec = (name: string, harder: "up" | "down", unit = ""): TaskParam => ({
  name,
  harder,
  unit,
  min: 0,
  max: 100,
  default: 1,
  description: "",
  step: 1,
  whole: false,
});
const LEVELS = {
  columns: ["debris", "radar", "fuel"],
  rows: [
    [10, 50, 3],
    [30, 20, 3],
  ],
};
const column = (...values: (number | null)[]) => ({ low: values, high: values, mean: values });

test("the ends of a param are those of the level table, else its valid values", () => {
  expect(paramEnds(spec("debris", "up"), LEVELS)).toEqual({ easiest: 10, hardest: 30 });
  expect(paramEnds(spec("radar", "down"), LEVELS)).toEqual({ easiest: 50, hardest: 20 });
  expect(paramEnds(spec("fuel", "down"), LEVELS)).toEqual({ easiest: 100, hardest: 0 });
  expect(paramEnds(spec("absent", "up"), LEVELS)).toEqual({ easiest: 0, hardest: 100 });
});

test("difficulty is 0 at the easiest and 1 at the hardest end, and continues beyond", () => {
  const ends = { easiest: 50, hardest: 20 };
  expect([50, 35, 20, 5].map((value) => difficulty(value, ends))).toEqual([0, 0.5, 1, 1.5]);
  expect(difficulty(3, { easiest: 3, hardest: 3 })).toBe(0);
});

test("a chart has the changing params, and its CSV file their own values", () => {
  const params = { debris: column(10, null, 30), radar: column(50, 35, 20), fuel: column(3, 3, null) };
  expect(changingParams({ params })).toEqual(["debris", "radar"]);
  const curves = paramCurves({ params }, [spec("debris", "up"), spec("radar", "down", "km")], LEVELS);
  expect(curves.map(({ label, values }) => [label, values])).toEqual([
    ["debris", [0, null, 1]],
    ["radar (km)", [0, 0.5, 1]],
  ]);
  expect(csv([1, 2, 3], curves.slice(1), "episodes").split("\n").slice(0, 2)).toEqual([
    'episodes,"radar (km)","radar (km), low","radar (km), high"',
    "1,50,50,50",
  ]);
});
