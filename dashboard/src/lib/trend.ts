/** Whether a curve rises: its last quarter against the quarter before. */

import type { TaskSeries } from "./api-types";

/** Least number of known values in each of the two quarters. */
const MIN_VALUES = 4;
/** Standard errors of a difference above which it is a trend: with two, one task in twenty would have a trend by chance. */
const SIGNIFICANT = 3;

export interface Trend {
  /** Mean of the last quarter. */
  last: number;
  /** Mean of the last quarter minus that of the quarter before. */
  difference: number;
  direction: "rising" | "falling" | "steady";
}

/** Returns the trend of values at equal distances; null if too few are known. */
export function trendOf(values: (number | null)[]): Trend | null {
  const quarter = Math.floor(values.length / 4);
  const before = moments(values.slice(-2 * quarter, -quarter));
  const last = moments(values.slice(-quarter));
  if (quarter === 0 || !before || !last) return null;
  const difference = last.mean - before.mean;
  const isTrend = Math.abs(difference) > SIGNIFICANT * Math.sqrt(last.variance + before.variance);
  return {
    last: last.mean,
    difference,
    direction: !isTrend ? "steady" : difference > 0 ? "rising" : "falling",
  };
}

/**
 * Returns the trend of a task's skill at its current level; null with too few points at it. A higher level lowers the skill of an agent
 * that learns, so that the skill at other levels is no part of the trend.
 */
export function skillTrend({ skill, level }: Pick<TaskSeries, "skill" | "level">): Trend | null {
  const current = level.at(-1);
  return trendOf(skill.map((value, point) => (level[point] === current ? value : null)));
}

/** Mean of the known values, and the variance of this mean. */
function moments(values: (number | null)[]): { mean: number; variance: number } | null {
  const known = values.filter((value): value is number => value !== null);
  if (known.length < MIN_VALUES) return null;
  const mean = known.reduce((sum, value) => sum + value, 0) / known.length;
  const squares = known.reduce((sum, value) => sum + (value - mean) ** 2, 0);
  return { mean, variance: squares / (known.length - 1) / known.length };
}
