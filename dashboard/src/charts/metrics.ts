/** Metrics that a trainer logged, as curves of charts. */
import type { TrainerMetric } from "../lib/api-types";
import { MIN_RELATIVE_WIDTH } from "./scale";
import type { Interval } from "./shown-range.svelte";

/** Axis of the charts: time of the report, or step of the trainer. */
export type MetricAxis = "time" | "step";

/** Metrics whose names have the same prefix before the last slash; it is empty for names without one. */
export interface MetricGroup {
  prefix: string;
  metrics: TrainerMetric[];
}

/** Returns the part of a metric's name after its group's prefix. */
export function shortName(name: string): string {
  return name.slice(name.lastIndexOf("/") + 1);
}

/** Orders the numbers within names by their value: layer2 before layer10. */
const byName = new Intl.Collator("en", { numeric: true });

/** Groups the metrics whose names contain all words of `filter`, in whatever case; groups and metrics are ordered by name. */
export function groupMetrics(metrics: TrainerMetric[], filter = ""): MetricGroup[] {
  const words = filter.toLowerCase().split(/\s+/);
  const groups = new Map<string, TrainerMetric[]>();
  for (const metric of metrics) {
    const name = metric.name.toLowerCase();
    if (!words.every((word) => name.includes(word))) continue;
    const prefix = metric.name.slice(0, Math.max(0, metric.name.lastIndexOf("/")));
    groups.set(prefix, [...(groups.get(prefix) ?? []), metric]);
  }
  return [...groups]
    .map(([prefix, metrics]) => ({
      prefix,
      metrics: metrics.sort((a, b) => byName.compare(a.name, b.name)),
    }))
    .sort((a, b) => byName.compare(a.prefix, b.prefix));
}

/** Curve of a metric: positions on the axis in ascending order, and their values; null where no value was finite. */
export function metricCurve(
  metric: TrainerMetric,
  axis: MetricAxis,
): { x: number[]; values: (number | null)[] } {
  const x = axis === "time" ? metric.at : metric.step;
  const value = (i: number) => metric.value[i] ?? null;
  // A training that resumes from an earlier step reports lower steps at later times.
  const order = x.map((_, i) => i).sort((a, b) => (x[a] ?? 0) - (x[b] ?? 0));
  return { x: order.map((i) => x[i] ?? 0), values: order.map(value) };
}

/** Returns the first and the last step of all metrics; at least one step apart, and far enough for numbers on the axis. */
export function stepInterval(metrics: TrainerMetric[]): Interval {
  const first = Math.min(...metrics.map((metric) => metric.step[0] ?? Infinity));
  const last = Math.max(...metrics.map((metric) => metric.step.at(-1) ?? -Infinity));
  if (first > last) return { from: 0, to: 1 };
  return { from: first, to: Math.max(last, first + Math.max(1, MIN_RELATIVE_WIDTH * first)) };
}

/** Returns the times of the points with steps in an interval; undefined if there are none. */
export function timesOfSteps(metrics: TrainerMetric[], { from, to }: Interval): Interval | undefined {
  const times = metrics.flatMap(({ step, at }) =>
    at.filter((_, i) => (step[i] ?? -1) >= from && (step[i] ?? -1) <= to),
  );
  if (times.length === 0) return undefined;
  const bound = (choose: (a: number, b: number) => number) => times.reduce((a, b) => choose(a, b));
  return { from: bound(Math.min), to: bound(Math.max) };
}
