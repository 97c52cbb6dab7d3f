/** Checks the page of workers: without NATS, with workers that join and leave, and without their NATS server. */
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { launchBrowser, openPage, visit } from "./browser";
import { createHeldRun } from "./fixture";
import { NatsServer, natsProgram, WorkerProcess } from "./nats";
import { checkAccessibility, checkPage } from "./page-checks";
import { reportHeldEpisodes, SparringServer } from "./server";

const program = natsProgram();
let browser: Browser;
beforeAll(async () => {
  browser = await launchBrowser();
});
afterAll(async () => {
  await browser.close();
});

const connection = (page: Page) => page.getByRole("region", { name: "Connection" });

/** Checks errors, accessibility and width of the page in both colour schemes. */
async function checkBothSchemes(server: SparringServer, name: string, text: string) {
  for (const dark of [false, true]) {
    const observed = await openPage(browser, server.url, { dark, width: 1440 });
    await checkPage(observed, server.url, `${name}-${dark ? "dark" : "light"}`, { route: "/workers", text });
    await checkAccessibility(observed, name);
    await observed.page.setViewportSize({ width: 390, height: 844 });
    const width = await observed.page.evaluate(() => document.documentElement.scrollWidth);
    expect(width).toBeLessThanOrEqual(390);
    await observed.page.context().close();
  }
}

test("a server without NATS says that it does all jobs, and how to add workers", async () => {
  const server = await SparringServer.start();
  const { page, problems } = await openPage(browser, server.url);
  await visit(page, server.url, "/");
  const menu = page.getByRole("navigation", { name: "Main" });
  await menu.getByRole("link", { name: "Workers" }).press("Enter");
  await page.getByRole("heading", { name: "Workers" }).waitFor();
  await expect.poll(() => connection(page).textContent()).toMatch(/not distributed.*does all jobs itself/s);
  expect(await connection(page).textContent()).toMatch(/sparring serve --nats.*sparring worker --nats/s);
  expect(problems).toEqual([]);
  await page.context().close();
  await checkBothSchemes(server, "workers-none", "not distributed");
  await server.dispose();
});

// Without a package of NATS for this system there is nothing to connect to.
test.skipIf(program === null)("workers join, do jobs, stall and leave without a reload", async () => {
  const nats = await NatsServer.start(program ?? "");
  const flags = ["--nats", nats.url, "--nats-min-job", "0", "--nats-patience", "1", "--nats-verify", "0.5"];
  const server = await SparringServer.start(flags);
  const { page, problems } = await openPage(browser, server.url, { width: 1440 });
  await visit(page, server.url, "/workers");
  await expect.poll(() => connection(page).textContent()).toMatch(/degraded.*No worker is connected/s);

  const [alpha, beta] = [new WorkerProcess(nats, "alpha"), new WorkerProcess(nats, "beta")];
  await expect.poll(() => connection(page).textContent()).toMatch(/connected.*2 workers do jobs/s);
  await createHeldRun(server, "run", 16, { tasks: ["kessler/survival"] });
  await reportHeldEpisodes(server, "run", 16);
  const done = page.getByRole("region", { name: "Jobs" }).locator("dd").first();
  await expect.poll(async () => parseInt((await done.textContent()) ?? "", 10)).toBeGreaterThan(0);
  const row = (host: string) => page.getByRole("row", { name: new RegExp(`^${host}`) });
  await expect.poll(() => row("alpha").textContent()).toMatch(/active.*prepare, audit, critique/s);
  const verified = page.getByRole("region", { name: "Verified results" }).locator("dd").first();
  await expect.poll(async () => parseInt((await verified.textContent()) ?? "", 10)).toBeGreaterThan(0);
  expect(await page.getByRole("region", { name: "Network" }).textContent()).toMatch(/\d B|KiB per job/);
  await checkBothSchemes(server, "workers-connected", "2 workers do jobs");

  alpha.pause();
  await expect.poll(() => row("alpha").textContent()).toContain("stalled");
  await expect.poll(() => connection(page).textContent()).toContain("1 worker does jobs");
  await Promise.all([alpha.kill(), beta.kill()]);
  await expect.poll(() => connection(page).textContent()).toMatch(/degraded.*does all jobs itself/s);
  await nats.kill();
  await expect.poll(() => connection(page).textContent()).toMatch(/degraded.*(NATS|nats)/s);
  await checkBothSchemes(server, "workers-degraded", "degraded");
  expect(problems).toEqual([]);
  await page.context().close();
  await server.dispose();
  await nats.dispose();
});
