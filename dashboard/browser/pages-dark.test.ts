/** Every page, dark: it loads, nothing goes wrong in it, and everybody can use it. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, inject, test } from "vitest";
import { launch } from "./browser";
import { EMPTY, emptied, full, look } from "./pages";
import { Sparring } from "./sparring";

let browser: Browser;
let empty: Sparring;
const [url, run] = [inject("url"), inject("run")];
beforeAll(async () => {
  [browser, empty] = [await launch(), await emptied(await Sparring.start())];
});
afterAll(async () => {
  await browser.close();
  await empty.end();
});

test("every page of a full database", async () => {
  await look(browser, url, await full(url, run), true);
});

test("every page of an empty one", async () => {
  await look(browser, empty.url, EMPTY, true, "empty-");
});
