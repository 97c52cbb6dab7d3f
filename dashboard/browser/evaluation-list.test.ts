/** Checks the list of many evaluations: results load for visible rows only, a few at once, and once. */
import type { Browser, Page, Route } from "playwright-core";
import { afterAll, beforeAll, expect, inject, test } from "vitest";
import { launchBrowser, openPage, visit, waitUntilIdle } from "./browser";

const MANY = 100;
/** Time that each result takes, so that requests overlap. */
const DELAY_MS = 30;
/** Number of requests for results that may be under way at once. */
const AT_ONCE = 4;

let browser: Browser;
const url = inject("url");
beforeAll(async () => {
  browser = await launchBrowser();
});
afterAll(async () => {
  await browser.close();
});

/** Answers as if the server had a hundred evaluations: its own first one under other ids. Returns the ids that the page requested. */
async function multiplyEvaluations(page: Page): Promise<{ requested: string[]; most: () => number }> {
  const original = (await (await fetch(`${url}/v1/evaluations/eval-1`)).json()) as Record<string, unknown>;
  const copy = (number: number) => ({
    ...original,
    id: `eval-${String(number)}`,
    name: `copy ${String(number)}`,
  });
  const requested: string[] = [];
  let [underWay, most] = [0, 0];
  await page.route("**/v1/evaluations?*", (route: Route) =>
    route.fulfill({
      json: {
        evaluations: Array.from({ length: MANY }, (_, i) => copy(1000 + MANY - i)),
        next: null,
        missing_shards: [],
      },
    }),
  );
  await page.route(/\/v1\/evaluations\/eval-\d+$/, async (route: Route) => {
    const id = route.request().url().split("/").at(-1) ?? "";
    requested.push(id);
    underWay += 1;
    most = Math.max(most, underWay);
    await new Promise((resolve) => setTimeout(resolve, DELAY_MS));
    underWay -= 1;
    await route.fulfill({ json: copy(Number(id.slice("eval-".length))) });
  });
  return { requested, most: () => most };
}

test("results load for the visible rows only, four at once, and once", async () => {
  const observed = await openPage(browser, url, { width: 1440, height: 900 });
  const { page, problems } = observed;
  const { requested, most } = await multiplyEvaluations(page);
  await visit(page, url, "/evaluations");
  const success = (name: string) => page.getByRole("row", { name }).getByRole("cell").nth(6).textContent();
  await expect.poll(() => success(`copy ${String(1000 + MANY)} `)).toMatch(/%/);
  await waitUntilIdle(observed);
  expect(requested.length).toBeLessThan(MANY / 2);
  expect(requested).not.toContain("eval-1001");
  expect(await success("copy 1001 ")).toBe("–");
  await page.getByRole("row", { name: "copy 1001 " }).scrollIntoViewIfNeeded();
  await expect.poll(() => success("copy 1001 ")).toMatch(/%/);
  await page.getByRole("row", { name: `copy ${String(1000 + MANY)} ` }).scrollIntoViewIfNeeded();
  await waitUntilIdle(observed);
  expect(most()).toBeLessThanOrEqual(AT_ONCE);
  expect(new Set(requested).size).toBe(requested.length);
  expect(problems).toEqual([]);
  await page.context().close();
});
