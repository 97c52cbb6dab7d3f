/** Horizontal axes of the charts of a run: positions of points on them, and conversions between time and position. */
import type { TaskSeries } from "../lib/api-types";
import { time } from "../lib/format";
import { EMPTY_CLOCK, stepAt, type StepClock } from "./step-clock";

/** Quantity of the horizontal axis. `step` is the trainer's step, `steps` are environment steps of a task. */
export type XAxis = "time" | "elapsed" | "episodes" | "steps" | "version" | "step";

/** Axes that the charts of a run offer, with their names. */
export const RUN_AXES: [XAxis, string][] = [
  ["time", "time"],
  ["elapsed", "time since the start"],
  ["episodes", "episodes"],
  ["steps", "environment steps"],
  ["version", "policy version"],
  ["step", "trainer step"],
];

/** Label below a chart. */
export const AXIS_LABELS: Record<XAxis, string> = {
  time: "time",
  elapsed: "time since the start",
  episodes: "episodes of the task",
  steps: "environment steps of the task",
  version: "policy version",
  step: "step of the trainer",
};

/** True if positions are seconds; otherwise they are numbers of episodes, steps or versions. */
export function isTimeAxis(axis: XAxis): boolean {
  return axis === "time" || axis === "elapsed";
}

/** True if the user selects an interval of time on this axis; otherwise an interval of episodes. */
export function hasTimeRange(axis: XAxis): boolean {
  return isTimeAxis(axis) || axis === "step";
}

/** Position of a point of a series. */
export interface Span {
  from: number;
  to: number;
}

/** Columns of a series or of the course of a sampler that place its points. */
export type PlacedPoints = Pick<
  TaskSeries,
  "at" | "until" | "first_episode" | "first_step" | "steps" | "episodes"
> &
  Partial<Pick<TaskSeries, "claimed" | "version_high">>;

/** Points of a task without episodes. */
export const NO_POINTS: PlacedPoints = {
  at: [],
  until: [],
  first_episode: [],
  first_step: [],
  steps: [],
  episodes: [],
};

/**
 * Returns the part of the axis that each point covers. `start` is the start of the run in seconds since 1970, `clock` has the
 * steps of its trainer.
 */
export function spans(
  axis: XAxis,
  points: PlacedPoints,
  start: number,
  clock: StepClock = EMPTY_CLOCK,
): Span[] {
  let newest = 0;
  return points.at.map((at, i) => {
    const until = points.until[i] ?? at;
    const episodes = (points.episodes[i] ?? 0) + (points.claimed?.[i] ?? 0);
    switch (axis) {
      case "elapsed":
        return { from: at - start, to: until - start };
      case "episodes": {
        const first = points.first_episode[i] ?? 0;
        return { from: first, to: first + episodes };
      }
      case "steps": {
        const first = points.first_step[i] ?? 0;
        return { from: first, to: first + (points.steps[i] ?? 0) };
      }
      case "version": {
        // Results of older versions arrive late: the axis has the newest version so far.
        const from = newest;
        newest = Math.max(newest, points.version_high?.[i] ?? 0);
        return { from: i === 0 ? newest : from, to: newest };
      }
      case "step":
        return { from: stepAt(clock, at), to: stepAt(clock, until) };
      default:
        return { from: at, to: until };
    }
  });
}

/** Returns the middle of a part of the axis. */
export function middle({ from, to }: Span): number {
  return (from + to) / 2;
}

/**
 * Returns the position of a moment on the axis, between the points before and after it. Without points it is undefined.
 */
export function positionOf(time: number, points: PlacedPoints, places: Span[]): number | undefined {
  const next = points.until.findIndex((until) => until >= time);
  if (next < 0) return places.at(-1)?.to;
  const [place, from, to] = [places[next], points.at[next] ?? time, points.until[next] ?? time];
  if (!place) return undefined;
  const share = to > from ? Math.min(1, Math.max(0, (time - from) / (to - from))) : 1;
  return place.from + share * (place.to - place.from);
}

/** Returns the number of episodes at a position on the axis of a task, between its points. */
export function episodesAt(position: number, places: Span[], episodes: Span[]): number {
  const next = places.findIndex(({ to }) => to >= position);
  if (next < 0) return episodes.at(-1)?.to ?? 0;
  const [place, here] = [places[next], episodes[next]];
  if (!place || !here) return 0;
  const share =
    place.to > place.from ? Math.min(1, Math.max(0, (position - place.from) / (place.to - place.from))) : 1;
  return here.from + share * (here.to - here.from);
}

/** Formats a duration on an axis: 45 s, 12 min, 3.5 h or 2 d, as exact as the `step` between two labels. */
export function durationText(seconds: number, step: number): string {
  const units: [number, string][] = [
    [86_400, "d"],
    [3600, "h"],
    [60, "min"],
  ];
  const [size, unit] = units.find(([size]) => Math.abs(seconds) >= size && step >= size / 10) ?? [1, "s"];
  return `${String(Number((seconds / size).toFixed(step >= size ? 0 : 1)))} ${unit}`;
}

/** Formats a position on an axis as text: a time, a duration or a number. */
export function positionText(axis: XAxis, at: number): string {
  if (axis === "time") return time(1000 * at);
  if (axis === "elapsed") return durationText(at, 0);
  return at.toLocaleString("en", { maximumFractionDigits: axis === "step" ? 3 : 0 });
}
