import { expect, test } from "vitest";
import { comparisonQuery, parseComparison } from "./compare-query";

test("an address without a choice has the defaults", () => {
  const view = parseComparison("runs=a,b,,a");
  expect(view).toEqual({
    runs: ["a", "b"],
    hidden: [],
    task: "",
    axis: "episodes",
    selected: null,
    smoothing: 0.5,
    grouping: "run",
    band: "interval",
    allSettings: false,
    baseline: "",
  });
  expect(comparisonQuery(view)).toBe("runs=a,b");
});

test("a query and its state are the same", () => {
  const query =
    "runs=a,b,c&hide=b&task=docking%2Fsingle&x=elapsed&smooth=0.8&from=1.5&to=20&group=setting%3Acurriculum.strategy&band=extremes&settings=all&baseline=c";
  expect(comparisonQuery(parseComparison(query))).toBe(query);
});

test("invalid values are the defaults", () => {
  const view = parseComparison("runs=a&x=nothing&smooth=7&band=wide&group=1&hide=z&from=9&to=3");
  expect(view).toEqual({ ...parseComparison("runs=a"), hidden: ["z"] });
  expect(comparisonQuery(view)).toBe("runs=a");
});
