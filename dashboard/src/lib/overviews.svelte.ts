/** Overviews of the runs that a list shows. A list may have thousands of runs, of which few are visible. */
import { SvelteMap } from "svelte/reactivity";
import { client, unwrap } from "./api";
import type { RunOverview } from "./api-types";

/** Time that a run must be visible before its overview is loaded, so that scrolling loads nothing, in milliseconds. */
const DELAY_MS = 150;

const overviews = new SvelteMap<string, RunOverview>();
/** Time of the latest results that a loaded overview covers, by run. */
const covered: Record<string, string> = {};

/** Returns the overview of a run if it is loaded. */
export function loadedOverview(run: string): RunOverview | undefined {
  return overviews.get(run);
}

/** Loads the overview of a run that is visible, unless it covers the latest results. Returns a function that cancels the request. */
export function requestOverview(run: string, lastResultsAt: string | null | undefined): () => void {
  if (!lastResultsAt || covered[run] === lastResultsAt) return () => undefined;
  const timer = setTimeout(() => {
    covered[run] = lastResultsAt;
    unwrap(client.GET("/v1/runs/{run}/overview", { params: { path: { run } } })).then(
      (overview) => overviews.set(run, overview),
      () => (covered[run] = ""), // the list reports that the server does not respond
    );
  }, DELAY_MS);
  return () => {
    clearTimeout(timer);
  };
}
