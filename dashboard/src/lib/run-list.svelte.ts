/** Runs of the server that match filters, in an order, loaded page by page while the user scrolls. */
import { client, unwrap } from "./api";
import type { MissingShard, RunSummary } from "./api-types";
import { LatestRequest } from "./latest-request";
import type { RunFilters, Sort } from "./run-query";

/** Number of runs that one request loads. */
const PAGE = 100;
/** Largest number of runs of a request. */
const MAX_PAGE = 500;

export interface RunListQuery {
  filters: RunFilters;
  sort: Sort;
  descending: boolean;
}

export class RunList {
  runs = $state.raw<RunSummary[]>([]);
  /** Number of all runs that match; null before the first page is loaded. */
  total = $state<number | null>(null);
  /** Shards whose runs the list lacks, by the latest request. */
  missing = $state.raw<MissingShard[]>([]);
  /** Error of the latest request; null if it succeeded. */
  error = $state<unknown>(null);
  readonly query: RunListQuery;
  readonly #latest = new LatestRequest();
  #next: string | null = null;
  #isLoadingMore = false;

  constructor(query: RunListQuery) {
    this.query = query;
  }

  /** Loads as many runs as there are now again, at least one page. */
  async reload() {
    const isCurrent = this.#latest.begin();
    const wanted = Math.max(PAGE, this.runs.length);
    try {
      const runs: RunSummary[] = [];
      let next: string | null = null;
      let total: number | null = null;
      let missing: MissingShard[];
      do {
        const page = await this.#fetch(next, Math.min(MAX_PAGE, wanted - runs.length));
        runs.push(...page.runs);
        total ??= page.total ?? null;
        next = page.next ?? null;
        missing = page.missing_shards;
        if (!isCurrent()) return;
      } while (next !== null && runs.length < wanted);
      this.missing = missing;
      [this.runs, this.total, this.#next, this.error] = [runs, total, next, null];
    } catch (error) {
      if (isCurrent()) this.error = error;
    }
  }

  /** Loads the next page if there is one, and no request for it. */
  async loadMore() {
    if (this.#next === null || this.#isLoadingMore) return;
    this.#isLoadingMore = true;
    const isCurrent = this.#latest.begin();
    try {
      const page = await this.#fetch(this.#next, PAGE);
      if (!isCurrent()) return;
      // A run whose value changed meanwhile may be on two pages.
      const known = this.runs.map((run) => run.id);
      this.runs = [...this.runs, ...page.runs.filter((run) => !known.includes(run.id))];
      this.#next = page.next ?? null;
      this.missing = page.missing_shards;
      this.error = null;
    } catch (error) {
      if (isCurrent()) this.error = error;
    } finally {
      this.#isLoadingMore = false;
    }
  }

  /**
   * Loads all runs that match and returns them; the list keeps its own. `progress` gets the number that is loaded so far, and returns
   * false to end the loading.
   */
  async fetchAll(progress: (loaded: number) => boolean): Promise<RunSummary[]> {
    const runs: RunSummary[] = [];
    let next: string | null = null;
    do {
      const page = await this.#fetch(next, MAX_PAGE);
      runs.push(...page.runs);
      next = page.next ?? null;
    } while (progress(runs.length) && next !== null);
    return runs;
  }

  /** True if further pages exist. */
  get hasMore(): boolean {
    return this.total !== null && this.runs.length < this.total && this.#next !== null;
  }

  #fetch(cursor: string | null, limit: number) {
    const { filters, sort, descending } = this.query;
    const query = {
      ...filters,
      sort,
      order: descending ? ("desc" as const) : ("asc" as const),
      limit,
      ...(cursor === null ? {} : { cursor }),
    };
    return unwrap(client.GET("/v1/runs", { params: { query } }));
  }
}
