/** The axes of the charts of a run in addresses and requests. */
import type { Interval } from "./shown-range.svelte";
import { DEFAULT_SMOOTHING } from "./smoothing";
import { DEFAULT_VALUE_AXIS, type ValueAxis } from "./value-axis";
import { hasTimeRange, RUN_AXES, type XAxis } from "./x-axis";

/** What the charts of a run show. */
export interface AxisSelection {
  kind: XAxis;
  /** Selected interval: of time in seconds since 1970, or of episodes. */
  selected: Interval | null;
  /** Weight of the earlier values in smoothed curves, 0 to 0.95. */
  smoothing: number;
  /** Value axes of the charts without fixed bounds. */
  values: ValueAxis;
}

/** Reads axes and selection from the query of an address; what is missing or invalid is the default. */
export function parseAxisQuery(query: string): AxisSelection {
  const params = new URLSearchParams(query);
  const kind = RUN_AXES.find(([axis]) => axis === params.get("x"))?.[0] ?? "time";
  const [from, to] = [Number(params.get("from") ?? NaN), Number(params.get("to") ?? NaN)];
  const weight = Number(params.get("smooth") ?? NaN);
  return {
    kind,
    selected: from >= 0 && to > from && Number.isFinite(to) ? { from, to } : null,
    smoothing: weight >= 0 && weight <= 0.95 ? weight : DEFAULT_SMOOTHING,
    values: {
      scale: params.get("y") === "log" ? "log" : DEFAULT_VALUE_AXIS.scale,
      clip: params.get("outliers") === "clip",
      shared: params.get("range") === "group",
    },
  };
}

/** Returns axes and selection as the query of an address; empty for the defaults. */
export function axisQuery({ kind, selected, smoothing, values }: AxisSelection): string {
  const text = (value: number) => String(Number(value.toFixed(hasTimeRange(kind) ? 3 : 0)));
  return new URLSearchParams({
    ...(kind === "time" ? {} : { x: kind }),
    ...(smoothing === DEFAULT_SMOOTHING ? {} : { smooth: String(smoothing) }),
    ...(values.scale === "log" ? { y: "log" } : {}),
    ...(values.clip ? { outliers: "clip" } : {}),
    ...(values.shared ? { range: "group" } : {}),
    ...(selected ? { from: text(selected.from), to: text(selected.to) } : {}),
  }).toString();
}

/** Returns the query of an interval of time for a request. */
export function timeQuery({ from, to }: Interval): { from: string; to: string } {
  const moment = (seconds: number) => new Date(1000 * seconds).toISOString();
  return { from: moment(from), to: moment(to) };
}
