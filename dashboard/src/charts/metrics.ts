/** Metrics that a trainer logged, as curves of charts. */
import type { TrainerMetric } from "../lib/api-types";

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

/**
 * Returns the values of a metric at the positions `x` of its points, in ascending order of position: a training that resumes
 * from an earlier step reports lower steps at later times. A value is null where no value was finite.
 */
export function metricCurve(
  { value }: TrainerMetric,
  x: number[],
): { x: number[]; values: (number | null)[] } {
  const order = x.map((_, i) => i).sort((a, b) => (x[a] ?? 0) - (x[b] ?? 0));
  return { x: order.map((i) => x[i] ?? 0), values: order.map((i) => value[i] ?? null) };
}
