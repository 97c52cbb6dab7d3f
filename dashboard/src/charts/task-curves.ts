/** Curves of a task that follow from its series: throughput and level; and the ranges that tasks share. */
import type { RecordedMove, TaskSeries } from "../lib/api-types";
import type { Curve } from "./series";
import type { Interval } from "./shown-range.svelte";
import { extentOf, jointExtent, type ValueAxis } from "./value-axis";
import type { Span } from "./x-axis";

/** Returns the reported episodes per second of each point; null for results of one moment, which have no rate. */
export function throughput({ at, until, episodes, claimed }: TaskSeries): (number | null)[] {
  return at.map((from, i) => {
    const [count, to] = [(episodes[i] ?? 0) + (claimed[i] ?? 0), until[i] ?? from];
    if (count > 0 && to <= from) return null;
    return count === 0 ? 0 : count / (to - from);
  });
}

/** Level of a task along the axis: positions and values. */
export interface LevelCourse {
  x: number[];
  curve: Pick<Curve, "values" | "low" | "high" | "bounds">;
}

/**
 * Returns the level along the axis: of the moves if the strategy makes any, which is exact, otherwise of the episodes in each point.
 * `at` are the positions of the moves, `x` those of the points.
 */
export function levelCourse(
  series: TaskSeries,
  x: number[],
  places: Span[],
  moves: RecordedMove[],
  at: number[],
): LevelCourse {
  const first = moves[0];
  if (first === undefined) {
    const { level, level_low, level_high } = series;
    return { x, curve: { values: level, low: level_low, high: level_high, bounds: "minimum to maximum" } };
  }
  const [begin, end] = [places[0]?.from ?? 0, places.at(-1)?.to ?? 0];
  const values = [first.from ?? null, ...moves.map((move) => move.to), moves.at(-1)?.to ?? null];
  return { x: [Math.min(begin, ...at), ...at, Math.max(end, ...at)], curve: { values } };
}

/** Quantities whose charts have no fixed bounds: all tasks can share their range. */
export const FREE_QUANTITIES = {
  skill: ({ skill, score }: TaskSeries) => [skill, score],
  duration: ({ duration_s }: TaskSeries) => [duration_s],
  throughput: (series: TaskSeries) => [throughput(series)],
} as const;
export type FreeQuantity = keyof typeof FREE_QUANTITIES;

/** Returns the value axis of a quantity: skill can be negative, so that its axis is always linear. */
export function quantityAxis(quantity: FreeQuantity, values: ValueAxis): ValueAxis {
  return quantity === "skill" ? { ...values, scale: "linear" } : values;
}

/** Returns the range that all tasks share for a quantity; null if each chart has its own. */
export function sharedExtent(quantity: FreeQuantity, all: TaskSeries[], values: ValueAxis): Interval | null {
  if (!values.shared) return null;
  const axis = quantityAxis(quantity, values);
  return jointExtent(all.map((series) => extentOf(FREE_QUANTITIES[quantity](series), axis)));
}
