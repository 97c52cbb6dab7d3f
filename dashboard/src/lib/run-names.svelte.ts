/** Cache of run names. Each page of a run shows its name, but few pages load the run itself. */
import { SvelteMap } from "svelte/reactivity";
import { client, unwrap } from "./api";

const names = new SvelteMap<string, string>();

/** Returns the name of a run if it is loaded. */
export function runName(run: string): string | undefined {
  return names.get(run);
}

/** Loads the name of a run. An unknown run gets no name; its page reports the error. */
export async function loadRunName(run: string) {
  try {
    const details = await unwrap(client.GET("/v1/runs/{run}", { params: { path: { run } } }));
    names.set(run, details.name);
  } catch {
    names.delete(run);
  }
}
