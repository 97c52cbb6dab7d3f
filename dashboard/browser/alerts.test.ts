/** Checks the page of alerts: what lasts, what ended, what the webhook knows, and the number in the menu. */
import { createServer, type Server } from "node:http";
import type { AddressInfo } from "node:net";
import { afterAll, beforeAll, expect, test } from "vitest";
import type { Browser } from "playwright-core";
import { launchBrowser, openPage, visit } from "./browser";
import { checkAccessibility, checkPage } from "./page-checks";
import { SparringServer } from "./server";

/** More than any disk has, MiB: the alert begins with the server. */
const LOW_DISK = "low_disk=1000000000";

let browser: Browser;
let server: SparringServer;
let receiver: Server;
const messages: { rule: string; state: string }[] = [];

beforeAll(async () => {
  receiver = createServer((request, response) => {
    let body = "";
    request.on("data", (part: Buffer) => (body += part.toString()));
    request.on("end", () => {
      messages.push(JSON.parse(body) as (typeof messages)[number]);
      response.end();
    });
  });
  await new Promise<void>((resolve) => receiver.listen(0, "127.0.0.1", resolve));
  const { port } = receiver.address() as AddressInfo;
  const environment = { SPARRING_ALERT_WEBHOOK: `http://127.0.0.1:${String(port)}/hook` };
  [browser, server] = [
    await launchBrowser(),
    await SparringServer.start(["--alerts", LOW_DISK], environment),
  ];
});

afterAll(async () => {
  await browser.close();
  await server.dispose();
  receiver.close();
});

test("an alert that lasts is in the menu and the list, and the webhook knows it", async () => {
  const { page, problems } = await openPage(browser, server.url);
  await visit(page, server.url, "/");
  const entry = page.getByRole("navigation", { name: "Main" }).getByRole("link", { name: /^Alerts/ });
  await expect.poll(() => entry.textContent(), { timeout: 30_000 }).toMatch(/^Alerts\s*1$/);
  await entry.press("Enter");
  await page.getByRole("heading", { name: "Alerts" }).waitFor();
  const row = page.getByRole("row", { name: /Disk nearly full.*MiB left/ });
  await expect.poll(() => row.textContent(), { timeout: 30_000 }).toMatch(/server.*MiB left.*lasts.*sent/s);
  // The page lists the rules of the server with their limits.
  await page.getByRole("row", { name: /Disk nearly full.*less than [\d]+ MiB/ }).waitFor();
  await page.getByText("A webhook receives a message").waitFor();
  expect(messages).toMatchObject([{ rule: "low_disk", state: "began" }]);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the page of alerts is accessible in both colour schemes and fits a phone", async () => {
  for (const dark of [false, true]) {
    const observed = await openPage(browser, server.url, { dark });
    await checkPage(observed, server.url, `alerts-${dark ? "dark" : "light"}`, {
      route: "/alerts",
      text: "MiB left",
    });
    await checkAccessibility(observed, "alerts");
    await observed.page.setViewportSize({ width: 390, height: 844 });
    const width = await observed.page.evaluate(() => document.documentElement.scrollWidth);
    expect(width).toBeLessThanOrEqual(390);
    await observed.page.context().close();
  }
});

test("an alert that ended is left out on request", async () => {
  await server.kill();
  await server.dispose();
  server = await SparringServer.start(["--alerts", "none"]);
  const { page } = await openPage(browser, server.url);
  await visit(page, server.url, "/alerts");
  await page.getByText("There are no alerts.").waitFor();
  await page.getByText("All rules are off.").waitFor();
  await page.getByText("No webhook receives messages").waitFor();
  await page.getByLabel("Only alerts that last").check();
  await page.getByText("No alert lasts.").waitFor();
  await page.context().close();
});
