/** Checks the page for manual flights: burns are edited by mouse and keyboard, and steps are undone. */
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, inject, test } from "vitest";
import { launchBrowser, openPage, waitUntilIdle, waitUntilLoaded } from "./browser";

let browser: Browser;
const url = inject("url");
beforeAll(async () => {
  browser = await launchBrowser();
});
afterAll(() => browser.close());

test("a dragged burn shows its cost, is executed and undone", async () => {
  const observed = await openPage(browser, url);
  const { page, problems } = observed;
  await page.goto(`${url}/web/#/play?task=kessler/survival&seed=7&level=2`);
  await waitUntilLoaded(page);
  await page.locator("canvas").waitFor();
  await waitUntilIdle(observed); // the canvas has its final position
  const postFlight = (steps: unknown[]) =>
    fetch(`${url}/v1/rollouts`, {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({ scenario, steps }),
    });
  const scenario = {
    task: "kessler/survival",
    seed: 7,
    params: { debris: 50, spread: 0.4, fuel: 50, radar_range: 300 },
  };
  interface FlightResponse {
    frames: { observation: { satellites: { x: number; y: number; vx: number; fuel: number }[] } }[];
  }
  const [first] = ((await (await postFlight([])).json()) as FlightResponse).frames;
  const satellite = first?.observation.satellites[0];
  const box = await page.locator("canvas").boundingBox();
  if (!satellite || !box) throw new Error("no satellite to drag");
  const scale = box.width / 236;
  const [x, y] = [box.x + box.width / 2 + satellite.x * scale, box.y + box.height / 2 - satellite.y * scale];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 11 * scale, y, { steps: 4 }); // half of the 22 LU that stand for 1 LU/TU
  await page.mouse.up();
  const deltaVx = page.getByLabel("delta vx of agent 0");
  expect(Number(await deltaVx.inputValue())).toBeCloseTo(0.5, 1);
  const dv = [
    Number(await deltaVx.inputValue()),
    Number(await page.getByLabel("delta vy of agent 0").inputValue()),
  ];
  const cost = await page.locator('[data-agent="0"] td').last().textContent();
  expect(Number(cost)).toBeCloseTo(5 * Math.hypot(...dv), 1);
  await page.getByRole("button", { name: "Execute" }).click();
  await page.locator('output[data-step="1"]').waitFor();
  const after = ((await (await postFlight([[[0, ...dv]]])).json()) as FlightResponse).frames.at(-1)
    ?.observation.satellites[0];
  expect(Number(await page.locator('[data-agent="0"] td').nth(2).textContent())).toBeCloseTo(
    after?.fuel ?? NaN,
    1,
  );
  expect(after?.fuel).toBeCloseTo(50 - 5 * Math.hypot(...dv), 6);
  await page.getByRole("button", { name: "Undo step" }).click();
  await page.locator('output[data-step="0"]').waitFor();
  await page.getByText("1 step undone").waitFor();
  await page.getByRole("spinbutton", { name: "for steps" }).fill("50");
  await page.getByRole("button", { name: "Hold" }).click();
  await page.getByText("Episode ended.").waitFor();
  await page.getByText(/Score 0\.\d+, skill .*: (success|no success), with undone steps/).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("a typed burn shows its cost and is rejected over the limit", async () => {
  const { page, problems } = await openPage(browser, url);
  await page.goto(`${url}/dashboard/#/play?task=kessler/survival&seed=7&level=2`);
  const burn = page.getByLabel("delta vx of agent 0");
  await burn.focus();
  await page.keyboard.press("ControlOrMeta+a");
  await page.keyboard.type("0.5");
  expect(await burn.inputValue()).toBe("0.5");
  expect(await page.locator('[data-agent="0"] td').last().textContent()).toBe("2.50");
  await page.keyboard.press("ControlOrMeta+a");
  await page.keyboard.type("1.5");
  await page.getByText("each number must be from -1 to 1").waitFor();
  expect(await page.getByRole("button", { name: "Execute" }).isDisabled()).toBe(true);
  await page.getByRole("button", { name: "Clear burns" }).click();
  expect(await burn.inputValue()).toBe("0");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the address holds the scenario until the page is left", async () => {
  const observed = await openPage(browser, url);
  const { page, problems } = observed;
  await page.clock.install();
  await page.goto(`${url}/dashboard/#/play`);
  await page.locator("canvas").waitFor();
  await expect.poll(() => page.url()).toMatch(/#\/play\?task=kessler\/survival&level=2&seed=\d+$/);
  await page.getByRole("link", { name: "Runs" }).click();
  await page.getByRole("heading", { name: "Runs" }).waitFor();
  // A late update of the address would bring the scenario back.
  await waitUntilIdle(observed);
  await page.clock.runFor(500);
  expect(page.url()).toMatch(/#\/$/);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the OpenEnv address opens the page for manual flights", async () => {
  const { page, problems } = await openPage(browser, url);
  await page.goto(`${url}/web/`);
  await page.getByRole("heading", { name: "Manual control" }).waitFor();
  expect((await fetch(`${url}/web/metadata`)).status).toBe(200);
  expect(problems).toEqual([]);
  await page.context().close();
});
