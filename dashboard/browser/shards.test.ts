/** Checks the dashboard of two servers behind nginx: runs of both shards, and the notice for one that is away. */
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { launchBrowser, openPage, SCREENSHOT_FOLDER, visit, waitUntilIdle } from "./browser";
import { createHeldRun } from "./fixture";
import { Nginx } from "./nginx";
import { checkAccessibility, checkPage } from "./page-checks";
import { freePort } from "./ports";
import { SparringServer } from "./server";

let browser: Browser;
let east: SparringServer;
let west: SparringServer;
let nginx: Nginx;

beforeAll(async () => {
  browser = await launchBrowser();
  const hosts = [`127.0.0.1:${String(await freePort())}`, `127.0.0.1:${String(await freePort())}`] as const;
  const start = (shard: string, host: string, peer: string, other: string) =>
    SparringServer.start(["--shard", shard, "--peers", `${peer}=http://${other}`], {}, host);
  east = await start("east", hosts[0], "west", hosts[1]);
  west = await start("west", hosts[1], "east", hosts[0]);
  nginx = await Nginx.start(...hosts);
  await createHeldRun(east, "east.first", 4, { name: "first", tags: ["paper"] });
  await createHeldRun(west, "west.second", 8, { name: "second" });
  await createHeldRun(west, "west.third", 4, { name: "third" });
});
afterAll(async () => {
  await browser.close();
  await nginx.dispose();
  await Promise.all([east.dispose(), west.dispose()]);
});

const ids = (page: Page) =>
  page.locator("[data-run]").evaluateAll((rows) => rows.map((row) => row.getAttribute("data-run")));

test("the runs page lists, sorts and archives the runs of both shards", async () => {
  const { page, problems } = await openPage(browser, nginx.url);
  await visit(page, nginx.url, "/?sort=episodes&order=desc");
  await page.getByText("3 runs", { exact: true }).waitFor();
  expect((await ids(page))[0]).toBe("west.second");
  expect((await ids(page)).sort()).toEqual(["east.first", "west.second", "west.third"]);
  expect(await page.getByText(/are missing/).count()).toBe(0);
  await page.getByLabel("Search").fill("second");
  await expect.poll(() => ids(page)).toEqual(["west.second"]);
  await page.getByRole("link", { name: "second" }).click();
  await page.getByText("Mastery of survival").first().waitFor();
  expect(page.url()).toContain("#/runs/west.second");

  await visit(page, nginx.url, "/compare?runs=east.first,west.second");
  await page.getByText("Values at the end").waitFor();

  await visit(page, nginx.url, "/?sort=name");
  await page.getByLabel("Select first").check();
  await page.getByLabel("Select third").check();
  const bar = page.getByRole("region", { name: "Selected runs" });
  await bar.getByRole("button", { name: "Archive" }).click();
  await expect.poll(() => ids(page)).toEqual(["west.second"]);
  for (const [server, run] of [
    [east, "east.first"],
    [west, "west.third"],
  ] as const) {
    expect((await server.get(`/v1/runs/${run}`))["archived_at"]).not.toBeNull();
    await server.post(`/v1/runs/${run}/resume`, null);
  }
  await visit(page, nginx.url, "/server");
  await page.getByText("east", { exact: true }).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("a notice names the shard that is away, in both colour schemes and on a phone", async () => {
  await west.kill();
  const notice = "The runs of the shard west are missing";
  for (const dark of [false, true]) {
    for (const width of [1440, 390]) {
      const observed = await openPage(browser, nginx.url, { dark, width });
      const name = `shards-${String(width)}-${dark ? "dark" : "light"}`;
      await checkPage(observed, nginx.url, name, { route: "/", text: notice });
      expect(await ids(observed.page)).toEqual(["east.first"]);
      await checkAccessibility(observed, name);
      expect(await observed.page.evaluate(() => document.documentElement.scrollWidth)).toBeLessThanOrEqual(
        width,
      );
      await observed.page.context().close();
    }
  }
  const observed = await openPage(browser, nginx.url);
  const { page, problems } = observed;
  for (const [route, items] of [
    ["/?group=tag", "runs"],
    ["/evaluations", "evaluations"],
    ["/alerts", "alerts"],
  ] as const) {
    await visit(page, nginx.url, route);
    await page.getByText(`The ${items} of the shard west are missing`).waitFor();
  }
  await waitUntilIdle(observed);
  await page.screenshot({ path: `${SCREENSHOT_FOLDER}/shards-alerts.png` });
  // The list is whole again when the server is back, without a reload.
  await visit(page, nginx.url, "/");
  await page.getByText(notice).waitFor();
  await west.restart();
  await page.getByText("3 runs", { exact: true }).waitFor();
  expect(await page.getByText(/are missing/).count()).toBe(0);
  expect(problems).toEqual([]);
  await page.context().close();
});
