/** A response that a page requests when it opens and then again and again. */
import { onMount } from "svelte";
import { pollEvery } from "./poll";

export interface Polled<T> {
  /** Newest response; null until there is one. */
  readonly value: T | null;
  /** Error of the last request; null if it succeeded. */
  readonly error: unknown;
}

/** Requests `get` when the component opens, and every `ms` milliseconds while the page is visible. Call it while a component starts. */
export function polled<T>(get: () => Promise<T>, ms: number): Polled<T> {
  let value = $state.raw<T | null>(null);
  let error = $state.raw<unknown>(null);

  async function load() {
    try {
      value = await get();
      error = null;
    } catch (problem) {
      error = problem;
    }
  }

  onMount(() => {
    void load();
    return pollEvery(ms, () => true, load);
  });
  return {
    get value() {
      return value;
    },
    get error() {
      return error;
    },
  };
}
