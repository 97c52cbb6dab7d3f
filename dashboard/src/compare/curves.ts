/** Curves of several runs on one horizontal axis. */
import type { TaskSampler, TaskSeries } from "../lib/api-types";
import { smooth } from "../charts/smoothing";
import { middle, spans, type XAxis } from "../charts/x-axis";
import { meanBand, type BandKind, type Bounds } from "./intervals";

/** Quantity that is compared over the training. */
export type Quantity = "level" | "rung" | "skill" | "success";

/** Points of a run: ascending positions on the axis with their values. */
export interface RunPoints {
  x: number[];
  values: number[];
  /** True if a value holds until the next one. */
  stepped: boolean;
}

/** Values of a curve on the positions that all curves of a chart share; null where it has none. */
export interface GridCurve {
  values: (number | null)[];
  low?: (number | null)[];
  high?: (number | null)[];
}

/** Number of positions of a chart. */
const GRID_POINTS = 400;

/** Returns the points of a quantity of a task; empty if the run does not have it. */
export function runPoints(
  quantity: Quantity,
  { series, sampler }: { series: TaskSeries | undefined; sampler: TaskSampler | undefined },
  axis: XAxis,
  start: number,
  smoothing: number,
): RunPoints {
  if (quantity === "rung") {
    if (!sampler) return { x: [], values: [], stepped: false };
    const x = spans(axis, sampler, start).map(middle);
    return known(x, smooth(meanRungs(sampler), smoothing), false);
  }
  if (!series) return { x: [], values: [], stepped: false };
  const places = spans(axis, series, start);
  // The level at the end of each point holds until the end of the next one.
  if (quantity === "level")
    return known(
      places.map(({ to }) => to),
      series.level,
      true,
    );
  return known(places.map(middle), smooth(series[quantity], smoothing), false);
}

/** Returns the mean rung of the groups of each point of a sampler's course. */
export function meanRungs({ until, rungs }: TaskSampler): (number | null)[] {
  return until.map((_, i) => {
    const groups = rungs.map((rung) => rung.groups[i] ?? 0);
    const all = groups.reduce((sum, n) => sum + n, 0);
    return all > 0 ? rungs.reduce((sum, { rung }, at) => sum + rung * (groups[at] ?? 0), 0) / all : null;
  });
}

function known(x: number[], values: (number | null)[], stepped: boolean): RunPoints {
  const points = x.flatMap((at, i) => {
    const value = values[i];
    return typeof value === "number" && Number.isFinite(value) ? [{ at, value }] : [];
  });
  return { x: points.map(({ at }) => at), values: points.map(({ value }) => value), stepped };
}

/** Returns the positions of a chart, from the first to the last point of all runs. */
export function gridOf(runs: RunPoints[], from: number, to: number): number[] {
  if (runs.every(({ x }) => x.length === 0) || to <= from) return [];
  return Array.from({ length: GRID_POINTS }, (_, i) => from + ((to - from) * i) / (GRID_POINTS - 1));
}

/** Returns the value of a run at each position: between its first and its last point, null elsewhere. */
export function resample({ x, values, stepped }: RunPoints, grid: number[]): (number | null)[] {
  const [first, last] = [x[0] ?? Infinity, x.at(-1) ?? -Infinity];
  // A single point and the ends of a curve lie between positions: the nearest position has them.
  const reach = ((grid[1] ?? 0) - (grid[0] ?? 0)) / 2;
  let next = 0;
  return grid.map((at) => {
    if (at < first - reach || at > last + reach) return null;
    while (next < x.length && (x[next] ?? 0) <= at) next += 1;
    const [before, after] = [Math.max(0, next - 1), Math.min(next, x.length - 1)];
    const [a, b] = [x[before] ?? 0, x[after] ?? 0];
    const [low, high] = [values[before] ?? 0, values[after] ?? 0];
    const share = stepped || b <= a ? 0 : Math.min(1, Math.max(0, (at - a) / (b - a)));
    return low + share * (high - low);
  });
}

/** Returns the mean of several runs with its band, where all of them have a value. */
export function groupCurve(
  runs: RunPoints[],
  grid: number[],
  band: BandKind,
  bounds: Bounds = {},
): GridCurve {
  const resampled = runs.map((run) => resample(run, grid));
  if (resampled.length === 1) return { values: resampled[0] ?? [] };
  const bands = grid.map((_, i) => {
    const values = resampled.map((run) => run[i] ?? null).filter((value) => value !== null);
    return values.length === runs.length ? meanBand(values, band, bounds) : undefined;
  });
  return {
    values: bands.map((at) => at?.mean ?? null),
    low: bands.map((at) => at?.low ?? null),
    high: bands.map((at) => at?.high ?? null),
  };
}

/** Returns the mean of the last tenth of a run's points, at least of one; null without points. */
export function finalValue({ x, values, stepped }: RunPoints): number | null {
  if (x.length === 0) return null;
  if (stepped) return values.at(-1) ?? null;
  const last = values.slice(-Math.ceil(values.length / 10));
  return last.reduce((sum, value) => sum + value, 0) / last.length;
}
