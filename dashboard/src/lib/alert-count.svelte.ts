/** Number of alerts that last, for the main menu. */
import { client, unwrap } from "./api";
import { pollEvery } from "./poll";

/** Pause between two requests, ms. */
const INTERVAL = 10_000;

class AlertCount {
  /** Null before the first answer. */
  lasting = $state<number | null>(null);

  /** Asks the server now and at intervals. Returns a function that stops it. */
  watch(): () => void {
    void this.#load();
    return pollEvery(
      INTERVAL,
      () => true,
      () => this.#load(),
    );
  }

  async #load(): Promise<void> {
    try {
      const page = await unwrap(client.GET("/v1/alerts", { params: { query: { lasting: true, limit: 1 } } }));
      this.lasting = page.lasting;
    } catch {
      this.lasting = null; // the pages say why the server does not answer
    }
  }
}

export const alertCount = new AlertCount();
