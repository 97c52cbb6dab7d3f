import { expect, test } from "vitest";
import {
  bestFirst,
  conclusion,
  differenceText,
  meanOverTasks,
  QUANTITIES,
  type GroupEnd,
  type QuantitySpec,
} from "./final-values";

const skill: QuantitySpec = {
  quantity: "skill",
  name: "Skill",
  axis: "",
  end: "",
  format: (value) => value.toFixed(2),
};
const level: QuantitySpec = { ...skill, quantity: "level", name: "Level" };
const group = (label: string, skills: number[], levels = skills.map(() => 5)): GroupEnd => ({
  label,
  runs: skills.length,
  values: new Map([
    ["skill", skills],
    ["level", levels],
  ]),
});

test("a difference has an interval from three runs on", () => {
  expect(differenceText([0.6], [0.5], skill)).toEqual({ text: "+0.10", isReal: false });
  expect(differenceText([], [0.5], skill).text).toBe("–");
  const found = differenceText([0.8, 0.81, 0.79], [0.5, 0.52, 0.48], skill);
  expect(found).toEqual({ text: "+0.30 [+0.26, +0.34]", isReal: true });
});

test("differences of success rates are percentage points, and whole levels have no decimals", () => {
  const spec = (quantity: string) => QUANTITIES.find((one) => one.quantity === quantity) ?? skill;
  expect(spec("success").format(0.89)).toBe("89 %");
  expect(differenceText([0.89], [0.916], spec("success")).text).toBe("−2.6 pp");
  expect([3, 2.25].map(spec("level").format)).toEqual(["3", "2.3"]);
  expect(differenceText([2], [3], spec("level")).text).toBe("−1");
});

test("the mean over tasks needs a value of each, and the best group is first", () => {
  expect([meanOverTasks([1, 2]), meanOverTasks([1, null]), meanOverTasks([])]).toEqual([1.5, null, null]);
  const groups = [group("low", [0.9], [1]), group("less skilled", [0.5], [3]), group("best", [0.7], [3])];
  expect(bestFirst(groups).map(({ label }) => label)).toEqual(["best", "less skilled", "low"]);
  const none: GroupEnd = { label: "none", runs: 1, values: new Map() };
  expect(bestFirst([none, none, ...groups]).at(-1)?.label).toBe("none");
});

test("the conclusion names the first quantity that differs beyond the seeds", () => {
  const a = group("a", [0.5, 0.52, 0.48]);
  const b = group("b", [0.8, 0.81, 0.79]);
  expect(conclusion([a, b], a, [level, skill])).toBe("b ends above a in skill, by 0.30 [+0.26, +0.34].");
  expect(conclusion([a, b], b, [level, skill])).toContain("a ends below b in skill");
  const c = group("c", [0.4, 0.6, 0.5]);
  expect(conclusion([a, c], a, [level, skill])).toBe("c and a do not differ beyond their seeds.");
  expect(conclusion([a], a, [skill])).toBe("");
});

test("too few runs have no conclusion", () => {
  const [a, b] = [group("a", [0.5]), group("b", [0.9])];
  expect(conclusion([a, b], a, [skill])).toContain("Single runs have no interval");
  const two = group("two", [0.5, 0.6]);
  const three = group("three", [0.5, 0.6, 0.7]);
  expect(conclusion([two, three], two, [skill])).toContain("two (2 runs): too few runs");
});
