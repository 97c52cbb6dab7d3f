/** Checks the charts of the metrics that a trainer logged: groups, axes, gaps, filter, time range, updates. */
import { execFileSync } from "node:child_process";
import { readFile } from "node:fs/promises";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit, waitUntilIdle, type ObservedPage } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { checkAccessibility, checkPage } from "./page-checks";
import { reportHeldEpisodes, type SparringServer } from "./server";

const REPORTS = 10;
/** Moves the report of step 1000 k to 9 − k hours ago, and the start of the run before all of them. */
const SPREAD_REPORTS = `
import sqlite3, sys
db = sqlite3.connect(sys.argv[1])
db.execute("UPDATE trainer_metrics SET at = at - 3600000 * (9 - step / 1000) WHERE step < 1000000")
db.execute("UPDATE runs SET created_at = created_at - 36000000")
db.commit()
`;
/** Names that take much space; the server accepts letters, digits and _.:/- only. */
const LONG_NAME = `long/${"x".repeat(123)}`;

/** Values that need a range of their own on the axis: constants beyond the precision of doubles, and the ends of their range. */
const EXTREMES: Record<string, [number | null, number | null]> = {
  large: [1e16, 1e16],
  nanoseconds: [1.2e18, 1.2e18],
  last_bit: [1.2e18, 1.2e18 + 256],
  largest: [null, 1e308],
  both_ends: [-1.7e308, 1.7e308],
  drawn_ends: [-1e300, 1e300],
  zero: [0, 0],
  negative: [-1e16, -1e16],
  tiny: [1e-300, 1e-300],
  smallest: [5e-324, 5e-324],
};

const fixture = useFixture(async (server) => {
  await createHeldRun(server, "logged", 16);
  await createHeldRun(server, "many", 2);
  await createHeldRun(server, "plain", 2);
  for (let k = 0; k < REPORTS; k++) {
    await log(server, "logged", 1000 * k, {
      entropy: 2 - 0.1 * k,
      "eval/docking/return": 10 * k,
      "train/loss": k === 4 ? null : 1 / (k + 1),
      "train/kl": 1e-5 * (k + 1),
    });
  }
  const names = Array.from({ length: 20 }, (_, i) => `group${String(i % 4)}/metric_${String(i)}`);
  await log(server, "many", 1, Object.fromEntries([...names, LONG_NAME].map((name, i) => [name, i])));
  await createHeldRun(server, "extreme", 2);
  for (const i of [0, 1]) {
    const values = Object.entries(EXTREMES).map(([name, values]) => [name, values[i]]);
    await log(server, "extreme", Number.MAX_SAFE_INTEGER - 1 + i, Object.fromEntries(values));
  }
  await server.kill();
  execFileSync("python3", ["-c", SPREAD_REPORTS, server.databasePath]);
  await server.restart();
});

async function log(server: SparringServer, run: string, step: number, metrics: object) {
  await server.post(`/v1/runs/${run}/metrics`, { step, metrics });
}

/** Opens the tab of the trainer of a run and waits until its charts are drawn. */
async function openRun(run: string): Promise<ObservedPage> {
  const observed = await fixture.openPage();
  await visit(observed.page, fixture.server.url, `/runs/${run}?tab=trainer`);
  await waitUntilIdle(observed);
  return observed;
}

const section = (page: Page) => page.getByRole("region", { name: "Trainer metrics" });
const chart = (page: Page, name: string) => page.getByRole("img", { name: `Trainer metric ${name} by` });

/** Downloads the values of a chart. */
async function readCsv(page: Page, name: string): Promise<string[]> {
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: `CSV of ${name}` }).click(),
  ]);
  return (await readFile(await download.path(), "utf8")).trim().split("\n");
}

test("metrics are grouped and show their last value", async () => {
  const { page, problems } = await openRun("logged");
  const groups = section(page).getByRole("region");
  const names = await groups.evaluateAll((all) => all.map((group) => group.getAttribute("aria-label")));
  expect(names).toEqual(["Metrics without a group", "eval/docking", "train"]);
  const titles = await section(page).locator("figcaption h3").allTextContents();
  expect(titles).toEqual(["entropy: 1.1", "return: 90", "kl: 1e-4", "loss: 0.1"]);
  expect(await section(page).locator("canvas").count()).toBe(4);
  expect(await section(page).getByRole("searchbox").count()).toBe(0); // few metrics need no filter
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the x axis is time or the trainer's step, and gaps stay gaps", async () => {
  const { page, problems } = await openRun("logged");
  const byTime = await readCsv(page, "train/loss");
  expect(byTime[0]).toBe('time,"loss"');
  expect(byTime).toHaveLength(1 + REPORTS);
  expect(byTime[5]).toMatch(/^\d{4}-\d\d-\d\dT[^,]*,$/);
  await page.getByLabel("x axis").selectOption("step");
  await chart(page, "train/loss").hover();
  const pointed = section(page).locator("figure", { hasText: "loss:" }).locator(".pointed");
  await expect.poll(() => pointed.textContent()).toMatch(/^step [\d,]+: /);
  expect((await readCsv(page, "train/loss")).slice(0, 6)).toEqual([
    'step,"loss"',
    "0,1",
    "1000,0.5",
    "2000,0.3333333333333333",
    "3000,0.25",
    "4000,",
  ]);
  expect(problems).toEqual([]);
  await page.context().close();
});

/** Drags over a part of a chart, given as shares of its width; returns the range that the metrics are then requested for (s). */
async function selectOn(page: Page, name: string, from: number, to: number): Promise<[number, number]> {
  const plot = chart(page, name).locator(".u-over");
  await plot.scrollIntoViewIfNeeded();
  const box = await plot.boundingBox();
  if (!box) throw new Error(`the chart of ${name} is not visible`);
  const y = box.y + box.height / 2;
  const [request] = await Promise.all([
    page.waitForRequest((request) => /\/metrics\?.*from=/.test(request.url())),
    (async () => {
      await page.mouse.move(box.x + box.width * from, y);
      await page.mouse.down();
      await page.mouse.move(box.x + (box.width * (from + to)) / 2, y);
      await page.mouse.move(box.x + box.width * to, y);
      await page.mouse.up();
    })(),
  ]);
  const query = new URL(request.url()).searchParams;
  return [Date.parse(query.get("from") ?? "") / 1000, Date.parse(query.get("to") ?? "") / 1000];
}

test("a range selected on a metric applies to all charts", async () => {
  const observed = await openRun("logged");
  const { page, problems } = observed;
  const all = page.getByRole("button", { name: "All", exact: true });
  const [from, to] = await selectOn(page, "train/loss", 0.5, 0.9);
  expect((to - from) / 3600).toBeGreaterThan(3);
  expect((to - from) / 3600).toBeLessThan(5);
  await waitUntilIdle(observed);
  expect(await all.getAttribute("aria-pressed")).toBe("false");
  const rows = await readCsv(page, "entropy");
  expect(rows.length).toBeLessThan(REPORTS);
  await chart(page, "entropy").locator(".u-over").dblclick();
  await expect.poll(() => all.getAttribute("aria-pressed")).toBe("true");
  await expect.poll(async () => (await readCsv(page, "entropy")).length).toBe(1 + REPORTS);

  // Steps are selected by the times at which they were reported: 2 250 to 6 750 are the reports 3 to 6.
  await page.getByLabel("x axis").selectOption("step");
  await waitUntilIdle(observed);
  const [first, last] = await selectOn(page, "train/kl", 0.25, 0.75);
  expect((last - first) / 3600).toBeCloseTo(3, 2);
  await waitUntilIdle(observed);
  const steps = (await readCsv(page, "train/kl")).slice(1).map((row) => Number(row.split(",")[0]));
  expect(steps).toEqual([3000, 4000, 5000, 6000]);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("many metrics are filtered by parts of their names", async () => {
  const observed = await openRun("many");
  const { page, problems } = observed;
  const titles = () => section(page).locator("figcaption h3").allTextContents();
  expect(await titles()).toHaveLength(21);
  await page.getByRole("searchbox", { name: "Filter" }).fill("GROUP1 _1");
  const found = ["metric_1: 1", "metric_13: 13", "metric_17: 17"];
  expect(await titles()).toEqual(found);
  await expect.poll(() => new URL(page.url()).hash).toContain("metrics=GROUP1%20_1");
  await page.reload();
  await waitUntilIdle(observed);
  expect(await titles()).toEqual(found);
  await page.getByRole("searchbox", { name: "Filter" }).fill("absent");
  await page.getByText("No metric has this name.").waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("constant and extreme values and steps are drawn", async () => {
  const observed = await openRun("extreme");
  const { page, problems } = observed;
  for (const axis of ["time", "step"]) {
    await page.getByLabel("x axis").selectOption(axis);
    await waitUntilIdle(observed);
    expect(await section(page).locator("canvas").count()).toBe(Object.keys(EXTREMES).length);
  }
  await page.getByLabel("y axis").selectOption("logarithmic");
  for (const range of ["of the group", "of each chart"]) {
    await page.getByRole("combobox", { name: "range" }).selectOption(range);
    await waitUntilIdle(observed);
    expect(await section(page).locator("canvas").count()).toBe(Object.keys(EXTREMES).length);
  }
  const title = section(page).getByRole("heading", { name: "largest: 1e308", exact: true });
  expect(await title.count()).toBe(1);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("new metrics appear while the page is open", async () => {
  const { server } = fixture;
  const { page, problems } = await openRun("plain");
  expect(await section(page).count()).toBe(0); // a run without metrics has no section
  await log(server, "plain", 1, { "train/loss": 0.5 });
  await reportHeldEpisodes(server, "plain", 1);
  await section(page).getByRole("heading", { name: "loss: 0.5" }).waitFor();
  await log(server, "plain", 2, { "train/loss": null });
  await reportHeldEpisodes(server, "plain", 1);
  await section(page).getByRole("heading", { name: "loss: not finite" }).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the charts are accessible in both colour schemes and on a phone", async () => {
  for (const run of ["logged", "many"]) {
    for (const dark of [false, true]) {
      const observed = await fixture.openPage({ dark });
      const name = `trainer-metrics-${run}-${dark ? "dark" : "light"}`;
      await checkPage(observed, fixture.server.url, name, {
        route: `/runs/${run}?tab=trainer`,
        text: "Trainer metrics",
      });
      await checkAccessibility(observed, name);
      await observed.page.context().close();
    }
    const observed = await fixture.openPage({ width: 390, height: 844 });
    await checkPage(observed, fixture.server.url, `trainer-metrics-${run}-phone`, {
      route: `/runs/${run}?tab=trainer`,
      text: "Trainer metrics",
    });
    const overflow = await observed.page.evaluate(
      () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
    );
    expect(overflow, run).toBeLessThanOrEqual(0);
    await observed.page.context().close();
  }
});
