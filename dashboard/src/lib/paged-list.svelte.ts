/** List of the API that is loaded page by page. */
import { LatestRequest } from "./latest-request";

export interface Page<T> {
  items: T[];
  /** Cursor of the next page; null or undefined on the last page. */
  next?: string | null | undefined;
}

/** Part of a query that selects the page; empty for the first page. */
export interface PageQuery {
  cursor?: string;
}

export class PagedList<T> {
  items = $state<T[]>([]);
  /** Cursor of the next page; null if all pages are loaded. */
  next = $state<string | null>(null);
  /** True once a page has been loaded. */
  isLoaded = $state(false);
  /** Error of the latest request; null if it succeeded. */
  error = $state<unknown>(null);

  readonly #fetchPage: (query: PageQuery) => Promise<Page<T>>;
  readonly #latest = new LatestRequest();
  // Not reactive, so that effects that refresh the list do not run again after each page.
  #pageCount = 0;
  #isLoadingMore = false;

  constructor(fetchPage: (query: PageQuery) => Promise<Page<T>>) {
    this.#fetchPage = fetchPage;
  }

  /** Loads the first page and drops all others. */
  async reload() {
    await this.#load({}, (items) => {
      this.items = items;
      this.#pageCount = 1;
    });
  }

  /** Reloads the first page; does nothing if the user has requested further pages, because they would disappear. */
  async refresh() {
    if (this.#pageCount <= 1 && !this.#isLoadingMore) await this.reload();
  }

  /** Appends the next page; does nothing if all pages are loaded. */
  async loadMore() {
    if (this.next === null) return;
    this.#isLoadingMore = true;
    await this.#load({ cursor: this.next }, (items) => {
      this.items = [...this.items, ...items];
      this.#pageCount += 1;
    });
    this.#isLoadingMore = false;
  }

  async #load(query: PageQuery, store: (items: T[]) => void) {
    const isCurrent = this.#latest.begin();
    try {
      const page = await this.#fetchPage(query);
      if (!isCurrent()) return;
      store(page.items);
      this.next = page.next ?? null;
      this.isLoaded = true;
      this.error = null;
    } catch (error) {
      if (isCurrent()) this.error = error;
    }
  }
}
