/** Rungs of a sampler in the form that charts and tables show. */
import type { RungKind, SamplerRung, TaskSampler } from "../lib/api-types";
import { significant } from "../lib/format";
import type { Curve } from "./series";
import type { Span } from "./x-axis";

/** Point of the course at a rung that has results. */
export interface CourseCell {
  /** Part of the axis that the point covers. */
  place: Span;
  /** End of the point, in seconds since 1970. */
  until: number;
  /** Index of the rung. */
  rung: number;
  /** Number of groups with results. */
  groups: number;
  /** Share of the point's groups, 0 to 1. */
  share: number;
  /** Success rate of their episodes; null without a finished episode. */
  success: number | null;
}

/** Returns the quantity of the axis of rungs. */
export function rungQuantity(kind: RungKind): string {
  return kind === "start" ? "start scale" : "level";
}

/** Returns the label of a rung on its axis: the start scale with two digits, or the level. */
export function rungLabel({ rung, start_scale }: SamplerRung): string {
  return typeof start_scale === "number" ? significant(Number(start_scale.toPrecision(2))) : String(rung);
}

/** Returns the cells of the course, by point and rung. `places` are the parts of the axis that the points cover. */
export function courseCells({ until, rungs }: TaskSampler, places: Span[]): CourseCell[] {
  return places.flatMap((place, i) => {
    const all = rungs.reduce((sum, { groups }) => sum + (groups[i] ?? 0), 0);
    return rungs.flatMap(({ groups, group_success }, rung) => {
      const here = groups[i] ?? 0;
      const success = group_success[i] ?? null;
      return here > 0
        ? [{ place, until: until[i] ?? 0, rung, groups: here, share: here / all, success }]
        : [];
    });
  });
}

/** Returns the course as curves for a CSV file: groups and success rate of each rung. */
export function courseCurves({ kind, rungs }: TaskSampler): Curve[] {
  if (!kind) return [];
  return rungs.flatMap((rung) => {
    const name = `${rungQuantity(kind)} ${rungLabel(rung)}`;
    return [
      { label: `${name}, groups`, colour: "--c0", values: rung.groups },
      { label: `${name}, success rate`, colour: "--c2", values: rung.group_success },
    ];
  });
}

/** Returns the distance between two labels, in rungs, so that labels of `size` pixels fit into `length` pixels. */
export function labelInterval(count: number, length: number, size: number): number {
  return Math.max(1, Math.ceil((count * size) / Math.max(1, length)));
}
