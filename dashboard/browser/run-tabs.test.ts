/** Checks the page of a run: the state of all tasks is visible at once, and its tabs follow the ARIA pattern. */
import type { Page } from "playwright-core";
import { afterAll, beforeAll, expect, inject, test } from "vitest";
import type { Browser } from "playwright-core";
import { launchBrowser, openPage, visit, waitUntilIdle, type ObservedPage } from "./browser";

let browser: Browser;
const [url, run] = [inject("url"), inject("run")];
beforeAll(async () => {
  browser = await launchBrowser();
});
afterAll(async () => {
  await browser.close();
});

async function openRun(query = ""): Promise<ObservedPage> {
  const observed = await openPage(browser, url, { width: 1440, height: 900 });
  await visit(observed.page, url, `/runs/${run}${query}`);
  await waitUntilIdle(observed);
  return observed;
}

const hash = (page: Page) => new URL(page.url()).hash;
const selectedTab = (page: Page) => page.getByRole("tab", { selected: true }).textContent();

test("level, skill, trend, promotion and missing outcomes of each task are visible without scrolling", async () => {
  const { page, problems } = await openRun();
  const table = page.getByRole("table").first();
  expect(await table.getByRole("columnheader").allInnerTexts()).toEqual([
    "Task",
    "Level",
    "Skill, all episodes",
    "Skill, last quarter",
    "Mastery",
    "Training episodes",
    "Success rate",
    "Missing outcomes",
  ]);
  const notes = await table.locator(".state").allTextContents();
  expect(notes).toHaveLength(4);
  for (const note of notes)
    expect(note).toMatch(/Is it learning\? (Yes:|No:|Not now:|It has little left|Too few|Placement)/);
  for (const note of notes) expect(note).toMatch(/Next level:.*blocks? of 32|hardest level/s);
  expect(await table.locator(".task .trend svg").count()).toBe(4);
  const box = await page.getByRole("tablist").boundingBox();
  expect((box?.y ?? Infinity) + (box?.height ?? 0)).toBeLessThanOrEqual(900);
  const height = await page.evaluate(() => document.documentElement.scrollHeight);
  expect(height).toBeLessThan(3000);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("arrow keys, Home and End select tabs, and the address holds the tab", async () => {
  const { page, problems } = await openRun();
  await page.getByRole("tab", { name: "Learning" }).focus();
  expect(await page.locator("[role=tab][tabindex='0']").count()).toBe(1);
  for (const [key, name, query] of [
    ["ArrowRight", "Parameters", "?tab=parameters"],
    ["End", "Settings", "?tab=settings"],
    ["ArrowRight", "Learning", ""],
    ["ArrowLeft", "Settings", "?tab=settings"],
    ["Home", "Learning", ""],
  ] as const) {
    await page.keyboard.press(key);
    expect(await selectedTab(page)).toBe(name);
    expect(await page.evaluate(() => document.activeElement?.textContent)).toBe(name);
    await expect.poll(() => hash(page)).toBe(`#/runs/${run}${query}`);
  }
  await page.keyboard.press("Tab");
  expect(await page.evaluate(() => document.activeElement?.getAttribute("role"))).toBe("tabpanel");
  await page.getByRole("tab", { name: "Activity" }).click();
  await page.getByRole("tabpanel", { name: "Activity" }).getByText("Level moves").first().waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("an address opens its tab and its task, and a click on a task changes both", async () => {
  const observed = await openRun("?tab=parameters&task=kessler/rendezvous");
  const { page, problems } = observed;
  expect(await selectedTab(page)).toBe("Parameters");
  expect(await page.getByRole("heading", { name: /^Params of/ }).allTextContents()).toEqual([
    "Params of rendezvous",
  ]);
  await page.getByRole("button", { name: "kessler/formation" }).click();
  await page.getByRole("heading", { name: "Params of formation" }).waitFor();
  expect(hash(page)).toBe(`#/runs/${run}?tab=parameters&task=kessler/formation`);
  await page.getByRole("combobox", { name: "task" }).selectOption("all tasks");
  await expect.poll(() => page.getByRole("heading", { name: /^Params of/ }).count()).toBe(4);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the back button leads through the tabs to the page before", async () => {
  const observed = await openPage(browser, url, { width: 1440, height: 900 });
  const { page, problems } = observed;
  await visit(page, url, "/");
  await visit(page, url, `/runs/${run}`);
  await page.getByRole("tab", { name: "Parameters" }).click();
  await page.getByRole("tab", { name: "Activity" }).click();
  await page.goBack();
  await expect.poll(() => selectedTab(page)).toBe("Parameters");
  expect(hash(page)).toBe(`#/runs/${run}?tab=parameters`);
  await page.goForward();
  await expect.poll(() => selectedTab(page)).toBe("Activity");
  for (const tab of ["Parameters", "Learning"]) {
    await page.goBack();
    await expect.poll(() => selectedTab(page)).toBe(tab);
  }
  await page.goBack();
  await page.getByRole("heading", { name: "Runs" }).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the trained run is paused, and its trainer is not active", async () => {
  const { page, problems } = await openRun("?tab=trainer");
  await page.getByText(/^paused after .* with results$/).waitFor();
  const trainers = page.getByRole("region", { name: "Trainers" });
  const list = await fetch(`${url}/v1/runs/${run}/trainers`);
  const { trainers: all, window_s } = (await list.json()) as {
    trainers: { idle_s: number }[];
    window_s: number;
  };
  // The learner has ended, but the window of the rates may have some of its requests.
  if (all.every(({ idle_s }) => idle_s > window_s + 10))
    await trainers.getByText(/^No trainer has been active in the last \d+ (min|s)/).waitFor();
  expect(await trainers.getByText(/(^|[^0-9.])0 % of the time/).count()).toBe(0);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("level moves are above the events, and a filter keeps events of one kind", async () => {
  const { page, problems } = await openRun("?tab=activity");
  const moves = page.getByRole("region", { name: "Level moves" }).getByRole("listitem");
  expect(await moves.count()).toBeGreaterThan(0);
  expect(await moves.first().textContent()).toMatch(/(up|down|placement)/);
  const kinds = () =>
    page
      .locator(".events li")
      .evaluateAll((items) => [...new Set(items.map((item) => (item as HTMLElement).dataset["kind"]))]);
  const filter = page.getByRole("combobox", { name: "show" });
  await filter.selectOption("level moves");
  await expect.poll(kinds).toEqual(["move"]);
  await filter.selectOption("leases");
  await expect.poll(kinds).toEqual(["lease"]);
  expect(hash(page)).toBe(`#/runs/${run}?tab=activity&events=leases`);
  await page.reload();
  await expect.poll(kinds).toEqual(["lease"]);
  await page.goBack();
  await expect.poll(() => filter.inputValue()).toBe("moves");
  await expect.poll(kinds).toEqual(["move"]);
  expect(problems).toEqual([]);
  await page.context().close();
});
