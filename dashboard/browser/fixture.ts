/** Browser and server of a test file, and the runs that tests share. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll } from "vitest";
import { launchBrowser, openPage, type ObservedPage, type PageOptions } from "./browser";
import { reportHeldEpisodes, SparringServer } from "./server";

/** Browser and server; both are available in hooks and tests, not while the file is loaded. */
export class Fixture {
  #browser: Browser | undefined;
  #server: SparringServer | undefined;

  get browser(): Browser {
    if (!this.#browser) throw new Error("the browser has not started");
    return this.#browser;
  }

  get server(): SparringServer {
    if (!this.#server) throw new Error("the server has not started");
    return this.#server;
  }

  /** Opens an empty page that may send requests to the server only. */
  openPage(options?: PageOptions): Promise<ObservedPage> {
    return openPage(this.browser, this.server.url, options);
  }

  async start() {
    [this.#browser, this.#server] = [await launchBrowser(), await SparringServer.start()];
  }

  async dispose() {
    await this.#browser?.close();
    await this.#server?.dispose();
  }
}

/** Registers hooks that start a browser and a server before the tests of the file, call `prepare`, and stop both at the end. */
export function useFixture(prepare?: (server: SparringServer) => Promise<void>): Fixture {
  const fixture = new Fixture();
  beforeAll(async () => {
    await fixture.start();
    await prepare?.(fixture.server);
  });
  afterAll(() => fixture.dispose());
  return fixture;
}

/**
 * Creates a run of kessler/survival without designs, and reports `groups` groups whose agents held. Returns the ids of
 * the episodes. `settings` are added to those of the run.
 */
export async function createHeldRun(
  server: SparringServer,
  id: string,
  groups: number,
  settings: object = {},
): Promise<string[]> {
  await server.post("/v1/runs", {
    id,
    seed: 7,
    tasks: ["kessler/survival"],
    strategy: "ladder",
    design: { designer: "off" },
    ...settings,
  });
  return reportHeldEpisodes(server, id, groups);
}
