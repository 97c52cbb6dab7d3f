/** With tokens: nobody sees anything without one, a viewer sees, an admin acts. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { go, launch, open } from "./browser";
import { hold, Sparring } from "./sparring";

let browser: Browser;
let service: Sparring;
const tokens: Record<string, string> = {};
beforeAll(async () => {
  [browser, service] = [await launch(), await Sparring.start()];
  await service.post("/v1/runs", {
    id: "run",
    seed: 7,
    tasks: ["kessler/survival"],
    design: { designer: "off" },
  });
  await hold(service, "run", 8);
  for (const role of ["viewer", "trainer", "admin"]) {
    const told = await service.run("token", "create", "--db", service.db, "--role", role, role);
    tokens[role] = /spk_\S+|sparring_\S+|[A-Za-z0-9_-]{30,}/.exec(told)?.[0] ?? "";
    expect(tokens[role]).not.toBe("");
  }
  await service.kill();
  await service.again();
});
afterAll(async () => {
  await browser.close();
  await service.end();
});

async function enter(role: string, place = "/") {
  const watched = await open(browser, service.url);
  await watched.page.goto(`${service.url}/dashboard/#${place}`);
  await watched.page.getByLabel("Token").fill(tokens[role] ?? "");
  await watched.page.getByRole("button", { name: "Log in" }).click();
  return watched;
}

test("without a token there is nothing to see, and a wrong one is told", async () => {
  const { page } = await open(browser, service.url);
  await page.goto(`${service.url}/dashboard/#/runs/run`);
  await page.getByLabel("Token").fill("nonsense");
  await page.getByRole("button", { name: "Log in" }).click();
  await page.getByRole("alert").waitFor();
  expect(await page.getByRole("button", { name: "Log out" }).count()).toBe(0);
  expect(await page.locator("main").textContent()).not.toContain("survival");
  await page.context().close();
});

test("a viewer sees, live too, and may not act", async () => {
  const { page } = await enter("viewer");
  await page.getByRole("article", { name: "run" }).waitFor();
  await page.getByText("You are a viewer").waitFor();
  const pause = page.getByRole("button", { name: "Pause run" });
  expect(await pause.isDisabled()).toBe(true);
  expect(await pause.getAttribute("title")).toMatch(/admin; yours is viewer/);
  expect(await page.getByRole("button", { name: "New run" }).isDisabled()).toBe(true);
  expect((await service.get<{ status: string }>("/v1/runs/run", tokens["viewer"])).status).toBe("active");
  await go(page, service.url, "/runs/run");
  await page.getByText("live", { exact: true }).waitFor();
  await page.getByRole("button", { name: "Log out" }).click();
  await page.getByLabel("Token").waitFor();
  await page.context().close();
});

test("a trainer begins, and leaves the steering to others", async () => {
  const { page } = await enter("trainer");
  await page.getByText("You are a trainer").waitFor();
  expect(await page.getByRole("button", { name: "New run" }).isEnabled()).toBe(true);
  expect(await page.getByRole("button", { name: "Archive run" }).isDisabled()).toBe(true);
  await go(page, service.url, "/runs/run/designs");
  expect(await page.getByRole("button", { name: "Ask", exact: true }).isDisabled()).toBe(true);
  await page.context().close();
});

test("an admin acts", async () => {
  const { page } = await enter("admin");
  await page.getByText("You are an admin").waitFor();
  await page.getByRole("button", { name: "Pause run" }).click();
  await page.getByRole("button", { name: "Resume run" }).waitFor();
  expect((await service.get<{ status: string }>("/v1/runs/run", tokens["admin"])).status).toBe("paused");
  await page.context().close();
});
