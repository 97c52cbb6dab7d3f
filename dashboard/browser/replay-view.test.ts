/** Checks the page of a replay in all worlds: it fits a screen, and its curves, verdicts, links and address are complete. */
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit, waitUntilIdle } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { createFlownRun, FLOWN_TASKS, GROUP_SIZE } from "./flown-run";
import { checkAccessibility, checkPage } from "./page-checks";

type World = keyof typeof FLOWN_TASKS;
const WORLDS = Object.keys(FLOWN_TASKS) as World[];
/** Median time in which a step must be drawn for 60 frames per second, ms. */
const FRAME_MS = 1000 / 60;

const episodes: Record<World, string[]> = { kessler: [], docking: [], tasking: [] };
const fixture = useFixture(async (server) => {
  for (const world of WORLDS) episodes[world] = await createFlownRun(server, world, FLOWN_TASKS[world], 2);
});

interface Action {
  step: number;
  agent: number;
  verdict: string;
}

const routeOf = (world: World, index: number, query = "") =>
  `/runs/${world}/episodes/${episodes[world][index] ?? ""}${query}`;
const shownStep = (page: Page) => page.locator("output[data-step]").getAttribute("data-step");

/** Returns the name of each part that is not completely in the window. */
async function partsOutside(page: Page): Promise<string[]> {
  const outside: string[] = [];
  const { width, height } = page.viewportSize() ?? { width: 0, height: 0 };
  const parts = {
    picture: page.locator("canvas").first(),
    timeline: page.getByRole("region", { name: "Timeline" }),
    step: page.getByRole("region", { name: /^Step \d+$/ }),
    verdicts: page.getByRole("region", { name: "Failures and verdicts" }),
  };
  for (const [name, part] of Object.entries(parts)) {
    const box = await part.boundingBox();
    if (!box || box.x < 0 || box.y < 0 || box.x + box.width > width || box.y + box.height > height)
      outside.push(name);
  }
  const scroll = await page.evaluate(() => document.documentElement.scrollHeight - innerHeight);
  return scroll > 0 ? [...outside, `${String(scroll)} px below`] : outside;
}

for (const dark of [false, true]) {
  for (const world of WORLDS) {
    test(`${world} fits 1440 × 900 and is accessible (${dark ? "dark" : "light"})`, async () => {
      const observed = await fixture.openPage({ dark, width: 1440, height: 900 });
      const name = `replay-${world}-${dark ? "dark" : "light"}`;
      const route = routeOf(world, 1, "?step=12");
      await checkPage(observed, fixture.server.url, name, { route, text: "Failures and verdicts" });
      expect(await partsOutside(observed.page)).toEqual([]);
      await checkAccessibility(observed, name);
      await visit(observed.page, fixture.server.url, routeOf(world, 1, "?step=12&beside=hold"));
      await expect.poll(() => observed.page.locator("canvas").count()).toBe(2);
      await waitUntilIdle(observed);
      expect(await partsOutside(observed.page), "with a comparison").toEqual([]);
      expect(observed.problems).toEqual([]);
      await observed.page.context().close();
    });
  }
}

test("replays are not wider than a phone", async () => {
  for (const world of WORLDS) {
    const observed = await fixture.openPage({ width: 390, height: 844 });
    const route = routeOf(world, 1, "?step=12&beside=hold");
    await checkPage(observed, fixture.server.url, `replay-${world}-phone`, {
      route,
      text: "Failures and verdicts",
    });
    const overflow = await observed.page.evaluate(
      () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
    );
    expect(overflow, world).toBeLessThanOrEqual(0);
    await observed.page.context().close();
  }
});

test("a picture follows the colour scheme", async () => {
  const { page } = await fixture.openPage();
  await visit(page, fixture.server.url, routeOf("kessler", 1));
  const background = () =>
    page
      .locator("canvas")
      .first()
      .evaluate((canvas) => {
        const ctx = (canvas as HTMLCanvasElement).getContext("2d");
        return ctx?.getImageData(2, 2, 1, 1).data[0] ?? -1;
      });
  await expect.poll(background).toBeGreaterThan(200);
  // From automatic over light to dark.
  for (let i = 0; i < 2; i++) await page.getByRole("button", { name: /Colour scheme/ }).click();
  await expect.poll(background).toBeLessThan(60);
  await page.context().close();
});

test("the curves of agents differ in colour, dashes and labels, and axes have units", async () => {
  const titles = { kessler: "Fuel (units)", docking: "Distance to the chief (m)", tasking: "Battery (%)" };
  const axes = { kessler: "Step (1 TU each)", docking: "Step (1 s each)", tasking: "Time (min)" };
  for (const world of WORLDS) {
    const { page, problems } = await fixture.openPage();
    await visit(page, fixture.server.url, routeOf(world, 0));
    const timeline = page.getByRole("region", { name: "Timeline" });
    const chart = timeline.getByRole("img", { name: titles[world] });
    await chart.waitFor();
    const styles = await chart.locator("path").evaluateAll((paths) =>
      paths.map((path) => {
        const { stroke, strokeDasharray } = getComputedStyle(path);
        return { stroke, strokeDasharray };
      }),
    );
    expect(styles).toHaveLength(3);
    for (const property of ["stroke", "strokeDasharray"] as const)
      expect(new Set(styles.map((style) => style[property])).size, `${world} ${property}`).toBe(3);
    expect(await chart.locator("text.end").allTextContents()).toEqual(["0", "1", "2"]);
    expect((await chart.locator("text.number").allTextContents()).length).toBeGreaterThan(1);
    await timeline.getByText(axes[world]).waitFor();
    expect(problems).toEqual([]);
    await page.context().close();
  }
});

test("links lead to the episodes around an episode and to its group, by keyboard too", async () => {
  const { page, problems } = await fixture.openPage();
  const ids = episodes.kessler;
  await visit(page, fixture.server.url, routeOf("kessler", 1, "?step=9&speed=20"));
  const around = page.getByRole("navigation", { name: "Episodes of the run" });
  const group = page.getByRole("navigation", { name: "Episodes of the group" });
  await expect.poll(() => group.getByRole("link").count()).toBe(GROUP_SIZE);
  expect(await group.locator('[aria-current="page"]').getAttribute("title")).toContain(ids[1]);
  await around.getByRole("link", { name: "Next episode" }).focus();
  await page.keyboard.press("Enter");
  await page.getByRole("heading", { name: ids[2], exact: true }).waitFor();
  // The speed stays, and the step starts again.
  await expect.poll(() => page.url()).toContain(`${ids[2] ?? ""}?step=0&speed=20`);
  await around.getByRole("link", { name: "Previous episode" }).click();
  await page.getByRole("heading", { name: ids[1], exact: true }).waitFor();
  await group.getByRole("link").last().click();
  await page.getByRole("heading", { name: ids[GROUP_SIZE - 1], exact: true }).waitFor();
  // The next episode is in the next group.
  await around.getByRole("link", { name: "Next episode" }).click();
  await page.getByRole("heading", { name: ids[GROUP_SIZE], exact: true }).waitFor();
  expect(await group.locator('[aria-current="page"]').getAttribute("title")).toContain(ids[GROUP_SIZE]);
  await visit(page, fixture.server.url, routeOf("kessler", 0));
  await around.getByText("first episode").waitFor();
  await visit(page, fixture.server.url, routeOf("kessler", ids.length - 1));
  await around.getByText("last episode").waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the address has step, speed, satellite and comparison, and a button copies it", async () => {
  const { page, problems } = await fixture.openPage();
  await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
  await visit(page, fixture.server.url, routeOf("kessler", 1));
  await page.getByRole("slider", { name: "Step", exact: true }).fill("7");
  await page.getByLabel("Speed").selectOption("20 steps/s");
  await page.getByRole("combobox", { name: "Satellite" }).selectOption("1");
  await page.getByLabel("Compare with").selectOption("hold");
  await expect.poll(() => page.url()).toContain("?step=7&speed=20&agent=1&beside=hold");
  await page.getByRole("button", { name: "Copy link" }).click();
  await page.getByRole("status").getByText("Link copied").waitFor();
  const link = await page.evaluate(() => navigator.clipboard.readText());
  expect(link).toBe(page.url());

  const other = await fixture.openPage();
  await other.page.goto(link);
  await expect.poll(() => other.page.locator("canvas").count()).toBe(2);
  expect(await shownStep(other.page)).toBe("7");
  expect(await other.page.getByLabel("Speed").inputValue()).toBe("20");
  const satellite = other.page.getByRole("combobox", { name: "Satellite" });
  expect(await satellite.locator("option:checked").textContent()).toBe("1");
  // The other curves are faint, and the table lists the satellite only.
  expect(await other.page.locator("path.curve.faint").count()).toBe(2);
  const agents = await other.page
    .getByRole("region", { name: "Failures and verdicts" })
    .locator("tbody tr td:nth-child(2)")
    .allTextContents();
  expect(new Set(agents)).toEqual(new Set(agents.length > 0 ? ["1"] : []));
  expect([...problems, ...other.problems]).toEqual([]);
  await other.page.context().close();
  await page.context().close();
});

test("the verdict on an action is shown at its step with its reason", async () => {
  const { page, problems } = await fixture.openPage();
  const [episode = ""] = episodes.kessler;
  const { actions } = await fixture.server.get<{ actions: Action[] }>(
    `/v1/runs/kessler/episodes/${episode}/critique`,
  );
  const action = actions[0];
  if (!action) throw new Error("no action has a verdict");
  await visit(page, fixture.server.url, routeOf("kessler", 0));
  const table = page.getByRole("region", { name: "Failures and verdicts" });
  const row = table.getByRole("row").filter({ hasText: action.verdict }).first();
  await row.getByRole("button").focus();
  await page.keyboard.press("Enter");
  await expect.poll(() => shownStep(page)).toBe(String(action.step));
  const item = page
    .getByRole("region", { name: `Step ${String(action.step)}`, exact: true })
    .locator(`li[data-verdict="${action.verdict}"]`);
  const reason = (await row.getByRole("cell").nth(3).textContent()) ?? "";
  expect(reason.length).toBeGreaterThan(10);
  const text = ((await item.textContent()) ?? "").replace(/\s+/g, " ");
  expect(text).toContain(reason);
  expect(text).toContain(`satellite ${String(action.agent)}`);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the keyboard reaches every control of a replay", async () => {
  const { page } = await fixture.openPage();
  await visit(page, fixture.server.url, routeOf("kessler", 1));
  const reached = new Set<string>();
  for (let i = 0; i < 70; i++) {
    await page.keyboard.press("Tab");
    reached.add(
      await page.evaluate(() => {
        const focused = document.activeElement;
        const label = focused?.closest("label")?.firstChild?.textContent?.trim();
        return focused?.getAttribute("aria-label") ?? label ?? focused?.textContent.trim() ?? "";
      }),
    );
  }
  for (const name of [
    "Previous episode",
    "Next episode",
    "Legend",
    "Copy link",
    "PNG",
    "GIF",
    "Play",
    "Next step",
    "Speed",
    "satellite",
    "Compare with",
    "Trail (steps)",
    "Step",
  ])
    expect(
      [...reached].some((label) => label.includes(name)),
      name,
    ).toBe(true);
  await page.context().close();
});

test("scrubbing a replay of 200 debris draws a step within a frame", async () => {
  const levels = { columns: ["debris"], rows: Array.from({ length: 10 }, () => [200]) };
  const settings = { task_settings: { "kessler/survival": { levels } } };
  const [crowded = ""] = await createHeldRun(fixture.server, "crowded", 1, settings);
  const { page, problems } = await fixture.openPage({ width: 1440, height: 900 });
  await visit(page, fixture.server.url, `/runs/crowded/episodes/${crowded}`);
  await page.getByRole("region", { name: "Timeline" }).waitFor();
  // Times the page itself: the reaction to an input, and the drawing of all that it put on the canvas.
  const times = await page.evaluate(async () => {
    const slider = document.querySelector<HTMLInputElement>('input[aria-label="Step"]');
    const canvas = document.querySelector("canvas");
    const ctx = canvas?.getContext("2d");
    if (!slider || !ctx) return [];
    const measured: number[] = [];
    for (let k = 0; k < 150; k++) {
      await new Promise(requestAnimationFrame);
      const start = performance.now();
      slider.value = String(1 + (k % (Number(slider.max) - 1)));
      slider.dispatchEvent(new Event("input", { bubbles: true }));
      await new Promise((resolve) => queueMicrotask(() => resolve(null)));
      ctx.getImageData(0, 0, 1, 1); // waits until the canvas is drawn
      measured.push(performance.now() - start);
    }
    return measured;
  });
  const sorted = times.toSorted((a, b) => a - b);
  const [median = Infinity, slowest = Infinity] = [sorted[75], sorted[135]];
  console.log(`200 debris: median ${median.toFixed(1)} ms, 90 % quantile ${slowest.toFixed(1)} ms`);
  const { frames } = await fixture.server.get<{ frames: { state: { radar_debris: unknown[] } }[] }>(
    `/v1/runs/crowded/episodes/${crowded}/replay`,
  );
  expect(frames[0]?.state.radar_debris.length).toBe(200);
  expect(median).toBeLessThan(FRAME_MS);
  expect(problems).toEqual([]);
  await page.context().close();
});
