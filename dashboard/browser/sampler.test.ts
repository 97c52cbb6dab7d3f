/** Checks the sampler of a task: its rungs, their values, their course over time, and strategies without rungs. */
import { readFile } from "node:fs/promises";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit, waitUntilIdle, type ObservedPage } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { checkAccessibility, checkPage } from "./page-checks";
import type { Lease } from "./server";

const GROUPS = 48;

const fixture = useFixture(async (server) => {
  const docking = { strategy: "staircase", tasks: ["docking/single"] };
  await createHeldRun(server, "staircase", GROUPS, docking);
  await createHeldRun(server, "auto", GROUPS, {
    strategy: "auto",
    tasks: ["kessler/survival", "kessler/rendezvous"],
  });
  await createHeldRun(server, "fixed", GROUPS, { strategy: "fixed" });
  await server.post("/v1/runs", { id: "lost", seed: 7, design: { designer: "off" }, ...docking });
  const lease = await server.post<Lease>("/v1/runs/lost/leases", { groups: 4 });
  const results = lease.groups.flatMap(({ episodes }) =>
    episodes.map((episode) => ({ episode, status: "failed", reason: "the worker was preempted" })),
  );
  await server.post("/v1/runs/lost/results", { results });
});

/** Opens the page of a run and waits until its charts are drawn. */
async function openRun(run: string): Promise<ObservedPage> {
  const observed = await fixture.openPage();
  await visit(observed.page, fixture.server.url, `/runs/${run}`);
  await waitUntilIdle(observed);
  return observed;
}

const panel = (page: Page, name: string) => page.getByRole("figure", { name });

test("a staircase shows its rungs with draws, chains and success", async () => {
  const { page, problems } = await openRun("staircase");
  const now = panel(page, "Sampler of single: staircase");
  await now.getByText("chains").first().waitFor();
  const chart = now.getByRole("img", { name: "Proposals and success of single by start scale; the most" });
  await chart.locator("circle").first().waitFor();
  expect(await chart.locator("rect").first().locator("title").textContent()).toMatch(
    /^start scale 0\.\d+: \d+(\.\d)? % of the proposals$/,
  );
  expect(await now.getByRole("row").count()).toBe(0); // the table is closed
  await now.getByText("Values").click();
  expect(await now.getByRole("row").count()).toBe(1 + 16);
  const chains = await now
    .getByRole("row")
    .evaluateAll((rows) => rows.slice(1).map((row) => Number(row.children[4]?.textContent)));
  expect(chains.reduce((sum, n) => sum + n, 0)).toBe(32);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the heat map has the draws of each point, and is exported", async () => {
  const { page, problems } = await openRun("staircase");
  const course = panel(page, "Draws of single by start scale");
  const cells = course.getByRole("img").locator("rect > title");
  const groups = (await cells.allTextContents()).map((text) => Number(/: (\d+) groups?,/.exec(text)?.[1]));
  expect(groups.reduce((sum, n) => sum + n, 0)).toBe(GROUPS);
  await course.getByText("of the groups with results").waitFor();
  await course.getByLabel("Colour").selectOption("success");
  await course.locator("p").getByText("success rate 0 %").waitFor();
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    course.getByRole("button", { name: "CSV of the draws of single" }).click(),
  ]);
  const [head, ...rows] = (await readFile(await download.path(), "utf8")).trim().split("\n");
  expect(head?.match(/"[^"]*"/g)).toHaveLength(2 * 16);
  expect(rows.length).toBeGreaterThan(0);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("auto gives the reason of its choice for each task", async () => {
  const { page, problems } = await openRun("auto?task=all");
  await panel(page, "Sampler of survival: staircase")
    .getByText("Chosen by auto, because it needed")
    .waitFor();
  const uniform = panel(page, "Sampler of rendezvous: uniform");
  await uniform.getByText("Levels are drawn uniformly.").waitFor();
  await panel(page, "Draws of rendezvous by level").waitFor();
  await uniform.getByText("Values").click();
  expect(await uniform.getByRole("columnheader").allTextContents()).toEqual([
    "Level",
    "Share of proposals",
    "Next proposal",
    "Success rate",
    "Recent episodes",
  ]);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("a strategy without rungs and a run without results say so", async () => {
  for (const [run, text] of [
    ["fixed", "The strategy draws params instead of rungs."],
    ["lost", "No results in this range."],
  ] as const) {
    const { page, problems } = await openRun(run);
    await page.getByText(text).first().waitFor();
    expect(await page.getByRole("heading", { name: "Draws of" }).count(), run).toBe(run === "fixed" ? 0 : 1);
    expect(problems).toEqual([]);
    await page.context().close();
  }
});

test("the charts are accessible in both colour schemes and on a phone", async () => {
  for (const run of ["staircase", "auto"]) {
    for (const dark of [false, true]) {
      const observed = await fixture.openPage({ dark });
      const name = `sampler-${run}-${dark ? "dark" : "light"}`;
      await checkPage(observed, fixture.server.url, name, { route: `/runs/${run}`, text: "Sampler of" });
      await observed.page.getByText("Values").first().click();
      await checkAccessibility(observed, name);
      await observed.page.context().close();
    }
    const observed = await fixture.openPage({ width: 390, height: 844 });
    await checkPage(observed, fixture.server.url, `sampler-${run}-phone`, {
      route: `/runs/${run}`,
      text: "Sampler of",
    });
    // A phone collapses the sampler below its title.
    await observed.page.locator("summary", { hasText: "Sampler of" }).first().click();
    await observed.page.getByText("Values").first().click();
    const overflow = await observed.page.evaluate(
      () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
    );
    expect(overflow, run).toBeLessThanOrEqual(0);
    await observed.page.context().close();
  }
});
