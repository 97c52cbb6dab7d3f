/** What happens is shown as it happens; a service that goes away is said to be away, and caught up with when it is back. */
import { readFile } from "node:fs/promises";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { go, launch, open } from "./browser";
import { hold, Sparring } from "./sparring";

let browser: Browser;
let service: Sparring;
beforeAll(async () => {
  [browser, service] = [await launch(), await Sparring.start()];
  await service.post("/v1/runs", {
    id: "run",
    seed: 7,
    tasks: ["kessler/survival"],
    design: { designer: "off" },
  });
  await hold(service, "run", 16);
});
afterAll(async () => {
  await browser.close();
  await service.end();
});

test("events come by themselves, through a restart of the server", async () => {
  const { page } = await open(browser, service.url);
  await go(page, service.url, "/runs/run");
  const status = page.getByRole("status");
  await page.getByText("live", { exact: true }).waitFor();
  await hold(service, "run", 8);
  await page.locator(".events li").filter({ hasText: "succeeded" }).first().waitFor();
  const before = await page.locator(".events li").count();
  expect(before).toBeGreaterThanOrEqual(8);
  const episodes = page
    .locator("dl div")
    .filter({ hasText: /^Episodes\s*\d/ })
    .locator("dd");
  await expect.poll(() => episodes.textContent(), { timeout: 15_000 }).toBe("24");

  await service.kill();
  await expect.poll(() => status.textContent(), { timeout: 30_000 }).toContain("not live");
  await service.again();
  await page.getByText("live", { exact: true }).waitFor({ timeout: 60_000 });
  await hold(service, "run", 8);
  await expect.poll(() => episodes.textContent(), { timeout: 20_000 }).toBe("32");
  // Each event once: those from before the restart did not come again.
  const ids = await page
    .locator(".events li")
    .evaluateAll((lines) => lines.map((line) => (line as HTMLElement).dataset["event"]));
  expect(new Set(ids).size).toBe(ids.length);
  expect(ids.length).toBeGreaterThan(before + 8);
  await page.context().close();
});

test("charts share one stretch of time, and give their values", async () => {
  const { page, wrong } = await open(browser, service.url);
  await go(page, service.url, "/runs/run");
  await page.getByRole("heading", { name: "Mastery of survival" }).waitFor();
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: "CSV of Mastery of survival" }).click(),
  ]);
  const text = await readFile(await download.path(), "utf8");
  const [head, first] = text.split("\n");
  expect(head).toBe('time,"mastery","mastery, low","mastery, high","contested","all episodes","blind panel"');
  expect(first).toMatch(/^\d{4}-\d\d-\d\dT/);
  const series = await service.get<{ tasks: { success: number[] }[] }>("/v1/runs/run/series?points=600");
  expect(Number(first?.split(",")[5])).toBeCloseTo(series.tasks[0]?.success[0] ?? NaN, 9);
  expect(wrong).toEqual([]);
  await page.context().close();
});
