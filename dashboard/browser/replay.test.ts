/** Checks the replay of a known episode: the agents hold in the first scenario of seed 7 that loses a satellite. */
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import type { Lease } from "./server";

interface Frame {
  step: number;
  state: { satellites: { id: number; x: number; y: number; status: string }[] };
}

/** First of 64 episodes that loses a satellite, with the step and the satellite; the same on every machine. */
const KNOWN = { index: 2, step: 25, satellite: 1 };

let episode: string;
let frames: Frame[];
const fixture = useFixture(async (server) => {
  const episodes = await createHeldRun(server, "run", 64, { strategy: "fixed" });
  for (const [index, id] of episodes.entries()) {
    ({ frames } = await server.get<{ frames: Frame[] }>(`/v1/runs/run/episodes/${id}/replay`));
    const lost = frames.at(-1)?.state.satellites.find(({ status }) => status !== "active");
    if (!lost) continue;
    const step = frames.findIndex((frame) => frame.state.satellites[lost.id]?.status !== "active");
    expect({ index, step, satellite: lost.id }).toEqual(KNOWN);
    episode = id;
    return;
  }
  throw new Error("no episode lost a satellite");
});

/** Counts the pixels in a square of 24 px around a position (in LU) that have about this colour. */
async function countPixels(page: Page, x: number, y: number, colour: string): Promise<number> {
  return page.evaluate(
    ([x, y, name]) => {
      const canvas = document.querySelector("canvas");
      const ctx = canvas?.getContext("2d");
      if (!canvas || !ctx) return -1;
      const probe = document.createElement("canvas").getContext("2d");
      if (!probe) return -1;
      probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name as string);
      probe.fillRect(0, 0, 1, 1);
      const [r = 0, g = 0, b = 0] = probe.getImageData(0, 0, 1, 1).data;
      const scale = canvas.width / 236; // 118 LU from the middle to the edge
      const [left, top] = [
        canvas.width / 2 + (x as number) * scale - 12,
        canvas.height / 2 - (y as number) * scale - 12,
      ];
      const { data } = ctx.getImageData(left, top, 24, 24);
      let count = 0;
      for (let i = 0; i < data.length; i += 4) {
        if (
          Math.abs((data[i] ?? 0) - r) + Math.abs((data[i + 1] ?? 0) - g) + Math.abs((data[i + 2] ?? 0) - b) <
          30
        )
          count++;
      }
      return count;
    },
    [x, y, colour],
  );
}

test("a contact is shown at its step and not before", async () => {
  const { page, problems } = await fixture.openPage();
  await visit(page, fixture.server.url, `/runs/run/episodes/${episode}?step=${String(KNOWN.step - 1)}`);
  const satellite = page.locator(`[data-satellite="${String(KNOWN.satellite)}"]`);
  await page.locator(`output[data-step="${String(KNOWN.step - 1)}"]`).waitFor();
  expect(await satellite.getAttribute("data-status")).toBe("active");
  const position = frames[KNOWN.step]?.state.satellites[KNOWN.satellite];
  if (!position) throw new Error("no such frame");
  await page.keyboard.press("ArrowRight");
  await page.locator(`output[data-step="${String(KNOWN.step)}"]`).waitFor();
  expect(await satellite.getAttribute("data-status")).toBe("destroyed");
  // A cross marks the contact: two strokes of 12 px, 2 px wide.
  await expect.poll(() => countPixels(page, position.x, position.y, "--bad")).toBeGreaterThan(20);
  await page.keyboard.press("ArrowLeft");
  await page.locator(`output[data-step="${String(KNOWN.step - 1)}"]`).waitFor();
  expect(await satellite.getAttribute("data-status")).toBe("active");
  await expect.poll(() => page.url()).toContain(`step=${String(KNOWN.step - 1)}`);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("a replay plays, pauses and is compared with the reference", async () => {
  const { page, problems } = await fixture.openPage();
  await page.clock.install();
  await visit(page, fixture.server.url, `/runs/run/episodes/${episode}?step=0`);
  await page.getByLabel("Speed").selectOption("20 steps/s");
  await page.getByRole("button", { name: "Play", exact: true }).click();
  await expect
    .poll(async () => Number(await page.locator("output[data-step]").getAttribute("data-step")))
    .toBeGreaterThan(5);
  await page.getByRole("button", { name: "Pause" }).click();
  const pausedAt = await page.locator("output[data-step]").getAttribute("data-step");
  // At 20 steps/s a replay that is not paused would advance by 6 steps.
  await page.clock.runFor(300);
  expect(await page.locator("output[data-step]").getAttribute("data-step")).toBe(pausedAt);
  await page.getByLabel("Compare with").selectOption("reference");
  await expect.poll(() => page.locator("canvas").count()).toBe(2);
  await page.locator("h2").first().click(); // moves the focus, so that keys do not change the select box
  await page.keyboard.press("End");
  const statusIn = (figure: number) =>
    page
      .locator("figure")
      .nth(figure)
      .locator(`[data-satellite="${String(KNOWN.satellite)}"]`)
      .getAttribute("data-status");
  await expect.poll(() => statusIn(0)).toBe("destroyed");
  expect(await statusIn(1)).toBe("active"); // the reference planner saves it
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the reference plan is shown when no group of the scenario is open", async () => {
  const { server } = fixture;
  const settings = { tasks: ["kessler/survival"], design: { designer: "off" }, seed: 8 };
  await server.post("/v1/runs", { ...settings, id: "open", group_size: 2 });
  const lease = await server.post<Lease>("/v1/runs/open/leases", { groups: 1 });
  const [first = "", second = ""] = lease.groups[0]?.episodes ?? [];
  const report = (id: string) =>
    server.post("/v1/runs/open/results", {
      results: [{ episode: id, actions: { steps: [], stopped: "too_late" } }],
    });
  await report(first);
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, `/runs/open/episodes/${first}?step=0&beside=reference`);
  const reason = "Run open has an open group of this scenario";
  await page.getByRole("status").getByText(reason).waitFor();
  await page.getByText(`Avoiding actions are not shown: ${reason}`).waitFor();
  expect(await page.locator("canvas").count()).toBe(1);
  await report(second);
  await page.reload();
  await expect.poll(() => page.locator("canvas").count()).toBe(2);
  expect(await page.getByText(reason).count()).toBe(0);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the page of a run with a used seed says so", async () => {
  const { server } = fixture;
  const settings = { tasks: ["docking/single"], design: { designer: "off" }, seed: 9 };
  await server.post("/v1/runs", { ...settings, id: "earlier" });
  await server.post("/v1/runs", { ...settings, id: "later" });
  await server.post("/v1/runs", { ...settings, id: "other", seed: 10 });
  const { page, problems } = await fixture.openPage();
  const note = page.getByText("Another run has or had the same seed (9)");
  await visit(page, server.url, "/runs/later");
  await note.waitFor();
  await visit(page, server.url, "/runs/earlier");
  await note.waitFor();
  await visit(page, server.url, "/runs/other");
  await page.getByText("No episodes yet").waitFor();
  // The page keeps the run before it until the new one is loaded.
  await expect.poll(() => note.count()).toBe(0);
  expect(problems).toEqual([]);
  await page.context().close();
});
