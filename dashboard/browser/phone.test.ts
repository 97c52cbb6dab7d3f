/** Checks the layout of all pages on a phone, and the size of the first load. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, inject, test } from "vitest";
import { launchBrowser, openPage, visit, waitUntilIdle } from "./browser";
import { checkPage, pagesOfTrainedRun } from "./page-checks";

let browser: Browser;
const [url, run] = [inject("url"), inject("run")];
beforeAll(async () => {
  browser = await launchBrowser();
});
afterAll(async () => {
  await browser.close();
});

test("pages are not wider than a phone", async () => {
  for (const [name, page] of Object.entries(await pagesOfTrainedRun(url, run))) {
    const observed = await openPage(browser, url, { width: 390, height: 844 });
    await checkPage(observed, url, `${name}-phone`, page);
    const overflow = await observed.page.evaluate(
      () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
    );
    expect(overflow, name).toBeLessThanOrEqual(0);
    await observed.page.context().close();
  }
});

test("tables are cards and interval charts fill the width of a phone", async () => {
  const observed = await openPage(browser, url, { width: 390, height: 844 });
  const { page, problems } = observed;
  await visit(page, url, `/runs/${run}/episodes`);
  await waitUntilIdle(observed);
  const row = page.locator(".wide tbody tr").first();
  expect(await row.evaluate((node) => getComputedStyle(node).display)).toBe("grid");
  expect(await row.getByRole("cell").count()).toBeGreaterThan(5);
  const labels = await row
    .locator("[data-label]")
    .evaluateAll((cells) => cells.map((cell) => (cell as HTMLElement).dataset["label"]));
  expect(labels.slice(0, 4)).toEqual(["Episode", "Task", "Level", "Role"]);

  await visit(page, url, "/evaluations/eval-1");
  await waitUntilIdle(observed);
  const widths = await page
    .locator("figure .chart > svg")
    .evaluateAll((charts) => charts.map((chart) => chart.getBoundingClientRect().width));
  expect(widths.length).toBeGreaterThan(0);
  for (const width of widths) expect(width).toBeGreaterThan(300);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the first load is small and uses one address only", async () => {
  const observed = await openPage(browser, url);
  const { page, problems } = observed;
  const sizes: Promise<number>[] = [];
  page.on("requestfinished", (request) => {
    if (request.url().includes("/dashboard/"))
      sizes.push(request.sizes().then(({ responseBodySize }) => responseBodySize));
  });
  await visit(page, url, `/runs/${run}`); // the heaviest page: it has charts
  await waitUntilIdle(observed);
  const bytes = (await Promise.all(sizes)).reduce((sum, size) => sum + size, 0);
  expect(bytes).toBeGreaterThan(20_000);
  expect(bytes).toBeLessThanOrEqual(150 * 1024);
  expect(problems).toEqual([]);
  const tagged = await fetch(`${url}/dashboard/`);
  const revalidated = await fetch(`${url}/dashboard/`, {
    headers: { "if-none-match": tagged.headers.get("etag") ?? "" },
  });
  expect(revalidated.status).toBe(304);
  await page.context().close();
});
