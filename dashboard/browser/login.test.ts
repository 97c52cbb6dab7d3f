/** Checks what the dashboard shows and permits to each role, and without a token. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { launchBrowser, openPage, visit } from "./browser";
import { reportHeldEpisodes, SparringServer } from "./server";

let browser: Browser;
let server: SparringServer;
const tokens: Record<string, string> = {};
beforeAll(async () => {
  [browser, server] = [await launchBrowser(), await SparringServer.start()];
  await server.post("/v1/runs", {
    id: "run",
    seed: 7,
    tasks: ["kessler/survival"],
    design: { designer: "off" },
  });
  await reportHeldEpisodes(server, "run", 8);
  for (const role of ["viewer", "trainer", "admin"]) {
    const output = await server.runCommand(
      "token",
      "create",
      "--db",
      server.databasePath,
      "--role",
      role,
      role,
    );
    tokens[role] = /spk_\S+|sparring_\S+|[A-Za-z0-9_-]{30,}/.exec(output)?.[0] ?? "";
    expect(tokens[role]).not.toBe("");
  }
  await server.kill();
  await server.restart();
});
afterAll(async () => {
  await browser.close();
  await server.dispose();
});

async function logIn(role: string, route = "/") {
  const observed = await openPage(browser, server.url);
  await observed.page.goto(`${server.url}/dashboard/#${route}`);
  await observed.page.getByLabel("Token").fill(tokens[role] ?? "");
  await observed.page.getByRole("button", { name: "Log in" }).click();
  return observed;
}

test("without a token the dashboard shows only the login form", async () => {
  const { page } = await openPage(browser, server.url);
  await page.goto(`${server.url}/dashboard/#/runs/run`);
  await page.getByLabel("Token").fill("nonsense");
  await page.getByRole("button", { name: "Log in" }).click();
  await page.getByRole("alert").waitFor();
  expect(await page.getByRole("button", { name: "Log out" }).count()).toBe(0);
  expect(await page.locator("main").textContent()).not.toContain("survival");
  await page.context().close();
});

test("a viewer sees live data and cannot change anything", async () => {
  const { page } = await logIn("viewer");
  await page.getByRole("article", { name: "run" }).waitFor();
  await page.getByText("You are a viewer").waitFor();
  const pause = page.getByRole("button", { name: "Pause run" });
  expect(await pause.isDisabled()).toBe(true);
  expect(await pause.getAttribute("title")).toMatch(/admin; yours is viewer/);
  expect(await page.getByRole("button", { name: "New run" }).isDisabled()).toBe(true);
  expect((await server.get<{ status: string }>("/v1/runs/run", tokens["viewer"])).status).toBe("active");
  await visit(page, server.url, "/runs/run");
  await page.getByText("live", { exact: true }).waitFor();
  await page.getByRole("button", { name: "Log out" }).click();
  await page.getByLabel("Token").waitFor();
  await page.context().close();
});

test("a trainer can create runs but not manage them", async () => {
  const { page } = await logIn("trainer");
  await page.getByText("You are a trainer").waitFor();
  expect(await page.getByRole("button", { name: "New run" }).isEnabled()).toBe(true);
  expect(await page.getByRole("button", { name: "Archive run" }).isDisabled()).toBe(true);
  await visit(page, server.url, "/runs/run/designs");
  expect(await page.getByRole("button", { name: "Ask", exact: true }).isDisabled()).toBe(true);
  await page.context().close();
});

test("an admin can pause a run", async () => {
  const { page } = await logIn("admin");
  await page.getByText("You are an admin").waitFor();
  await page.getByRole("button", { name: "Pause run" }).click();
  await page.getByRole("button", { name: "Resume run" }).waitFor();
  expect((await server.get<{ status: string }>("/v1/runs/run", tokens["admin"])).status).toBe("paused");
  await page.context().close();
});
