/** Runs of a comparison with their curves, loaded from the server. */
import { SvelteMap } from "svelte/reactivity";
import { client, unwrap } from "../lib/api";
import type { RunSampler, RunSeries, RunSummary } from "../lib/api-types";
import { LatestRequest } from "../lib/latest-request";

/** Run with its curves. */
export interface ComparedRun {
  run: RunSummary;
  series: RunSeries;
  sampler: RunSampler;
}

/** Number of points of a curve, and of the course of a sampler. */
const POINTS = { series: 300, sampler: 100 };
/** Number of runs that are loaded at the same time. */
const PARALLEL = 4;

export class ComparedRuns {
  /** Loaded runs by id. */
  readonly loaded = new SvelteMap<string, ComparedRun>();
  /** Errors of the runs that cannot be loaded, by id. */
  readonly errors = new SvelteMap<string, unknown>();
  readonly #latest = new LatestRequest();

  /** Loads the runs that are not loaded yet, or all of them again. */
  async load(ids: string[], again = false) {
    const isCurrent = this.#latest.begin();
    const waiting = ids.filter((id) => again || !this.loaded.has(id));
    const loadNext = async () => {
      for (let id = waiting.shift(); id !== undefined && isCurrent(); id = waiting.shift()) {
        await this.#loadOne(id);
      }
    };
    await Promise.all(Array.from({ length: PARALLEL }, loadNext));
  }

  async #loadOne(id: string) {
    const path = { path: { run: id } };
    try {
      // First the run: an unknown one has a single error.
      const run = await unwrap(client.GET("/v1/runs/{run}", { params: path }));
      const [series, sampler] = await Promise.all([
        unwrap(
          client.GET("/v1/runs/{run}/series", {
            params: { ...path, query: { by: "episodes", points: POINTS.series } },
          }),
        ),
        unwrap(
          client.GET("/v1/runs/{run}/sampler", {
            params: { ...path, query: { by: "episodes", points: POINTS.sampler } },
          }),
        ),
      ]);
      this.loaded.set(id, { run, series, sampler });
      this.errors.delete(id);
    } catch (error) {
      this.errors.set(id, error);
    }
  }
}
