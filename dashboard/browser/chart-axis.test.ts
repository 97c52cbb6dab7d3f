/** Checks the axes that the charts of a run offer: a run of some seconds shows its course, and the address holds the choice. */
import { readFile } from "node:fs/promises";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit, waitUntilIdle } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { checkAccessibility } from "./page-checks";
import { reportHeldEpisodes } from "./server";

/** Reports of four groups each, with a policy version of their own. */
const REPORTS = 12;

const fixture = useFixture(async (server) => {
  await createHeldRun(server, "fast", 4);
  for (let version = 1; version < REPORTS; version += 1)
    await reportHeldEpisodes(server, "fast", 4, { policy_version: version });
});

/** Positions on the axis of a chart, from its CSV file. */
async function positions(page: Page): Promise<string[]> {
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: "CSV of Skill of survival" }).click(),
  ]);
  const [head, ...rows] = (await readFile(await download.path(), "utf8")).trim().split("\n");
  return [head?.split(",")[0] ?? "", ...rows.map((row) => row.split(",")[0] ?? "")];
}

test("a run of some seconds shows its course on every axis", async () => {
  const observed = await fixture.openPage();
  const { page, problems } = observed;
  await visit(page, fixture.server.url, "/runs/fast");
  await page.locator(".u-over").first().waitFor();
  const axis = page.getByRole("combobox", { name: "x axis" }).first();
  for (const [value, expected] of [
    ["time", undefined],
    ["elapsed", undefined],
    ["episodes", (at: number) => 4 * at + 2],
    ["steps", undefined],
    ["version", undefined],
  ] as const) {
    await axis.selectOption(value);
    await waitUntilIdle(observed);
    const [head, ...points] = await positions(page);
    expect(head).toBe(value);
    expect(points.length, value).toBe(REPORTS);
    if (expected) expect(points.map(Number)).toEqual(points.map((_, at) => expected(at)));
    expect(new URL(page.url()).hash).toBe(`#/runs/fast${value === "time" ? "" : `?x=${value}`}`);
  }
  await checkAccessibility(observed, "run-axis");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the address holds axis, range and smoothing", async () => {
  const observed = await fixture.openPage();
  const { page, problems } = observed;
  await visit(page, fixture.server.url, "/runs/fast?x=episodes&smooth=0.8&from=8&to=24");
  const plot = page.locator(".u-over").first();
  await plot.waitFor();
  await waitUntilIdle(observed);
  await page.getByText("episodes 8 to 24 of each task").waitFor();
  expect(await page.getByLabel("smoothing").inputValue()).toBe("0.8");
  // The points at the borders are whole.
  expect((await positions(page)).slice(1).map(Number)).toEqual([6, 10, 14, 18, 22, 26]);

  await plot.scrollIntoViewIfNeeded();
  const box = await plot.boundingBox();
  if (!box) throw new Error("no plot is visible");
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width - 2, box.y + box.height / 2, { steps: 3 });
  await page.mouse.up();
  await expect.poll(() => page.url()).toMatch(/x=episodes&smooth=0\.8&from=16&to=2[34]$/);
  await waitUntilIdle(observed);
  const address = page.url();
  await page.reload();
  await page.locator(".u-over").first().waitFor();
  await waitUntilIdle(observed);
  expect(page.url()).toBe(address);
  await page.getByText(/episodes 16 to 2[34] of each task/).waitFor();

  await page.getByLabel("smoothing").fill("0.5");
  await page.getByRole("button", { name: "All", exact: true }).click();
  await expect.poll(() => new URL(page.url()).hash).toBe("#/runs/fast?x=episodes");
  await page.getByText(`episodes 0 to ${String(4 * REPORTS)} of each task`).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});
