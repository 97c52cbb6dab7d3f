/** Range and ticks of a value axis: linear or logarithmic, with or without outliers, of one chart or of several. */
import { MIN_RELATIVE_WIDTH, valueRange } from "./scale";
import type { Interval } from "./shown-range.svelte";

/** Choices of the user for the value axes of charts without fixed bounds. */
export interface ValueAxis {
  scale: "linear" | "log";
  /** True to leave outliers out of the range of the axis. */
  clip: boolean;
  /** True if the charts of a group have the same range. */
  shared: boolean;
}

/** Value axis before the user has chosen anything. */
export const DEFAULT_VALUE_AXIS: ValueAxis = { scale: "linear", clip: false, shared: false };

/** Columns of values, as charts draw them. */
export type ValueColumns = readonly (readonly (number | null)[])[];

/** Number of values below which none counts as an outlier. */
const MIN_VALUES = 8;
/** Distance of the fences from the quartiles, in interquartile ranges: "far out" in Tukey (1977). */
const FENCE = 3;
/** Ratio of the ends of a logarithmic range below which its ticks are linear. */
const MIN_DECADES = 1;
/** Margin of a logarithmic range, as a share of its width in decades. */
const LOG_MARGIN = 0.05;
/** Least positive value of a range: half of a smaller one can be 0. */
const MIN_POSITIVE = 1e-305;

/** Returns the values that an axis can show: all known ones, or the positive ones on a logarithmic axis. */
function drawable(columns: ValueColumns, { scale }: ValueAxis): number[] {
  return columns
    .flat()
    .filter((value): value is number => value !== null && (scale === "linear" || value > 0));
}

/** Returns the value at a share of sorted values, between its neighbours. */
function quantile(sorted: number[], share: number): number {
  const at = share * (sorted.length - 1);
  const [low, high] = [sorted[Math.floor(at)] ?? 0, sorted[Math.ceil(at)] ?? 0];
  // The weighted sum cannot overflow, unlike a difference of two large values.
  return (1 - (at % 1)) * low + (at % 1) * high;
}

/**
 * Returns the far fences of the values: three interquartile ranges beyond the quartiles. Values beyond them are outliers. Null if no
 * value counts as one: without clipping, and with too few values.
 */
export function fencesOf(columns: ValueColumns, axis: ValueAxis): Interval | null {
  const values = drawable(columns, axis);
  if (!axis.clip || values.length < MIN_VALUES) return null;
  const isLog = axis.scale === "log";
  const sorted = values.map((value) => (isLog ? Math.log10(value) : value)).sort((a, b) => a - b);
  const [low, high] = [quantile(sorted, 0.25), quantile(sorted, 0.75)];
  const reach = FENCE * (high - low);
  // Equal quartiles make every other value an outlier, which would hide a curve that seldom moves.
  if (!(reach > 0) || !Number.isFinite(reach)) return null;
  const [from, to] = [low - reach, high + reach];
  return isLog ? { from: 10 ** from, to: 10 ** to } : { from, to };
}

/** Returns the interval of the values that the axis shows; null if there are none. */
export function extentOf(columns: ValueColumns, axis: ValueAxis): Interval | null {
  const fences = fencesOf(columns, axis);
  const all = drawable(columns, axis);
  const values = fences ? all.filter((value) => value >= fences.from && value <= fences.to) : all;
  if (values.length === 0) return null;
  return {
    from: values.reduce((a, b) => Math.min(a, b)),
    to: values.reduce((a, b) => Math.max(a, b)),
  };
}

/** Returns the smallest interval that contains all of these; null if there are none. */
export function jointExtent(extents: (Interval | null)[]): Interval | null {
  const known = extents.filter((extent) => extent !== null);
  if (known.length === 0) return null;
  return {
    from: Math.min(...known.map(({ from }) => from)),
    to: Math.max(...known.map(({ to }) => to)),
  };
}

/** Returns the number of known values outside an interval. */
export function countOutside(columns: ValueColumns, { from, to }: Interval): number {
  return columns.flat().filter((value) => value !== null && (value < from || value > to)).length;
}

/** Returns the ends of a logarithmic axis for positive values, with a margin of 5 % of its width. */
export function logRange({ from, to }: Interval): [number, number] {
  const low = Math.max(from, MIN_POSITIVE);
  const high = Math.max(to, low);
  const [first, last] = [Math.log10(low), Math.log10(high)];
  const isConstant = high - low <= MIN_RELATIVE_WIDTH * high;
  const margin = isConstant ? Math.log10(2) : Math.max(LOG_MARGIN * (last - first), MIN_RELATIVE_WIDTH);
  return [10 ** Math.max(-307, first - margin), 10 ** Math.min(307, last + margin)];
}

/** Returns the ends of the value axis; `low` and `high` are those of the values, `min` and `max` fixed bounds. */
export function axisRange(
  extent: Interval | null,
  scale: ValueAxis["scale"],
  bounds: { min?: number | undefined; max?: number | undefined },
): [number, number] {
  if (scale === "log" && extent) return logRange(extent);
  return valueRange(extent?.from ?? null, extent?.to ?? null, bounds);
}

/** Returns the numbers 1, 2 and 5 times powers of ten between two positive numbers. */
function oneTwoFive(from: number, to: number): number[] {
  const first = Math.floor(Math.log10(from));
  const count = Math.ceil(Math.log10(to)) - first;
  const all = Array.from({ length: count + 1 }, (_, i) => i).flatMap((i) =>
    [1, 2, 5].map((digit) => Number(`${String(digit)}e${String(first + i)}`)),
  );
  return all.filter((tick) => tick >= from && tick <= to);
}

/** Returns at most about `most` ticks between two numbers at equal distances of 1, 2 or 5 times a power of ten. */
function linearTicks(from: number, to: number, most: number): number[] {
  const rough = (to - from) / Math.max(1, most);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = ([1, 2, 5, 10].find((digit) => digit * power >= 0.999 * rough) ?? 10) * power;
  const first = Math.ceil(from / step);
  const count = Math.floor(to / step) - first;
  return Array.from({ length: count + 1 }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

/** Returns the ticks of a logarithmic axis: about `most` of them, at powers of ten if the range has several. */
export function logTicks(from: number, to: number, most: number): number[] {
  const decades = Math.log10(to) - Math.log10(from);
  if (decades < MIN_DECADES) return linearTicks(from, to, most);
  const fine = oneTwoFive(from, to);
  if (fine.length <= most) return fine;
  const every = Math.max(1, Math.ceil(decades / Math.max(1, most)));
  const first = Math.ceil(Math.log10(from));
  const last = Math.floor(Math.log10(to));
  return Array.from({ length: last - first + 1 }, (_, i) => first + i)
    .filter((exponent) => exponent % every === 0)
    .map((exponent) => Number(`1e${String(exponent)}`));
}
