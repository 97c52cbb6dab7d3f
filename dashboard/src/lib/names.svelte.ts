/** Names of runs: every page of a run shows its own, and few of them ask for the run itself. */
import { SvelteMap } from "svelte/reactivity";
import { body, client } from "./api";

const names = new SvelteMap<string, string>();

/** A run's name, where it is known by now. */
export function nameOf(run: string): string | undefined {
  return names.get(run);
}

/** Asks for it: a run that is not there has no name, which its page tells anyhow. */
export async function learn(run: string) {
  try {
    const found = await body(client.GET("/v1/runs/{run}", { params: { path: { run } } }));
    names.set(run, found.name);
  } catch {
    names.delete(run);
  }
}
