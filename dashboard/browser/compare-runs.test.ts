/** Checks the comparison of runs: curves, groups, hidden runs, settings and evaluations, all of them in the address. */
import { readFile } from "node:fs/promises";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { SCREENSHOT_FOLDER, visit, waitUntilIdle } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { checkAccessibility } from "./page-checks";
import { reportHeldEpisodes, type Lease, type SparringServer } from "./server";

const RUNS = 10;
const ids = Array.from({ length: RUNS }, (_, i) => `run-${String(i)}`);
const SUITE = "docking-heldout-v1";

const fixture = useFixture(async (server) => {
  for (const [i, id] of ids.entries()) {
    const strategy = i % 2 === 0 ? "ladder" : "uniform";
    await createHeldRun(server, id, 8, {
      seed: i + 1,
      name: `arm ${strategy}`,
      strategy,
      tags: ["paper", `arm-${strategy}`],
    });
    await reportHeldEpisodes(server, id, 8, { policy_version: 1 });
  }
  await server.post("/v1/runs", {
    id: "docking",
    seed: 99,
    strategy: "ladder",
    tasks: ["docking/single"],
    design: { designer: "off" },
  });
  for (const version of [1, 2]) await evaluateHold(server, "docking", version);
});

/** Evaluates a policy version of a run whose agents hold, and in version 2 accelerate for some steps. */
async function evaluateHold(server: SparringServer, run: string, version: number) {
  const { id } = await server.post<{ id: string }>("/v1/evaluations", {
    suite: SUITE,
    tasks: ["docking/single"],
    policy: "learner",
    run,
    policy_version: version,
    rollouts: 1,
    stochastic: false,
  });
  const request = { groups: 500, purpose: "eval", evaluation: id };
  const lease = await server.post<Lease>(`/v1/runs/${run}/leases`, request);
  const steps = Array.from({ length: 5 * (version - 1) }, () => [[0, -1, 0, 0]]);
  const results = lease.groups
    .flatMap((group) => group.episodes)
    .map((episode) => ({ episode, actions: { steps, stopped: "too_late" } }));
  for (let first = 0; first < results.length; first += 64)
    await server.post(`/v1/runs/${run}/results`, { results: results.slice(first, first + 64) });
  return id;
}

/** Columns of the CSV file of a chart. */
async function columns(page: Page, chart: string): Promise<string[]> {
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: `CSV of ${chart}` }).click(),
  ]);
  const [head] = (await readFile(await download.path(), "utf8")).split("\n");
  return (head ?? "").split(/,(?=")/);
}

test("two runs have a curve each, and only the settings that differ", async () => {
  const observed = await fixture.openPage();
  const { page, problems } = observed;
  await visit(page, fixture.server.url, "/compare?runs=run-0,run-1");
  await page.locator(".u-over").first().waitFor();
  await waitUntilIdle(observed);
  expect(await columns(page, "Success rate of survival")).toEqual([
    "episodes",
    '"arm ladder"',
    '"arm uniform"',
  ]);
  const settings = page.locator("section", { hasText: "Show settings that do not differ" });
  await settings.getByText("curriculum.strategy", { exact: true }).waitFor();
  expect(await settings.getByText("group_size", { exact: true }).count()).toBe(0);
  await settings.getByRole("checkbox").check();
  await settings.getByText("group_size", { exact: true }).waitFor();
  await page.getByLabel("x axis").selectOption("steps");
  await expect.poll(() => new URL(page.url()).hash).toBe("#/compare?runs=run-0,run-1&x=steps&settings=all");
  // A run is added, and removed.
  await page.getByLabel("Add a run").selectOption("run-2");
  await page.getByRole("heading", { name: "3 runs" }).waitFor();
  await page.getByRole("button", { name: "Remove arm ladder, seed 3" }).click();
  await page.getByRole("heading", { name: "2 runs" }).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test.each([false, true])(
  "ten runs are grouped and hidden with the keyboard, dark theme: %s",
  async (dark) => {
    const observed = await fixture.openPage({ dark });
    const { page, problems } = observed;
    await visit(page, fixture.server.url, `/compare?runs=${ids.join(",")}`);
    await page.locator(".u-over").first().waitFor();
    await waitUntilIdle(observed);
    const legend = page.getByRole("region", { name: "Compared runs" });
    expect(await legend.getByRole("checkbox").count()).toBe(RUNS);
    expect(await legend.locator("line[stroke-dasharray]").count()).toBe(RUNS - 8);
    expect((await columns(page, "Success rate of survival")).length).toBe(RUNS + 1);
    await checkAccessibility(observed, "compare-runs");
    const theme = dark ? "dark" : "light";
    await page.screenshot({ path: `${SCREENSHOT_FOLDER}/compare-ten-${theme}.png`, fullPage: true });

    await legend.getByRole("checkbox", { name: "Show arm ladder, seed 1", exact: true }).focus();
    await page.keyboard.press("Space");
    await page.getByRole("heading", { name: "10 runs, 1 hidden" }).waitFor();
    await page.getByLabel("Group by").selectOption("settings");
    await legend.getByText("strategy ladder").waitFor();
    expect(await columns(page, "Success rate of survival")).toEqual([
      "episodes",
      '"arm-ladder, strategy ladder (4 runs)"',
      '"arm-ladder, strategy ladder (4 runs), low"',
      '"arm-ladder, strategy ladder (4 runs), high"',
      '"arm-uniform, strategy uniform (5 runs)"',
      '"arm-uniform, strategy uniform (5 runs), low"',
      '"arm-uniform, strategy uniform (5 runs), high"',
    ]);
    await page.getByLabel("Band").selectOption("extremes");
    const query = `runs=${ids.join(",")}&hide=run-0&group=settings&band=extremes`;
    await expect.poll(() => new URL(page.url()).hash).toBe(`#/compare?${query}`);
    await checkAccessibility(observed, "compare-groups");
    // Groups are compared with the baseline: 4 and 5 runs have an interval of their difference.
    const ends = page.locator("section", { hasText: "Values at the end" });
    const [ladder, uniform] = ["arm-ladder, strategy ladder", "arm-uniform, strategy uniform"];
    await ends.getByText(new RegExp(`^Is the difference real\\? ${uniform} `)).waitFor();
    const interval = /^[+−][\d.]+( pp)? \[[+−][\d.]+( pp)?, [+−][\d.]+( pp)?\]$/;
    expect(await ends.getByText(interval).count()).toBeGreaterThan(0);
    expect(await ends.getByText(/^[+−].* pp/).count()).toBeGreaterThan(0);
    expect(await ends.getByText(/^[+−].*%/).count()).toBe(0);
    await page.getByLabel("Baseline").selectOption(uniform);
    await ends.getByText(new RegExp(`^Is the difference real\\? ${ladder} `)).waitFor();
    await expect.poll(() => new URL(page.url()).hash).toContain("baseline=arm-uniform");
    await page.screenshot({ path: `${SCREENSHOT_FOLDER}/compare-groups-${theme}.png`, fullPage: true });

    await page.reload();
    await page.getByRole("heading", { name: "10 runs, 1 hidden" }).waitFor();
    expect(await page.getByLabel("Band").inputValue()).toBe("extremes");
    await page.getByLabel("Group by").selectOption("tags");
    await legend.getByText("arm-uniform").waitFor();
    expect(problems).toEqual([]);
    await page.context().close();
  },
);

test("runs of several tasks have a summary over all tasks first, with the best run above", async () => {
  const { server } = fixture;
  for (const [id, policy_version] of [
    ["both-1", 1],
    ["both-2", 2],
  ] as const) {
    await createHeldRun(server, id, 24, {
      seed: policy_version,
      strategy: "ladder",
      placement: false,
      tasks: ["kessler/survival", "docking/single"],
    });
  }
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/compare?runs=both-1,both-2");
  const summary = page.getByRole("region", { name: "All tasks at the end" });
  await summary.getByText(/Means over the 2 tasks/).waitFor();
  const heads = await summary.getByRole("columnheader").allTextContents();
  expect(heads).toContain("Skill, last tenth");
  const skills = await summary
    .getByRole("row")
    .filter({ has: page.getByRole("cell") })
    .evaluateAll((rows) => rows.map((row) => row.textContent));
  expect(skills).toHaveLength(2);
  const [summaryAt, chartAt] = await Promise.all([
    summary.boundingBox(),
    page.locator(".u-over").first().boundingBox(),
  ]);
  expect(summaryAt?.y ?? Infinity).toBeLessThan(chartAt?.y ?? 0);
  // The first task is the first one of the settings, and whole levels have no decimals.
  expect(await page.getByRole("combobox", { name: /^Task/ }).inputValue()).toBe("kessler/survival");
  const values = page.getByRole("region", { name: "Values at the end of survival" });
  const level = heads.indexOf("Level at the end");
  expect(await values.getByRole("row").nth(1).getByRole("cell").nth(level).textContent()).toMatch(
    /^0baseline/,
  );
  expect(problems).toEqual([]);
  await page.context().close();
});

test("an unknown run is named, and the others are compared", async () => {
  const observed = await fixture.openPage();
  const { page } = observed;
  await visit(page, fixture.server.url, "/compare?runs=run-0,nothing");
  await page.getByRole("button", { name: "Remove nothing" }).click();
  await page.getByRole("heading", { name: "1 run", exact: true }).waitFor();
  await expect.poll(() => new URL(page.url()).hash).toBe("#/compare?runs=run-0");
  await page.context().close();
});

test("the comparison fits a phone", async () => {
  const observed = await fixture.openPage({ width: 390, height: 844 });
  const { page, problems } = observed;
  for (const route of [
    `/compare?runs=${ids.join(",")}&group=tags`,
    "/evaluations",
    "/evaluations/compare?a=eval-1&b=eval-2",
  ]) {
    await visit(page, fixture.server.url, route);
    await waitUntilIdle(observed);
    expect(await page.evaluate(() => document.documentElement.scrollWidth), route).toBe(390);
    await checkAccessibility(observed, route);
  }
  expect(problems).toEqual([]);
  await page.context().close();
});

test("evaluations show results, the best version, and replays of scenarios", async () => {
  const observed = await fixture.openPage();
  const { page, problems } = observed;
  await visit(page, fixture.server.url, "/evaluations");
  await page.getByText(/^Best: version \d/).waitFor();
  await waitUntilIdle(observed);
  expect(
    await page
      .getByRole("row", { name: /eval-2/ })
      .getByText(/%/)
      .count(),
  ).toBe(1);
  await page.getByLabel("Measure").selectOption("skill");
  await expect.poll(() => new URL(page.url()).hash).toBe("#/evaluations?measure=skill");
  await checkAccessibility(observed, "evaluations");

  await visit(page, fixture.server.url, "/evaluations/compare?a=eval-1&b=eval-2");
  await page.getByText("Scenario by scenario").waitFor();
  await page.getByRole("heading", { name: "learner v1 of docking against learner v2 of docking" }).waitFor();
  await page.locator("circle.a, circle.b").first().click();
  await page
    .getByRole("status")
    .getByText(/^Scenario \d+, single/)
    .waitFor();
  await checkAccessibility(observed, "compare-evaluations");
  // The table leads to the replays without a pointer.
  await page.getByRole("row").getByRole("link", { name: "Replay A" }).first().focus();
  await page.keyboard.press("Enter");
  await expect.poll(() => new URL(page.url()).hash).toMatch(/^#\/runs\/docking\/episodes\/ep_/);
  await page.getByText("Timeline").first().waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});
