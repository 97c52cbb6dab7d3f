/** Checks the value axes of charts: logarithmic, without outliers, and of a group; the address holds the choice. */
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit, waitUntilIdle, type ObservedPage } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { checkAccessibility } from "./page-checks";
import { reportHeldEpisodes } from "./server";

const REPORTS = 16;

const fixture = useFixture(async (server) => {
  await createHeldRun(server, "values", 4);
  for (let k = 0; k < REPORTS; k += 1) {
    await server.post("/v1/runs/values/metrics", {
      step: 1000 * k,
      metrics: {
        "train/loss": 10 ** (3 - k / 4),
        "train/grad_norm": k === 9 ? 5e4 : 1 + (k % 3) / 10,
        "train/advantage": k - 8,
        "train/debt": -1 - k,
      },
    });
    await reportHeldEpisodes(server, "values", 1, { policy_version: k });
  }
  await createHeldRun(server, "half", 16, { target: "half" });
  await createHeldRun(server, "mastery", 16, { target: "mastery" });
});

async function openRun(query: string): Promise<ObservedPage> {
  const observed = await fixture.openPage();
  await visit(observed.page, fixture.server.url, `/runs/${query}`);
  await waitUntilIdle(observed);
  return observed;
}

const hash = (page: Page) => new URL(page.url()).hash;
/** Line below a small chart: the hidden values, or the value at the pointer. */
const note = (page: Page, title: string) =>
  page.locator("figure", { hasText: title }).locator(".pointed").textContent();

test("the address holds scale, clipping and the range of a group", async () => {
  const observed = await openRun("values?tab=trainer");
  const { page, problems } = observed;
  await page.getByLabel("y axis").selectOption("logarithmic");
  await expect.poll(() => hash(page)).toBe("#/runs/values?tab=trainer&y=log");
  await page.getByLabel("clip outliers").check();
  await page.getByRole("combobox", { name: "range" }).selectOption("of the group");
  const chosen = "#/runs/values?tab=trainer&y=log&outliers=clip&range=group";
  await expect.poll(() => hash(page)).toBe(chosen);
  await page.reload();
  await waitUntilIdle(observed);
  expect(hash(page)).toBe(chosen);
  expect(await page.getByLabel("y axis").inputValue()).toBe("log");
  expect(await page.getByLabel("clip outliers").isChecked()).toBe(true);
  expect(await page.getByRole("combobox", { name: "range" }).inputValue()).toBe("group");
  await checkAccessibility(observed, "value-axis");
  await page.getByLabel("y axis").selectOption("linear");
  await page.getByLabel("clip outliers").uncheck();
  await page.getByRole("combobox", { name: "range" }).selectOption("of each chart");
  await expect.poll(() => hash(page)).toBe("#/runs/values?tab=trainer");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("charts say which values their axes do not show", async () => {
  const observed = await openRun("values?tab=trainer&y=log");
  const { page, problems } = observed;
  expect(await note(page, "loss:")).toBe("");
  expect(await note(page, "advantage:")).toBe("9 values outside the range");
  expect(await note(page, "debt:")).toBe("no values above 0: linear axis");
  await page.getByLabel("y axis").selectOption("linear");
  await page.getByLabel("clip outliers").check();
  await expect.poll(() => note(page, "grad_norm:")).toBe("1 value outside the range");
  expect(await note(page, "advantage:")).toBe("");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the trainer's metrics and the curriculum have the same x axis", async () => {
  const observed = await openRun("values?tab=trainer&x=step");
  const { page, problems } = observed;
  for (const [axis, label] of [
    ["step", "by step"],
    ["episodes", "by episodes"],
    ["version", "by version"],
  ] as const) {
    await page.getByLabel("x axis").selectOption(axis);
    await waitUntilIdle(observed);
    await page.getByRole("img", { name: `Trainer metric train/loss ${label}` }).waitFor();
    const axes = await page.locator(".small-charts .u-over").count();
    expect(axes).toBeGreaterThanOrEqual(6);
  }
  // The last report is of the episodes before the last group of results.
  await page.getByLabel("x axis").selectOption("episodes");
  await waitUntilIdle(observed);
  await page.getByRole("img", { name: "Trainer metric train/loss" }).hover();
  await expect
    .poll(() => page.locator("figure", { hasText: "loss:" }).locator(".pointed").textContent())
    .toMatch(/^episodes \d+: /);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("only runs whose ladder moves on mastery show its thresholds", async () => {
  for (const [run, count] of [
    ["mastery", 1],
    ["half", 0],
  ] as const) {
    const { page, problems } = await openRun(run);
    await page.getByRole("heading", { name: "Mastery of survival" }).waitFor();
    expect(await page.getByText("thresholds of the ladder").count(), run).toBe(count);
    expect(problems).toEqual([]);
    await page.context().close();
  }
});
