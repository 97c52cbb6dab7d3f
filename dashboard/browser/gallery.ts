/** Builds the gallery and serves it, for the tests of components. */
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import type { Browser } from "playwright-core";
import { build, preview, type PreviewServer } from "vite";
import { afterAll, beforeAll } from "vitest";
import { launchBrowser, openPage, waitUntilIdle, type ObservedPage, type PageOptions } from "./browser";

const CONFIG = fileURLToPath(new URL("../gallery/vite.config.ts", import.meta.url));

/** Ids of the sections of the gallery. */
export const SECTIONS = [
  "charts",
  "distributions",
  "parts",
  "dialogs",
  "table",
  "tasks",
  "run",
  "replay",
  "compare",
  "workers",
] as const;
export type Section = (typeof SECTIONS)[number];

export class GalleryServer {
  private constructor(
    private readonly browser: Browser,
    private readonly server: PreviewServer,
    private readonly folder: string,
    readonly url: string,
  ) {}

  /** Builds the gallery into a temporary folder, serves it at a free port, and starts a browser. */
  static async start(): Promise<GalleryServer> {
    const folder = await mkdtemp(join(tmpdir(), "sparring-gallery-"));
    await build({ configFile: CONFIG, logLevel: "warn", build: { outDir: folder } });
    const server = await preview({
      configFile: CONFIG,
      logLevel: "warn",
      build: { outDir: folder },
      preview: { host: "127.0.0.1", port: 0, strictPort: false },
    });
    const address = server.httpServer.address();
    if (typeof address !== "object" || address === null) throw new Error("the gallery has no port");
    return new GalleryServer(
      await launchBrowser(),
      server,
      folder,
      `http://127.0.0.1:${String(address.port)}`,
    );
  }

  /** Opens a section and waits until its charts are drawn. */
  async open(section: Section, options: PageOptions): Promise<ObservedPage> {
    const observed = await openPage(this.browser, this.url, options);
    const { page } = observed;
    // The step is that of the replay.
    await page.goto(`${this.url}/?section=${section}&theme=${options.dark ? "dark" : "light"}#/?step=28`);
    await page.locator("[data-case]").first().waitFor();
    await page.evaluate(() => document.fonts.ready);
    await waitUntilIdle(observed);
    return observed;
  }

  async dispose() {
    await this.browser.close();
    await this.server.close();
    await rm(this.folder, { recursive: true, force: true });
  }
}

/** Registers hooks that start the gallery before the tests of the file and stop it at the end; returns the gallery in hooks and tests. */
export function useGallery(): () => GalleryServer {
  let gallery: GalleryServer | undefined;
  beforeAll(async () => {
    gallery = await GalleryServer.start();
  });
  afterAll(() => gallery?.dispose());
  return () => {
    if (!gallery) throw new Error("the gallery has not started");
    return gallery;
  };
}
