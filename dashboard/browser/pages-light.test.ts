/** Checks every page in the light colour scheme: it loads, has no errors, and is accessible. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, inject, test } from "vitest";
import { launchBrowser } from "./browser";
import { checkPages, createEmptyRun, PAGES_OF_EMPTY_RUN, pagesOfTrainedRun } from "./page-checks";
import { SparringServer } from "./server";

let browser: Browser;
let emptyServer: SparringServer;
const [url, run] = [inject("url"), inject("run")];
beforeAll(async () => {
  [browser, emptyServer] = [await launchBrowser(), await createEmptyRun(await SparringServer.start())];
});
afterAll(async () => {
  await browser.close();
  await emptyServer.dispose();
});

test("every page of a trained run passes the checks", async () => {
  await checkPages(browser, url, await pagesOfTrainedRun(url, run), false);
});

test("every page of an empty run passes the checks", async () => {
  await checkPages(browser, emptyServer.url, PAGES_OF_EMPTY_RUN, false, "empty-");
});
