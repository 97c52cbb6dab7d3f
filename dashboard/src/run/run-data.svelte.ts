/** Data of the page of a run, which reloads them while events arrive. */
import { timeQuery } from "../charts/axis-query";
import type { RunAxis } from "../charts/run-axis.svelte";
import { endOfData, type Interval } from "../charts/shown-range.svelte";
import { stepClock } from "../charts/step-clock";
import { hasTimeRange, isTimeAxis, type XAxis } from "../charts/x-axis";
import { client, unwrap } from "../lib/api";
import type {
  RecordedMove,
  RunMastery,
  RunOverview,
  RunSampler,
  RunSeries,
  RunSummary,
  TrainerMetric,
} from "../lib/api-types";
import { rememberRun } from "../lib/known-runs.svelte";
import { LatestRequest } from "../lib/latest-request";

/** Number of points of a chart. */
const POINTS = 300;
/** Number of columns of the heat map of a sampler. */
const SAMPLER_POINTS = 60;
/** Number of points of a chart of a trainer's metric, which is small. */
const METRIC_POINTS = 150;

/** Parts of the data that only some tabs show. */
export interface LoadOptions {
  sampler: boolean;
  metrics: boolean;
  /** Task whose episodes select the metrics, if a range of episodes is selected. */
  task: string;
}

const seconds = (at: string) => new Date(at).getTime() / 1000;

export class RunData {
  series = $state.raw<RunSeries | null>(null);
  sampler = $state.raw<RunSampler | null>(null);
  mastery = $state.raw<RunMastery | null>(null);
  overview = $state.raw<RunOverview | null>(null);
  details = $state.raw<RunSummary | null>(null);
  moves = $state.raw<RecordedMove[]>([]);
  metrics = $state.raw<TrainerMetric[]>([]);
  /** True once the trainer has logged a metric; it stays true when the selected range has none. */
  hasMetrics = $state(false);
  /** Quantity of the axis of the last load. */
  loadedAxis = $state<XAxis>();
  /** Number of loads; other parts of the page load together with it. */
  loads = $state(0);
  error = $state<unknown>(null);

  readonly #run: string;
  readonly #axis: RunAxis;
  readonly #latest = new LatestRequest();
  #isLoading = false;
  #isStale = true;
  /** True after a long time without episodes: the charts then end with the last data. */
  #isQuiet = false;

  constructor(run: string, axis: RunAxis) {
    [this.#run, this.#axis] = [run, axis];
  }

  /** True if events arrived after the last load, and no load is under way. */
  get isDue(): boolean {
    return this.#isStale && !this.#isLoading;
  }

  /** Requests a load at the next opportunity. */
  invalidate() {
    this.#isStale = true;
  }

  async load(options: LoadOptions) {
    const isCurrent = this.#latest.begin();
    this.#isLoading = true;
    this.#isStale = false;
    const { kind, range } = this.#axis;
    const { selected } = range;
    const path = { run: this.#run };
    try {
      const [charts, mastery, newMoves, overview, details] = await Promise.all([
        this.#loadCharts(this.#axis.seriesQuery(), options),
        unwrap(client.GET("/v1/runs/{run}/mastery", { params: { path } })),
        this.#loadNewMoves(),
        unwrap(client.GET("/v1/runs/{run}/overview", { params: { path } })),
        unwrap(client.GET("/v1/runs/{run}", { params: { path } })),
      ]);
      if (!isCurrent()) return;
      let { series, sampler } = charts;
      // Without recent episodes the curves would fill only the left part: load the part with data.
      const end = selected || !isTimeAxis(kind) ? undefined : quietEnd(series);
      if (end !== undefined)
        ({ series, sampler } = await this.#loadCharts(
          timeQuery({ from: seconds(series.from), to: end }),
          options,
        ));
      const metrics = await this.#loadMetrics(series, options);
      if (!isCurrent()) return;
      this.#isQuiet =
        end !== undefined || (selected !== null && this.#isQuiet && overview.episodes_per_s === 0);
      [this.series, this.sampler, this.mastery] = [series, sampler, mastery];
      [this.overview, this.details, this.moves] = [overview, details, [...this.moves, ...newMoves]];
      this.#storeMetrics(metrics, options);
      rememberRun(details);
      this.#axis.start = seconds(details.created_at);
      this.#setAvailable(series, mastery);
      this.loadedAxis = kind;
      this.loads += 1;
      this.error = null;
    } catch (error) {
      if (isCurrent()) this.error = error;
    } finally {
      if (isCurrent()) this.#isLoading = false;
    }
  }

  async #loadCharts(query: object, { sampler }: LoadOptions) {
    const path = { run: this.#run };
    const [series, loadedSampler] = await Promise.all([
      unwrap(client.GET("/v1/runs/{run}/series", { params: { path, query: { ...query, points: POINTS } } })),
      sampler
        ? unwrap(
            client.GET("/v1/runs/{run}/sampler", {
              params: { path, query: { ...query, points: SAMPLER_POINTS } },
            }),
          )
        : this.sampler,
    ]);
    return { series, sampler: loadedSampler };
  }

  /** Loads the metrics in the selected range; a single point of each if the page shows none of them. */
  async #loadMetrics(series: RunSeries, { metrics, task }: LoadOptions): Promise<TrainerMetric[]> {
    const { kind, range } = this.#axis;
    let interval: Interval | undefined;
    if (range.selected && hasTimeRange(kind)) interval = range.selected;
    else if (range.selected) {
      const points = series.tasks.find((row) => row.task === task) ?? series.tasks[0];
      const [from, to] = [points?.at[0], points?.until.at(-1)];
      if (from !== undefined && to !== undefined && to > from) interval = { from, to };
    }
    const query = {
      points: metrics ? METRIC_POINTS : 1,
      ...(metrics && interval ? timeQuery(interval) : {}),
    };
    const params = { path: { run: this.#run }, query };
    return (await unwrap(client.GET("/v1/runs/{run}/metrics", { params }))).metrics;
  }

  #storeMetrics(metrics: TrainerMetric[], options: LoadOptions) {
    if (metrics.length > 0) this.hasMetrics = true;
    if (!options.metrics) return;
    this.metrics = metrics;
    this.#axis.clock = stepClock(metrics);
  }

  /** Loads the level moves after the last known one. */
  async #loadNewMoves(): Promise<RecordedMove[]> {
    const newMoves: RecordedMove[] = [];
    let last = this.moves.at(-1)?.seq;
    for (;;) {
      const query = { limit: 500, ...(last === undefined ? {} : { cursor: `${String(last)}.` }) };
      const page = await unwrap(
        client.GET("/v1/runs/{run}/level_moves", { params: { path: { run: this.#run }, query } }),
      );
      newMoves.push(...page.moves);
      last = page.moves.at(-1)?.seq;
      if (!page.next || last === undefined) return newMoves;
    }
  }

  /** Sets the intervals that can be shown: from the start of the run to what was loaded. */
  #setAvailable(loaded: RunSeries, { tasks }: RunMastery) {
    const axis = this.#axis;
    const counts = tasks.map(
      ({ results, designed_results, claimed_results }) =>
        results.episodes + designed_results.episodes + claimed_results.episodes,
    );
    axis.episodes.available = { from: 0, to: Math.max(1, ...counts) };
    if (!hasTimeRange(axis.kind)) return;
    const { time } = axis;
    const now = Date.now() / 1000;
    const to = isTimeAxis(axis.kind) ? seconds(loaded.to) : now;
    if (!time.selected) time.available = { from: axis.start, to: Math.max(to, axis.start + 1) };
    else if (!this.#isQuiet) time.available = { from: axis.start, to: Math.max(time.available.to, now) };
  }
}

/** Returns the end of the data in seconds since 1970, after a long time without episodes; otherwise undefined. */
function quietEnd(all: RunSeries): number | undefined {
  const times = all.tasks.flatMap((task) =>
    task.until.filter((_, i) => (task.episodes[i] ?? 0) + (task.claimed[i] ?? 0) > 0),
  );
  const available = { from: seconds(all.from), to: seconds(all.to) };
  const last = times.length > 0 ? times.reduce((a, b) => Math.max(a, b)) : undefined;
  const end = endOfData(available, last);
  return end < available.to ? end : undefined;
}
