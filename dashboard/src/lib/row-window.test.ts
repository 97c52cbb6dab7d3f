import { expect, test } from "vitest";
import { rowWindow } from "./row-window";

test("only rows near the window are drawn", () => {
  expect(rowWindow(1000, 40, 100, 800, 2)).toEqual({ first: 0, end: 20 });
  expect(rowWindow(1000, 40, -4000, 800, 2)).toEqual({ first: 98, end: 122 });
  expect(rowWindow(1000, 40, -39_800, 800, 2)).toEqual({ first: 993, end: 1000 });
});
test("a list outside the window draws nothing, and a short one all", () => {
  expect(rowWindow(10, 40, 5000, 800, 2)).toEqual({ first: 0, end: 0 });
  expect(rowWindow(10, 40, -5000, 800, 2)).toEqual({ first: 10, end: 10 });
  expect(rowWindow(3, 40, 0, 800)).toEqual({ first: 0, end: 3 });
  expect(rowWindow(3, 0, 0, 800)).toEqual({ first: 0, end: 1 });
});
