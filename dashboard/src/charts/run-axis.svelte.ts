/** Horizontal axis of the charts of a run: its quantity, the shown part, and both in the address of the page. */
import { axisQuery, parseAxisQuery, timeQuery } from "./axis-query";
import { ShownRange, type AxisRange } from "./shown-range.svelte";
import { DEFAULT_SMOOTHING } from "./smoothing";
import { episodesAt, isTimeAxis, spans, type PlacedPoints, type XAxis } from "./x-axis";

/** Least number of episodes that can be selected. */
const MIN_EPISODES = 4;

export class RunAxis {
  /** Quantity of the axis. */
  kind = $state<XAxis>("time");
  /** Weight of the earlier values in smoothed curves, 0 to 0.95. */
  smoothing = $state(DEFAULT_SMOOTHING);
  /** Shown interval of time, in seconds since 1970. */
  readonly time = new ShownRange();
  /** Shown interval of the episodes of each task. */
  readonly episodes = new ShownRange(MIN_EPISODES);
  /** Start of the run, in seconds since 1970. */
  start = $state(0);

  /** The interval that the page selects: of time, or of episodes. */
  get range(): ShownRange {
    return isTimeAxis(this.kind) ? this.time : this.episodes;
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
      default:
        return this.#mapped(points);
    }
  }

  /** Range of steps or versions of a task; a selection selects the episodes at these positions. */
  #mapped(points: PlacedPoints): AxisRange {
    const { kind, episodes, start } = this;
    const places = spans(kind, points, start);
    const counts = spans("episodes", points, start);
    const from = places[0]?.from ?? 0;
    const shown = { from, to: Math.max(from + 1, places.at(-1)?.to ?? 1) };
    return {
      shown,
      select: (from, to) => episodes.select(episodesAt(from, places, counts), episodesAt(to, places, counts)),
      showAll: () => episodes.showAll(),
    };
  }

  /** Reads axis and selection from the query of the address; what is missing or invalid is the default. */
  parse(query: string) {
    const { kind, selected, smoothing } = parseAxisQuery(query);
    [this.kind, this.smoothing] = [kind, smoothing];
    this.time.selected = this.episodes.selected = null;
    this.range.selected = selected;
  }

  /** Returns axis and selection as the query of an address; empty for the defaults. */
  query(): string {
    return axisQuery({ kind: this.kind, selected: this.range.selected, smoothing: this.smoothing });
  }

  /** Returns the query of a series for the axis and the selection. */
  seriesQuery(): Record<string, string | number> {
    const { selected } = this.range;
    if (isTimeAxis(this.kind)) return selected ? timeQuery(selected) : {};
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
