/** Checks that addresses hold selections and filters of pages, and that an unknown run has one clear message. */
import type { Page } from "playwright-core";
import { afterAll, beforeAll, expect, inject, test } from "vitest";
import type { Browser } from "playwright-core";
import { launchBrowser, openPage, visit, waitUntilIdle } from "./browser";
import { checkAccessibility } from "./page-checks";

let browser: Browser;
const [url, run] = [inject("url"), inject("run")];
beforeAll(async () => {
  browser = await launchBrowser();
});
afterAll(async () => {
  await browser.close();
});

const hash = (page: Page) => new URL(page.url()).hash;

test("an unknown run has one message with a link to the runs, on each of its pages", async () => {
  const observed = await openPage(browser, url);
  const { page, problems } = observed;
  for (const part of ["", "/failures", "/episodes", "/designs", "/episodes/ep_1-a_0", "/designs/d_1"]) {
    problems.splice(0);
    const requests: string[] = [];
    page.on("request", (request) => {
      if (request.url().includes("/v1/runs/")) requests.push(request.url());
    });
    await visit(page, url, `/runs/run-nope${part}`);
    const alert = page.getByRole("alert");
    await alert.waitFor();
    expect(await alert.textContent()).toContain("No run has the id run-nope.");
    expect(await page.getByRole("tab").count()).toBe(0);
    expect(problems, part).toHaveLength(1); // the console's line about the single request
    expect(new Set(requests).size, part).toBe(1);
    page.removeAllListeners("request");
    await page.goto("about:blank");
  }
  await visit(page, url, "/runs/run-nope");
  await checkAccessibility(observed, "unknown-run");
  await page.getByRole("alert").getByRole("link", { name: "Runs" }).click();
  await page.getByRole("heading", { name: "Runs" }).waitFor();
  await page.context().close();
});

test("a failure mode is in the address, and its list comes into the window", async () => {
  const observed = await openPage(browser, url);
  const { page, problems } = observed;
  await visit(page, url, `/runs/${run}/failures`);
  await page.getByRole("button", { name: "collision", exact: true }).first().click();
  await expect.poll(() => hash(page)).toBe(`#/runs/${run}/failures?task=kessler/survival&mode=collision`);
  const heading = page.getByRole("heading", { name: /^collision, .*newest stored failures$/ });
  const isInMiddle = async () => {
    const box = await heading.boundingBox();
    return box !== null && box.y > 100 && box.y < 600;
  };
  await expect.poll(isInMiddle).toBe(true);
  await page.reload();
  await heading.waitFor();
  await expect.poll(isInMiddle).toBe(true);
  // A cell of a rose is in the address too, and the back button leads to the mode.
  await page.locator("figure path.filled").first().click();
  await expect.poll(() => hash(page)).toMatch(/&sector=\d+/);
  await page.getByRole("heading", { name: /°.*newest stored failures$/ }).waitFor();
  await page.goBack();
  await heading.waitFor();
  expect(hash(page)).not.toContain("sector");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("filters list the tasks of the run only", async () => {
  const { page, problems } = await openPage(browser, url);
  await visit(page, url, `/runs/${run}/episodes`);
  const options = page.getByRole("combobox", { name: /^Task/ }).locator("option");
  await expect.poll(() => options.count()).toBe(5); // any, and the four tasks of kessler
  expect((await options.allTextContents()).slice(1).every((task) => task.startsWith("kessler/"))).toBe(true);
  const modes = await page
    .getByRole("combobox", { name: /^Failure mode/ })
    .locator("option")
    .allTextContents();
  expect(modes).toContain("collision");
  expect(modes.some((mode) => mode.includes("battery") || mode.includes("docking"))).toBe(false);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the lists of designs, evaluations and scenarios keep filters and selections in the address", async () => {
  const { page, problems } = await openPage(browser, url);
  await visit(page, url, `/runs/${run}/designs`);
  await page.getByRole("combobox", { name: "State" }).selectOption("active");
  await expect.poll(() => hash(page)).toBe(`#/runs/${run}/designs?state=active`);
  await page.reload();
  expect(await page.getByRole("combobox", { name: "State" }).inputValue()).toBe("active");

  await visit(page, url, "/evaluations");
  const row = (id: string) => page.getByRole("row").filter({ hasText: id });
  await row("eval-1").getByLabel("A", { exact: true }).check();
  await row("eval-2").getByLabel("B", { exact: true }).check();
  await expect.poll(() => hash(page)).toBe("#/evaluations?a=eval-1&b=eval-2");
  await page.reload();
  await expect.poll(() => row("eval-1").getByLabel("A", { exact: true }).isChecked()).toBe(true);
  expect(await row("eval-1").getByLabel("B", { exact: true }).isDisabled()).toBe(true);
  await page.getByRole("button", { name: "Compare A with B" }).click();
  await page.getByText("Scenario by scenario").waitFor();
  await page.locator("td button").first().click();
  await expect.poll(() => hash(page)).toMatch(/^#\/evaluations\/compare\?a=eval-1&b=eval-2&scenario=\d+$/);
  await page.reload();
  await page
    .getByRole("status")
    .getByText(/^Scenario \d+,/)
    .waitFor();

  await visit(page, url, "/evaluations/eval-1");
  await page.getByLabel("Order").selectOption("suite order");
  await expect.poll(() => hash(page)).toBe("#/evaluations/eval-1?order=index");
  await page.reload();
  await expect.poll(() => page.getByLabel("Order").inputValue()).toBe("index");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("each figure of the server has a mark with its limit", async () => {
  const observed = await openPage(browser, url);
  const { page, problems } = observed;
  await visit(page, url, "/server");
  await page.getByText("can be used").waitFor();
  const marks = page.locator("dd:has(.badge)");
  await expect.poll(() => marks.count()).toBeGreaterThanOrEqual(7);
  const titles = await marks.evaluateAll((all) => all.map((dd) => dd.getAttribute("title") ?? ""));
  expect(titles.join("\n")).toContain("/readyz");
  expect(titles.join("\n")).toContain("the alert rule low_disk");
  expect(titles.every((title) => /Good|Warning|Bad/.test(title))).toBe(true);
  // Keyboards and phones read the limit in a popover.
  await marks.first().getByRole("button", { name: "good" }).press("Enter");
  await page.locator("[popover]:popover-open").getByText("limit").waitFor();
  await page.keyboard.press("Escape");
  await checkAccessibility(observed, "server");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("dates are relative with the complete time in the title", async () => {
  const observed = await openPage(browser, url);
  const { page } = observed;
  for (const route of [`/runs/${run}?tab=activity`, `/runs/${run}/episodes`, "/evaluations"]) {
    await visit(page, url, route);
    await waitUntilIdle(observed).catch(() => undefined);
    const moment = page.locator("main time").first();
    expect(await moment.textContent(), route).toMatch(/ago$|now$/);
    expect(await moment.getAttribute("title"), route).toMatch(/^[A-Z][a-z]{2} \d+, \d{4}, \d\d:\d\d:\d\d$/);
  }
  await page.context().close();
});

test("the chip of the episode is inside the strip of its group", async () => {
  const { page, problems } = await openPage(browser, url, { width: 1440, height: 900 });
  const response = await fetch(`${url}/v1/runs/${run}/episodes/search?limit=500`);
  const { episodes } = (await response.json()) as { episodes: { episode: string; replay: string }[] };
  // The last episode of a group of twelve is the one that the narrowed strip would cut.
  const last = episodes.find(
    ({ episode, replay }) => replay === "available" && Number(episode.split("_").at(-1)) % 12 === 11,
  );
  await visit(page, url, `/runs/${run}/episodes/${last?.episode ?? ""}`);
  const strip = page.getByRole("navigation", { name: "Episodes of the group" });
  await page.getByRole("button", { name: "GIF" }).waitFor();
  const isInside = async () => {
    const [outer, chip] = [await strip.boundingBox(), await strip.locator("[aria-current]").boundingBox()];
    if (!outer || !chip) return false;
    return chip.x >= outer.x && chip.x + chip.width <= outer.x + outer.width;
  };
  await expect.poll(isInside).toBe(true);
  await page.setViewportSize({ width: 900, height: 900 });
  await expect.poll(isInside).toBe(true);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("a phone shows long lists in parts and collapses further charts", async () => {
  const observed = await openPage(browser, url, { width: 390, height: 844 });
  const { page, problems } = observed;
  await visit(page, url, `/runs/${run}`);
  await waitUntilIdle(observed);
  const charts = await page.locator("canvas").count();
  await page.getByText("Throughput and groups of survival").click();
  await expect.poll(() => page.locator("canvas").count()).toBeGreaterThan(charts);
  await checkAccessibility(observed, "run-phone-open");
  await visit(page, url, `/runs/${run}/episodes`);
  const cards = page.locator(".wide tbody tr");
  await expect.poll(() => cards.count()).toBe(20);
  await page.getByRole("button", { name: /^Show \d+ more$/ }).click();
  await expect.poll(() => cards.count()).toBe(100);
  await visit(page, url, `/runs/${run}/failures`);
  expect(await page.locator("figure").count()).toBe(0);
  await page
    .getByText(/^Failures by /)
    .first()
    .click();
  await expect.poll(() => page.locator("figure").count()).toBeGreaterThan(0);
  expect(problems).toEqual([]);
  await page.context().close();
});
