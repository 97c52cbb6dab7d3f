import { expect, test } from "vitest";
import { failureSelection, selectionParams } from "./failure-selection";

const read = (query: string) => failureSelection(new URLSearchParams(query));

test("a selection is a mode, or a cell of its rose", () => {
  expect(read("task=kessler/survival&mode=collision")).toEqual({
    task: "kessler/survival",
    mode: "collision",
  });
  expect(read("task=t&mode=m&sector=3&band=0")).toEqual({ task: "t", mode: "m", sector: 3, band: 0 });
  expect(read("task=t&mode=m&band=1&sector=-2")).toEqual({ task: "t", mode: "m" });
  expect([read(""), read("mode=m"), failureSelection(null)]).toEqual([null, null, null]);
});

test("a selection survives the address", () => {
  const selection = { task: "t", mode: "m", sector: 0, band: 2 };
  const params = selectionParams(selection).map(([name, value]) => [name, value]);
  expect(read(new URLSearchParams(params).toString())).toEqual(selection);
});
