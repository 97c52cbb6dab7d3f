/** Runs that the user selected in the table of runs, also those that match its filters but are not loaded. */
import { SvelteMap } from "svelte/reactivity";
import type { RunSummary } from "./api-types";
import { LatestRequest } from "./latest-request";

/** List whose runs can be loaded completely. */
export interface CompleteList {
  /** Loads all runs. `progress` gets the number that is loaded so far, and returns false to end the loading. */
  fetchAll: (progress: (loaded: number) => boolean) => Promise<RunSummary[]>;
}

export class RunSelection {
  /** Number of runs that are loaded so far, while all of them are being loaded; null otherwise. */
  loaded = $state<number | null>(null);
  /** Key of the view all of whose runs were selected; empty for none. */
  completed = $state("");
  readonly #runs = new SvelteMap<string, RunSummary>();
  /** Ids of selected runs that are being loaded. */
  #restored = $state.raw<readonly string[]>([]);
  readonly #latest = new LatestRequest();
  readonly #latestRestore = new LatestRequest();

  get runs(): RunSummary[] {
    return [...this.#runs.values()];
  }

  /** Ids of the selected runs, also of those that are being loaded. */
  get ids(): string[] {
    return [...this.#runs.keys(), ...this.#restored.filter((id) => !this.#runs.has(id))];
  }

  get size(): number {
    return this.#runs.size;
  }

  has(run: string): boolean {
    return this.#runs.has(run);
  }

  add(runs: readonly RunSummary[]) {
    for (const run of runs) this.#runs.set(run.id, run);
  }

  remove(run: string) {
    this.#runs.delete(run);
  }

  toggle(run: RunSummary) {
    if (!this.#runs.delete(run.id)) this.#runs.set(run.id, run);
    this.completed = "";
  }

  /** Replaces the selected ones of these runs by their newer state. */
  update(runs: readonly RunSummary[]) {
    this.add(runs.filter(({ id }) => this.#runs.has(id)));
  }

  clear() {
    this.cancel();
    this.#latestRestore.begin();
    this.#restored = [];
    this.#runs.clear();
    this.completed = "";
  }

  /** Replaces the selection by the runs with these ids, which `load` reads. Runs that do not exist any more are left out. */
  async restore(ids: readonly string[], load: (id: string) => Promise<RunSummary>) {
    this.clear();
    if (ids.length === 0) return;
    const isCurrent = this.#latestRestore.begin();
    this.#restored = ids;
    const loaded = await Promise.allSettled(ids.map(load));
    if (!isCurrent()) return;
    this.add(loaded.flatMap((result) => (result.status === "fulfilled" ? [result.value] : [])));
    this.#restored = [];
  }

  /** Ends a loading of all runs; none of its runs is selected. */
  cancel() {
    this.#latest.begin();
    this.loaded = null;
  }

  /** Selects all runs of the lists, loaded or not. `key` names the view that they belong to. */
  async selectAll(lists: readonly CompleteList[], key: string) {
    const isCurrent = this.#latest.begin();
    this.loaded = 0;
    const found: RunSummary[] = [];
    try {
      for (const list of lists) {
        const before = found.length;
        const runs = await list.fetchAll((loaded) => {
          if (isCurrent()) this.loaded = before + loaded;
          return isCurrent();
        });
        if (!isCurrent()) return;
        found.push(...runs);
      }
      this.add(found);
      this.completed = key;
    } finally {
      if (isCurrent()) this.loaded = null;
    }
  }
}
