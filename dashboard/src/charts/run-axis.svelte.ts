/** Axes of the charts of a run: the quantity of the horizontal one, the shown part, the value axes; all in the address. */
import { axisQuery, parseAxisQuery, timeQuery } from "./axis-query";
import { ShownRange, type AxisRange } from "./shown-range.svelte";
import { DEFAULT_SMOOTHING } from "./smoothing";
import { EMPTY_CLOCK, stepInterval, timesOfSteps, type StepClock } from "./step-clock";
import { DEFAULT_VALUE_AXIS, type ValueAxis } from "./value-axis";
import {
  episodesAt,
  hasTimeRange,
  isTimeAxis,
  positionOf,
  spans,
  type PlacedPoints,
  type Span,
  type XAxis,
} from "./x-axis";

/** Least number of episodes that can be selected. */
const MIN_EPISODES = 4;

export class RunAxis {
  /** Quantity of the axis. */
  kind = $state<XAxis>("time");
  /** Weight of the earlier values in smoothed curves, 0 to 0.95. */
  smoothing = $state(DEFAULT_SMOOTHING);
  /** Value axes of the charts without fixed bounds. */
  values = $state<ValueAxis>({ ...DEFAULT_VALUE_AXIS });
  /** Shown interval of time, in seconds since 1970. */
  readonly time = new ShownRange();
  /** Shown interval of the episodes of each task. */
  readonly episodes = new ShownRange(MIN_EPISODES);
  /** Start of the run, in seconds since 1970. */
  start = $state(0);
  /** Steps of the trainer in the shown interval of time. */
  clock = $state.raw<StepClock>(EMPTY_CLOCK);

  /** The interval that the page selects: of time, or of episodes. */
  get range(): ShownRange {
    return hasTimeRange(this.kind) ? this.time : this.episodes;
  }

  /** Returns the part of the axis that each point of a series covers. */
  places(points: PlacedPoints): Span[] {
    return spans(this.kind, points, this.start, this.clock);
  }

  /** Returns the position of a moment, in seconds since 1970, on the axis of a task whose points are at `places`. */
  positionOf(seconds: number, points: PlacedPoints, places: Span[]): number {
    if (this.kind === "time") return seconds;
    return this.kind === "elapsed" ? seconds - this.start : (positionOf(seconds, points, places) ?? 0);
  }

  /** Returns the range of the axis for the charts of a task. */
  rangeOf(points: PlacedPoints): AxisRange {
    switch (this.kind) {
      case "time":
        return this.time;
      case "episodes":
        return this.episodes;
      case "elapsed":
        return shifted(this.time, () => this.start);
      case "step":
        return this.#stepRange();
      default:
        return this.#mapped(points);
    }
  }

  /** Range of the trainer's steps; a selection selects the times at which they were reported. */
  #stepRange(): AxisRange {
    const { time, clock } = this;
    return {
      shown: stepInterval(clock),
      select: (from, to) => {
        const times = timesOfSteps(clock, { from, to });
        if (times) time.select(times.from, times.to);
      },
      showAll: () => time.showAll(),
    };
  }

  /** Range of environment steps or versions of a task; a selection selects the episodes at these positions. */
  #mapped(points: PlacedPoints): AxisRange {
    const { episodes } = this;
    const places = this.places(points);
    const counts = spans("episodes", points, this.start);
    const from = places[0]?.from ?? 0;
    const shown = { from, to: Math.max(from + 1, places.at(-1)?.to ?? 1) };
    return {
      shown,
      select: (from, to) => episodes.select(episodesAt(from, places, counts), episodesAt(to, places, counts)),
      showAll: () => episodes.showAll(),
    };
  }

  /** Reads axes and selection from the query of the address; what is missing or invalid is the default. */
  parse(query: string) {
    const { kind, selected, smoothing, values } = parseAxisQuery(query);
    [this.kind, this.smoothing, this.values] = [kind, smoothing, values];
    this.time.selected = this.episodes.selected = null;
    this.range.selected = selected;
  }

  /** Returns axes and selection as the query of an address; empty for the defaults. */
  query(): string {
    const { kind, smoothing, values } = this;
    return axisQuery({ kind, selected: this.range.selected, smoothing, values });
  }

  /** Returns the query of a series for the axis and the selection. */
  seriesQuery(): Record<string, string | number> {
    const { selected } = this.range;
    if (hasTimeRange(this.kind) && selected) return timeQuery(selected);
    if (isTimeAxis(this.kind)) return {};
    if (!selected) return { by: "episodes" };
    const [from, to] = [Math.floor(selected.from), Math.ceil(selected.to)];
    return { by: "episodes", from_episode: from, to_episode: to };
  }
}

/** The same range with another origin. */
function shifted(range: AxisRange, origin: () => number): AxisRange {
  return {
    get shown() {
      const { from, to } = range.shown;
      return { from: from - origin(), to: to - origin() };
    },
    select: (from, to) => range.select(from + origin(), to + origin()),
    showAll: () => range.showAll(),
  };
}
