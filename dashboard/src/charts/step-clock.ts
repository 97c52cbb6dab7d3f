/** Steps of the trainer over time, as its metrics report them: places the curves of the curriculum over these steps. */
import type { TrainerMetric } from "../lib/api-types";
import { MIN_RELATIVE_WIDTH } from "./scale";
import type { Interval } from "./shown-range.svelte";

/** Reports of a trainer in ascending order of time. */
export interface StepClock {
  /** Times in seconds since 1970. */
  at: number[];
  /** Step of each report. A training that resumes from an earlier step reports lower steps at later times. */
  step: number[];
  /** Highest step so far. */
  newest: number[];
}

/** Clock of a run whose trainer reports nothing. */
export const EMPTY_CLOCK: StepClock = { at: [], step: [], newest: [] };

/** Returns the reports of all metrics, each time and step once. */
export function stepClock(metrics: Pick<TrainerMetric, "at" | "step">[]): StepClock {
  const reports = new Map<string, [number, number]>();
  for (const { at, step } of metrics)
    at.forEach((time, i) => reports.set(`${String(time)} ${String(step[i])}`, [time, step[i] ?? 0]));
  const sorted = [...reports.values()].sort(([a, first], [b, second]) => a - b || first - second);
  let highest = -Infinity;
  return {
    at: sorted.map(([time]) => time),
    step: sorted.map(([, step]) => step),
    newest: sorted.map(([, step]) => (highest = Math.max(highest, step))),
  };
}

/** Returns the highest step at a time, between the reports around it; the nearest report's outside of them, 0 without any. */
export function stepAt({ at, newest }: StepClock, time: number): number {
  let [low, high] = [0, at.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((at[middle] ?? 0) < time) low = middle + 1;
    else high = middle;
  }
  const [before, after] = [newest[low - 1] ?? newest[0] ?? 0, newest[low] ?? newest.at(-1) ?? 0];
  const [from, to] = [at[low - 1] ?? time, at[low] ?? time];
  return to > from ? before + ((after - before) * (time - from)) / (to - from) : after;
}

/** Returns the first and the last step; at least one step apart, and far enough for numbers on the axis. */
export function stepInterval({ step }: StepClock): Interval {
  if (step.length === 0) return { from: 0, to: 1 };
  const first = step.reduce((a, b) => Math.min(a, b));
  const last = step.reduce((a, b) => Math.max(a, b));
  return { from: first, to: Math.max(last, first + Math.max(1, MIN_RELATIVE_WIDTH * first)) };
}

/** Returns the times of the first and the last report with a step in an interval; undefined if there are none. */
export function timesOfSteps({ at, step }: StepClock, { from, to }: Interval): Interval | undefined {
  const times = at.filter((_, i) => (step[i] ?? -1) >= from && (step[i] ?? -1) <= to);
  const [first, last] = [times[0], times.at(-1)];
  return first === undefined || last === undefined ? undefined : { from: first, to: last };
}
