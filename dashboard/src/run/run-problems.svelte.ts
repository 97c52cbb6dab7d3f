/** Failures of a run and the designs against them, for the summary of each task. */
import { client, unwrap } from "../lib/api";
import type { DesignRequestSummary, DesignStatistics, FailureProfiles } from "../lib/api-types";
import { LatestRequest } from "../lib/latest-request";

/** Number of design requests that the page lists. */
const MAX_REQUESTS = 5;

export class RunProblems {
  profiles = $state.raw<FailureProfiles | null>(null);
  statistics = $state.raw<DesignStatistics | null>(null);
  /** Latest design requests, the newest first. */
  requests = $state.raw<DesignRequestSummary[]>([]);
  error = $state<unknown>(null);

  readonly #run: string;
  readonly #latest = new LatestRequest();

  constructor(run: string) {
    this.#run = run;
  }

  async load() {
    const isCurrent = this.#latest.begin();
    const path = { run: this.#run };
    try {
      const [profiles, statistics, page] = await Promise.all([
        unwrap(client.GET("/v1/runs/{run}/failure_profiles", { params: { path, query: {} } })),
        unwrap(client.GET("/v1/runs/{run}/designs/statistics", { params: { path } })),
        unwrap(
          client.GET("/v1/runs/{run}/designs/requests", {
            params: { path, query: { limit: MAX_REQUESTS } },
          }),
        ),
      ]);
      if (!isCurrent()) return;
      [this.profiles, this.statistics, this.requests] = [profiles, statistics, page.requests];
      this.error = null;
    } catch (error) {
      if (isCurrent()) this.error = error;
    }
  }
}
