/** On a phone, and on the way there. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, inject, test } from "vitest";
import { go, launch, open } from "./browser";
import { full, shoot } from "./pages";

let browser: Browser;
const [url, run] = [inject("url"), inject("run")];
beforeAll(async () => {
  browser = await launch();
});
afterAll(async () => {
  await browser.close();
});

test("on a phone nothing is cut off at the side", async () => {
  for (const [name, page] of Object.entries(await full(url, run))) {
    const watched = await open(browser, url, { width: 390, height: 844 });
    await shoot(watched, url, `${name}-phone`, page);
    const over = await watched.page.evaluate(
      () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
    );
    expect(over, name).toBeLessThanOrEqual(0);
    await watched.page.context().close();
  }
});

test("the first load is small, and nothing is asked of any other address", async () => {
  const { page, wrong } = await open(browser, url);
  let bytes = 0;
  page.on("response", (response) => {
    if (response.url().includes("/dashboard/"))
      void response
        .request()
        .sizes()
        .then((sizes) => (bytes += sizes.responseBodySize));
  });
  await go(page, url, `/runs/${run}`); // the heaviest page: with charts
  await page.waitForTimeout(500);
  expect(bytes).toBeGreaterThan(20_000);
  expect(bytes).toBeLessThanOrEqual(150 * 1024);
  expect(wrong).toEqual([]);
  const tagged = await fetch(`${url}/dashboard/`);
  const again = await fetch(`${url}/dashboard/`, {
    headers: { "if-none-match": tagged.headers.get("etag") ?? "" },
  });
  expect(again.status).toBe(304);
  await page.context().close();
});
