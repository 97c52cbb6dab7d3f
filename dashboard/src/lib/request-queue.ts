/** Requests for items by their ids: a few at once, each item once at a time, and none that is no longer wanted. */
export class RequestQueue {
  readonly #atOnce: number;
  readonly #request: (id: string) => Promise<unknown>;
  /** Ids that wait, with the number of callers that want them. */
  readonly #waiting = new Map<string, number>();
  readonly #running = new Set<string>();

  constructor(atOnce: number, request: (id: string) => Promise<unknown>) {
    [this.#atOnce, this.#request] = [atOnce, request];
  }

  /** Adds an item unless its request is under way. Returns a function that withdraws it if its request has not begun. */
  add(id: string): () => void {
    if (this.#running.has(id)) return () => undefined;
    this.#waiting.set(id, (this.#waiting.get(id) ?? 0) + 1);
    this.#begin();
    let isWanted = true;
    return () => {
      const wishes = this.#waiting.get(id);
      if (!isWanted || wishes === undefined) return;
      isWanted = false;
      if (wishes > 1) this.#waiting.set(id, wishes - 1);
      else this.#waiting.delete(id);
    };
  }

  /** Begins requests in the order in which their items were added. A failed request is not repeated. */
  #begin() {
    for (const id of this.#waiting.keys()) {
      if (this.#running.size >= this.#atOnce) return;
      this.#waiting.delete(id);
      this.#running.add(id);
      void this.#request(id)
        .catch(() => undefined)
        .finally(() => {
          this.#running.delete(id);
          this.#begin();
        });
    }
  }
}
