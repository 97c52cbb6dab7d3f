/** Checks the views of tasking: actions by buttons, the map, gauges, actions over time, and a replay by seconds. */
import { mkdirSync } from "node:fs";
import { expect, test } from "vitest";
import { visit } from "./browser";
import { useFixture } from "./fixture";
import type { Lease } from "./server";

/** Folder of screenshots for people to look at; none are made without it. */
const PICTURES = process.env["SPARRING_SCREENSHOTS"];
const TASK = "tasking/constellation";

let episode = "";
const fixture = useFixture(async (server) => {
  await server.post("/v1/runs", {
    id: "run",
    seed: 5,
    tasks: [TASK],
    design: { designer: "off" },
    group_size: 1,
    placement: false,
    strategy: "fixed",
  });
  const { groups } = await server.post<Lease>("/v1/runs/run/leases", { groups: 1 });
  episode = groups[0]?.episodes[0] ?? "";
  // All satellites charge, and image now and then. They hold after the last step of the log.
  const step = (k: number) => [0, 1, 2].map((agent) => [agent, k % 5 === 4 ? agent : 10]);
  const steps = Array.from({ length: 70 }, (_, k) => step(k));
  await server.post("/v1/runs/run/results", {
    results: [{ episode, actions: { steps, stopped: "too_late" } }],
  });
});

test("buttons give actions, and busy satellites have none", async () => {
  const { page, problems } = await fixture.openPage();
  await visit(page, fixture.server.url, `/play?task=${TASK}&seed=7&level=0`);
  const group = (agent: number) => page.locator(`fieldset[data-agent="${String(agent)}"]`);
  await group(0).getByRole("button", { name: "charge" }).click();
  expect(await group(0).getByRole("button", { name: "charge" }).getAttribute("aria-pressed")).toBe("true");
  await group(1)
    .getByRole("button", { name: /image 0: priority/ })
    .click();
  await page.locator('output[data-step="1"]').waitFor();
  // Only the satellite that has finished needs an action.
  const waiting = await page.locator("fieldset:not([disabled])").count();
  expect(waiting).toBe(1);
  expect(await page.locator("fieldset[disabled] legend").textContent()).toContain("busy with");
  expect(await page.getByRole("meter", { name: "battery of satellite 0" }).count()).toBe(1);
  await page.getByRole("button", { name: "Undo step" }).click();
  await page.locator('output[data-step="0"]').waitFor();
  await page.getByRole("button", { name: "Go on" }).click();
  await page.locator('output[data-step="1"]').waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

for (const theme of ["light", "dark"] as const) {
  test(`a replay moves by seconds (${theme})`, async () => {
    const { page, problems } = await fixture.openPage({ dark: theme === "dark" });
    await visit(page, fixture.server.url, `/runs/run/episodes/${episode}`);
    const slider = page.getByRole("slider", { name: "Time" });
    await slider.waitFor();
    await slider.fill("5000");
    await page.getByText(/1 h 23 min of \d h/).waitFor();
    const row = page.locator('tr[data-satellite="0"]');
    const before = await row.textContent();
    await slider.fill("6200");
    await expect.poll(() => row.textContent()).not.toBe(before);
    expect(await page.locator("rect.charge").count()).toBeGreaterThan(3);
    expect(await page.locator("rect.eclipse").count()).toBeGreaterThan(1);
    await page.getByLabel("Compare with").selectOption("hold");
    await expect.poll(() => page.locator("canvas").count()).toBe(2);
    if (PICTURES) {
      mkdirSync(PICTURES, { recursive: true });
      await page.screenshot({ path: `${PICTURES}/tasking-${theme}.png`, fullPage: true });
    }
    expect(problems).toEqual([]);
    await page.context().close();
  });
}
