/** Checks what the dashboard shows and permits to each role, and without a token. */
import { expect, test } from "vitest";
import { visit } from "./browser";
import { createHeldRun, useFixture } from "./fixture";

const tokens: Record<string, string> = {};
const fixture = useFixture(async (server) => {
  await createHeldRun(server, "run", 8);
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

async function logIn(role: string, route = "/") {
  const observed = await fixture.openPage();
  await observed.page.goto(`${fixture.server.url}/dashboard/#${route}`);
  await observed.page.getByLabel("Token").fill(tokens[role] ?? "");
  await observed.page.getByRole("button", { name: "Log in" }).click();
  return observed;
}

test("without a token the dashboard shows only the login form", async () => {
  const { page } = await fixture.openPage();
  await page.goto(`${fixture.server.url}/dashboard/#/runs/run`);
  await page.getByLabel("Token").fill("nonsense");
  await page.getByRole("button", { name: "Log in" }).click();
  await page.getByRole("alert").waitFor();
  expect(await page.getByRole("button", { name: "Log out" }).count()).toBe(0);
  expect(await page.locator("main").textContent()).not.toContain("survival");
  await page.context().close();
});

test("a late response without a token does not log the user out", async () => {
  const { page } = await fixture.openPage();
  let release = () => {};
  const hasLoggedIn = new Promise<void>((resolve) => (release = resolve));
  await page.route("**/v1/alerts*", async (route, request) => {
    if (!(await request.allHeaders())["authorization"]) await hasLoggedIn;
    await route.continue();
  });
  const lateResponse = page.waitForResponse(
    (response) => response.url().includes("/v1/alerts") && response.status() === 401,
  );
  await page.goto(`${fixture.server.url}/dashboard/#/`);
  await page.getByLabel("Token").fill(tokens["viewer"] ?? "");
  await page.getByRole("button", { name: "Log in" }).click();
  await page.getByText("Role: viewer").waitFor();
  release();
  await (await lateResponse).finished();
  await page.getByRole("link", { name: "Server" }).click();
  await page.getByText("Role: viewer").waitFor();
  expect(await page.getByLabel("Token").count()).toBe(0);
  await page.context().close();
});

test("the role is read again after an error of the server", async () => {
  const { page } = await fixture.openPage();
  let errors = 0;
  await page.route("**/v1/audit*", async (route) => {
    errors += 1;
    if (errors === 1) await route.fulfill({ status: 503, json: { detail: "overloaded" } });
    else await route.continue();
  });
  await page.goto(`${fixture.server.url}/dashboard/#/`);
  await page.getByLabel("Token").fill(tokens["viewer"] ?? "");
  await page.getByRole("button", { name: "Log in" }).click();
  await page.getByText("Role: viewer").waitFor();
  expect(errors).toBe(2);
  await page.context().close();
});

test("a viewer sees live data and cannot change anything", async () => {
  const { page } = await logIn("viewer");
  await page.getByRole("rowheader", { name: "run" }).waitFor();
  await page.getByText("Role: viewer").waitFor();
  const pause = page.getByRole("button", { name: "Pause run" });
  expect(await pause.isDisabled()).toBe(true);
  expect(await pause.getAttribute("title")).toMatch(/admin; yours is viewer/);
  expect(await page.getByRole("button", { name: "New run" }).isDisabled()).toBe(true);
  expect((await fixture.server.get<{ status: string }>("/v1/runs/run", tokens["viewer"])).status).toBe(
    "active",
  );
  await visit(page, fixture.server.url, "/runs/run");
  await page.getByText("live", { exact: true }).waitFor();
  await page.getByRole("button", { name: "Log out" }).click();
  await page.getByLabel("Token").waitFor();
  await page.context().close();
});

test("a trainer can create runs but not manage them", async () => {
  const { page } = await logIn("trainer");
  await page.getByText("Role: trainer").waitFor();
  expect(await page.getByRole("button", { name: "New run" }).isEnabled()).toBe(true);
  expect(await page.getByRole("button", { name: "Pause run" }).isDisabled()).toBe(true);
  await visit(page, fixture.server.url, "/runs/run/designs");
  expect(await page.getByRole("button", { name: "Request", exact: true }).isDisabled()).toBe(true);
  await page.context().close();
});

test("an admin can pause a run", async () => {
  const { page } = await logIn("admin");
  await page.getByText("Role: admin").waitFor();
  await page.getByRole("button", { name: "Pause run" }).click();
  await page.getByRole("button", { name: "Resume run" }).waitFor();
  expect((await fixture.server.get<{ status: string }>("/v1/runs/run", tokens["admin"])).status).toBe(
    "paused",
  );
  await page.context().close();
});
