/** Cache of the runs whose pages were opened. Each page of a run shows its name, but few pages load the run itself. */
import { SvelteMap } from "svelte/reactivity";
import { client, unwrap } from "./api";
import type { RunSummary } from "./api-types";

interface KnownRun {
  name: string;
  /** Ids of its tasks. */
  tasks: string[];
}

const runs = new SvelteMap<string, KnownRun>();

/** Returns a run if it is loaded. */
export function knownRun(run: string): KnownRun | undefined {
  return runs.get(run);
}

/** Returns the ids of the tasks of a run, in the order of its settings. */
export function tasksOf({ settings }: Pick<RunSummary, "settings">): string[] {
  const { curriculum } = settings as { curriculum?: { tasks?: { task: string }[] } };
  return (curriculum?.tasks ?? []).map(({ task }) => task);
}

/** Stores name and tasks of a run that was loaded. */
export function rememberRun(run: Pick<RunSummary, "id" | "name" | "settings">) {
  runs.set(run.id, { name: run.name, tasks: tasksOf(run) });
}

/** Loads a run; throws the error of the request. */
export async function loadKnownRun(run: string) {
  rememberRun(await unwrap(client.GET("/v1/runs/{run}", { params: { path: { run } } })));
}
