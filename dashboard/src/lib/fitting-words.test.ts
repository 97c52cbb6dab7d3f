import { expect, test } from "vitest";
import { fittingWords } from "./fitting-words";

const split = (words: string[], lines = 2, chars = 15) => {
  const { shown, others } = fittingWords(words, { lines, chars });
  return [shown.join(" "), others.join(" ")];
};

test("words that fit are shown, the others are counted", () => {
  expect(split(["demo", "demo-learn"])).toEqual(["demo demo-learn", ""]);
  expect(split(["demo", "demo-learn", "seed-1"])).toEqual(["demo", "demo-learn seed-1"]);
  expect(split(["a", "b", "c", "d"])).toEqual(["a b c d", ""]);
  expect(split([])).toEqual(["", ""]);
});

test("the first word is shown even if it is too long", () => {
  expect(split(["a-tag-that-is-longer-than-the-line", "b"], 1)[0]).toBe("a-tag-that-is-longer-than-the-line");
});
