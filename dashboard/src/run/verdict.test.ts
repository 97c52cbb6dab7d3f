import { expect, test } from "vitest";
import type { FailureModeCounts, TaskMastery } from "../lib/api-types";
import { verdictOf, type VerdictFacts } from "./verdict";

const POINTS = 40;
const curve = (skill: (share: number) => number, level: (share: number) => number = () => 3) => ({
  success: Array.from({ length: POINTS }, (_, i) => (i < 30 ? 0.2 : 0.95)),
  skill: Array.from({ length: POINTS }, (_, i) => skill(i / POINTS) + (i % 2 === 0 ? 0.01 : -0.01)),
  level: Array.from({ length: POINTS }, (_, i) => level(i / POINTS)),
  version_low: Array.from({ length: POINTS }, (_, i) => i),
  version_high: Array.from({ length: POINTS }, (_, i) => i + 1),
});
const task = (over: Partial<TaskMastery> = {}, mean = 0.5, missing = 0): TaskMastery => ({
  task: "kessler/survival",
  level: 3,
  levels: [],
  mastery: { level: 3, n: 64, mean, q10: mean, q90: mean, missing, open: 0, seen: 64 },
  results: { episodes: 1000, successes: 500, failed: 0, expired: 0, success: mean },
  designed_results: { episodes: 0, successes: 0, failed: 0, expired: 0 },
  claimed_results: { episodes: 0, failed: 0, refused: 0, unproven: 0, expired: 0 },
  group_counts: { complete: 100, partial: 0, lost: 0, zero_variance: 0, zero_variance_share: 0.1 },
  params: {},
  placement_done: true,
  status: {},
  warnings: [],
  ...over,
});
const facts = (over: Partial<VerdictFacts> = {}): VerdictFacts => ({
  curve: curve(() => 0.5),
  topLevel: 9,
  failure: undefined,
  layouts: 0,
  ...over,
});

test("a level that rose or a skill that rises is learning", () => {
  const climb = facts({
    curve: curve(
      () => 0.5,
      (share) => Math.floor(8 * share),
    ),
  });
  expect(verdictOf(task({ level: 7 }), climb)).toEqual({
    answer: "learning",
    sentence: "Yes: its level rose from 3 to 7 in the second half of its episodes.",
    advice: "",
  });
  const rising = verdictOf(task(), facts({ curve: curve((share) => share) }));
  expect([rising.answer, rising.sentence]).toEqual([
    "learning",
    "Yes: its skill rises at level 3, by 0.25 in the last quarter.",
  ]);
});

test("a falling level or skill is worse, and evaluations find the best version", () => {
  const fallen = verdictOf(
    task(),
    facts({
      curve: curve(
        () => 0.5,
        (share) => (share < 0.5 ? 5 : 3),
      ),
    }),
  );
  expect(fallen.sentence).toBe("No: its level fell from 5 to 3 in the second half of its episodes.");
  const falling = verdictOf(task(), facts({ curve: curve((share) => 1 - share) }));
  expect([falling.answer, falling.advice]).toEqual([
    "worse",
    "Compare the policy versions by evaluations, and continue from the best one.",
  ]);
});

test("a fixed policy does not learn, whatever its level", () => {
  const versions = Array.from({ length: POINTS }, () => 0);
  const climb = curve(
    (share) => share,
    (share) => Math.floor(8 * share),
  );
  const fixed = { ...climb, version_low: versions, version_high: versions };
  const verdict = verdictOf(task({ level: 7 }), facts({ curve: fixed }));
  expect([verdict.answer, verdict.sentence]).toEqual([
    "fixed",
    "No: all of its episodes have policy version 0. A fixed policy does not learn.",
  ]);
  expect(verdict.advice).toContain("send a new policy version");
  const unknown = versions.map(() => null);
  const silent = { ...climb, version_low: unknown, version_high: unknown };
  expect(verdictOf(task({ level: 7 }), facts({ curve: silent })).answer).toBe("learning");
});

test("a mastered task needs harder levels, or a strategy that raises its level", () => {
  const top = verdictOf(task({ level: 9 }, 0.97), facts());
  expect([top.answer, top.sentence, top.advice]).toEqual([
    "mastered",
    "It has little left to learn here: 97 % success at the hardest level.",
    "Add harder levels, or give other tasks more weight.",
  ]);
  const sampled = verdictOf(task({ level: null, mastery: null }), facts({ topLevel: undefined }));
  expect(sampled.sentence).toBe(
    "It has little left to learn here: 95 % success in the last quarter of its episodes.",
  );
  expect(verdictOf(task({}, 0.97), facts()).answer).toBe("steady");
});

test("what holds a steady task back decides the advice", () => {
  const advice = (of: TaskMastery, over: Partial<VerdictFacts> = {}) => verdictOf(of, facts(over)).advice;
  expect(advice(task({}, 0.5, 0.2))).toContain("20 % of its outcomes are missing");
  expect(advice(task({}, 0.02))).toContain("out of reach: lower the level");
  expect(advice(task({ level: 0 }, 0.02))).toContain("add an easier one");
  const equal = { complete: 9, partial: 0, lost: 0, zero_variance: 8, zero_variance_share: 0.8 };
  expect(advice(task({ group_counts: equal }))).toContain("80 % of its groups have equal scores");
  const failure = {
    mode: "spent_before_threat",
    count: 40,
    weight: 9,
    cells: [{ count: 40, avoidable_share: 0.7 }],
  } as unknown as FailureModeCounts;
  expect(advice(task(), { failure })).toBe(
    "70 % of the failures “spent before threat” are avoidable: let a designer aim at them.",
  );
  expect(advice(task(), { failure, layouts: 3 })).toContain("settings of the learner");
});

test("few episodes and placement have no verdict", () => {
  const probed = verdictOf(task({ level: null, probe_level: 4 }), facts());
  expect([probed.answer, probed.sentence]).toEqual(["unknown", "Placement looks for its first level."]);
  expect(verdictOf(task(), facts({ curve: undefined }))).toEqual({
    answer: "unknown",
    sentence: "Too few episodes at level 3 to say.",
    advice: "",
  });
});
