/** Charts of the timeline of a replay: reward, and one quantity of each agent. */
import { isKessler, isTasking, type AnyFrame, type DockingFrame } from "./frames";

/** Curve of a chart, with one value for each frame. */
export interface TimelineCurve {
  /** Agent of the curve; null for all together. */
  agent: number | null;
  values: number[];
}

/** Chart with its quantity and range. */
export interface TimelineChart {
  /** Quantity with its unit, the label of the axis. */
  title: string;
  curves: TimelineCurve[];
  low: number;
  high: number;
}

/** Common axis of the charts: steps, or minutes in worlds whose steps differ in duration. */
export interface TimelineAxis {
  title: string;
  /** Position of each frame. */
  positions: number[];
  end: number;
}

/** Noun for the agents of a world. */
export function agentNoun(frames: AnyFrame[]): "satellite" | "deputy" {
  return isKessler(frames) || isTasking(frames) ? "satellite" : "deputy";
}

/** Returns the numbers of the agents of a replay. */
export function agentsOf(frames: AnyFrame[]): number[] {
  if (isKessler(frames) || isTasking(frames)) return frames[0]?.state.satellites.map(({ id }) => id) ?? [];
  return (frames as DockingFrame[])[0]?.state.deputies.map(({ id }) => id) ?? [];
}

/** Returns the common axis of the charts. */
export function timelineAxis(frames: AnyFrame[]): TimelineAxis {
  if (isTasking(frames)) {
    const positions = frames.map(({ state }) => state.time_s / 60);
    return { title: "Time (min)", positions, end: Math.max(positions.at(-1) ?? 0, 1) };
  }
  const positions = frames.map((_, index) => index);
  const unit = isKessler(frames) ? "TU" : "s";
  return { title: `Step (1 ${unit} each)`, positions, end: Math.max(frames.length - 1, 1) };
}

/** Returns the charts of a replay. */
export function timelineCharts(frames: AnyFrame[]): TimelineChart[] {
  const rewards = frames.map(({ reward }) => reward);
  return [ofAgents(frames), chart("Reward per step", [{ agent: null, values: rewards }])];
}

function ofAgents(frames: AnyFrame[]): TimelineChart {
  const curves = (valueAt: (frame: number, agent: number) => number) =>
    agentsOf(frames).map((agent) => ({ agent, values: frames.map((_, frame) => valueAt(frame, agent)) }));
  if (isKessler(frames))
    return chart(
      "Fuel (units)",
      curves((frame, agent) => frames[frame]?.state.satellites[agent]?.fuel ?? 0),
      0,
    );
  if (isTasking(frames))
    return chart(
      "Battery (%)",
      curves((frame, agent) => 100 * (frames[frame]?.state.satellites[agent]?.battery ?? 0)),
      0,
      100,
    );
  const docking = frames as DockingFrame[];
  return chart(
    "Distance to the chief (m)",
    curves((frame, agent) => docking[frame]?.state.deputies[agent]?.distance ?? 0),
    0,
  );
}

function chart(title: string, curves: TimelineCurve[], from?: number, to?: number): TimelineChart {
  let [low, high] = [from ?? 0, to ?? -Infinity];
  let smallest = Infinity;
  for (const { values } of curves)
    for (const value of values) {
      smallest = Math.min(smallest, value);
      if (to === undefined) high = Math.max(high, value);
    }
  if (from === undefined) low = Math.min(low, smallest);
  // An axis from 0 would join curves that differ by little.
  else if (to === undefined && smallest > 0.5 * high && smallest < high)
    low = smallest - 0.1 * (high - smallest);
  return { title, curves, low, high: high > low ? high : low + 1 };
}

/** Returns round numbers from `low` to `high`, at most about `count`. */
export function roundTicks(low: number, high: number, count: number): number[] {
  const rough = (high - low) / Math.max(count, 1);
  if (!(rough > 0) || !Number.isFinite(rough)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999) ?? 10);
  const ticks: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++)
    ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

/** Moves places apart that are closer than `gap`; the result has the order of the places, within `low` and `high`. */
export function spreadLabels(places: number[], gap: number, low: number, high: number): number[] {
  const order = places.map((_, index) => index).sort((a, b) => (places[a] ?? 0) - (places[b] ?? 0));
  const moved = [...places];
  let previous = low - gap;
  for (const index of order) {
    previous = Math.max(places[index] ?? 0, previous + gap);
    moved[index] = previous;
  }
  let next = high + gap;
  for (const index of order.reverse()) {
    next = Math.min(moved[index] ?? 0, next - gap);
    moved[index] = next;
  }
  return moved;
}
