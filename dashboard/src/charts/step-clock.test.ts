import { expect, test } from "vitest";
import { EMPTY_CLOCK, stepAt, stepClock, stepInterval, timesOfSteps } from "./step-clock";

const reports = (step: number[], at = step) => ({ step, at });

test("a clock has the reports of all metrics in order of time", () => {
  const clock = stepClock([reports([10, 30], [100, 300]), reports([10, 20], [100, 200])]);
  expect(clock).toEqual({ at: [100, 200, 300], step: [10, 20, 30], newest: [10, 20, 30] });
});

test("a moment has the step between the reports around it", () => {
  const clock = stepClock([reports([10, 20, 40], [100, 200, 300])]);
  expect([0, 100, 150, 250, 300, 900].map((time) => stepAt(clock, time))).toEqual([10, 10, 15, 30, 40, 40]);
  expect(stepAt(EMPTY_CLOCK, 5)).toBe(0);
});

test("a training that resumes from an earlier step does not move the axis back", () => {
  const clock = stepClock([reports([10, 30, 20, 40], [100, 200, 300, 400])]);
  expect([200, 250, 300, 350].map((time) => stepAt(clock, time))).toEqual([30, 30, 30, 35]);
});

test("the step axis has the steps of all metrics", () => {
  expect(stepInterval(stepClock([reports([5, 9]), reports([2])]))).toEqual({ from: 2, to: 9 });
  expect(stepInterval(stepClock([reports([5])]))).toEqual({ from: 5, to: 6 });
  expect(stepInterval(EMPTY_CLOCK)).toEqual({ from: 0, to: 1 });
  const { from, to } = stepInterval(stepClock([reports([Number.MAX_SAFE_INTEGER])]));
  expect(from + (to - from) / 1000).toBeGreaterThan(from); // the axis can be divided
});

test("selected steps are the times at which they were reported", () => {
  const clock = stepClock([reports([10, 20, 30], [100, 200, 300]), reports([25], [260])]);
  expect(timesOfSteps(clock, { from: 15, to: 26 })).toEqual({ from: 200, to: 260 });
  expect(timesOfSteps(clock, { from: 31, to: 40 })).toBeUndefined();
});
