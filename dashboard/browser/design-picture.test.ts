/** Checks the picture of a design in all worlds: what it draws besides the episode, its legend, and the reference plan. */
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { SCREENSHOT_FOLDER, visit } from "./browser";
import { useFixture } from "./fixture";
import { checkAccessibility, checkPage } from "./page-checks";
import { waitFor } from "./poll";
import { reportHeldEpisodes, type SparringServer } from "./server";

interface DesignPage {
  designs: { id: string; results: { episodes: number } }[];
}
interface DesignRequests {
  requests: { state: string }[];
}
interface Failures {
  tasks: { criticised: number }[];
}
interface KesslerDesign {
  design: { aim: { bearing_deg: number | null }; encounters: { kind: string; rogue: boolean }[] };
  episodes: string[];
}

/** Runs with designs: their task, and the number of groups whose episodes the designer learns from. */
const RUNS = {
  kessler: { task: "kessler/survival", groups: 128 },
  docking: { task: "docking/multiagent", groups: 64 },
  tasking: { task: "tasking/imaging", groups: 8 },
};
type World = keyof typeof RUNS;
const WORLDS = Object.keys(RUNS) as World[];

const layouts: Record<World, string[]> = { kessler: [], docking: [], tasking: [] };
const fixture = useFixture(async (server) => {
  for (const world of WORLDS) layouts[world] = await requestDesigns(server, world);
});

/** Creates a run whose agents held, and requests designs. Returns the ids of the active ones, newest first. */
async function requestDesigns(server: SparringServer, world: World): Promise<string[]> {
  const { task, groups } = RUNS[world];
  await server.post("/v1/runs", { id: world, seed: 3, tasks: [task], design: { share: 0 } });
  await waitFor(
    () => reportHeldEpisodes(server, world, groups).catch(() => null), // not ready: a status of 503
    (reported) => reported !== null,
  );
  await waitFor(
    () => server.get<Failures>(`/v1/runs/${world}/failure_profiles`),
    ({ tasks }) => (tasks[0]?.criticised ?? 0) >= Math.min(groups, 8),
  );
  await server.post(`/v1/runs/${world}/designs`, { count: 4, designer: "procedural" });
  await waitFor(
    () => server.get<DesignRequests>(`/v1/runs/${world}/designs/requests`),
    ({ requests }) => requests.every(({ state }) => state === "done" || state === "failed"),
  );
  const { designs } = await server.get<DesignPage>(`/v1/runs/${world}/designs?state=active`);
  expect(designs.length, world).toBeGreaterThan(0);
  return designs.map(({ id }) => id);
}

const routeOf = (world: World, layout: string | undefined) => `/runs/${world}/designs/${layout ?? ""}`;
const picture = (page: Page) => page.getByRole("region", { name: "Picture of the design" });

/** Counts the pixels of the picture that have about the colour of the style sheet. */
async function countPixels(page: Page, colour: string): Promise<number> {
  return page.evaluate((name) => {
    const canvas = document.querySelector("canvas");
    const ctx = canvas?.getContext("2d");
    const probe = document.createElement("canvas").getContext("2d");
    if (!canvas || !ctx || !probe) return -1;
    probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name);
    probe.fillRect(0, 0, 1, 1);
    const [r = 0, g = 0, b = 0] = probe.getImageData(0, 0, 1, 1).data;
    const { data } = ctx.getImageData(0, 0, canvas.width, canvas.height);
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      const off =
        Math.abs((data[i] ?? 0) - r) + Math.abs((data[i + 1] ?? 0) - g) + Math.abs((data[i + 2] ?? 0) - b);
      if (off < 30) count++;
    }
    return count;
  }, colour);
}

for (const dark of [false, true]) {
  test(`the pictures of all worlds have a legend and are accessible (${dark ? "dark" : "light"})`, async () => {
    const texts = {
      kessler: "encounter, with its number and step",
      docking: "velocity at the start",
      tasking: "Sun overhead at the start",
    };
    for (const world of WORLDS) {
      const observed = await fixture.openPage({ dark, width: 1440, height: 900 });
      const name = `design-${world}-${dark ? "dark" : "light"}`;
      const route = routeOf(world, layouts[world][0]);
      await checkPage(observed, fixture.server.url, name, { route, text: texts[world] });
      await checkAccessibility(observed, name);
      await observed.page.context().close();
      const phone = await fixture.openPage({ dark, width: 390, height: 844 });
      await checkPage(phone, fixture.server.url, `${name}-phone`, { route, text: texts[world] });
      const overflow = await phone.page.evaluate(
        () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
      );
      expect(overflow, name).toBeLessThanOrEqual(0);
      await phone.page.context().close();
    }
  });
}

test("a kessler design shows the paths of its debris, its encounters and its aim", async () => {
  const { page, problems } = await fixture.openPage({ width: 1440, height: 900 });
  for (const layout of layouts.kessler) {
    const { design } = await fixture.server.get<KesslerDesign>(`/v1/runs/kessler/designs/${layout}`);
    await visit(page, fixture.server.url, routeOf("kessler", layout));
    const legend = picture(page).getByRole("list", { name: "Legend" });
    await legend.waitFor();
    const insets = picture(page).locator("li", { hasText: /satellite \d, step \d+/ });
    // The page shows the layout before it until the new one is loaded.
    await page.getByText(`${layout} ·`).waitFor();
    await expect.poll(() => insets.count()).toBe(Math.min(8, design.encounters.length));
    const entries = (await legend.getByRole("listitem").allTextContents()).map((entry) => entry.trim());
    const has = (text: string) => entries.some((entry) => entry.startsWith(text));
    for (const kind of ["threat", "decoy", "screen"]) {
      const of = design.encounters.filter((encounter) => encounter.kind === kind);
      expect(has(`${kind}: debris`), kind).toBe(of.some(({ rogue }) => !rogue));
      expect(has(`rogue ${kind}`), kind).toBe(of.some(({ rogue }) => rogue));
    }
    expect(has("sector of bearings")).toBe(design.aim.bearing_deg !== null);
    if (design.encounters.some(({ kind }) => kind === "threat"))
      await expect.poll(() => countPixels(page, "--bad")).toBeGreaterThan(100);
    if (design.aim.bearing_deg !== null) expect(await countPixels(page, "--c1")).toBeGreaterThan(20);
  }
  expect(problems).toEqual([]);
  await page.context().close();
});

/** Reports episodes of holding agents until a designed layout has some; returns the layout and its newest episode. */
async function flyDesignedLayout(server: SparringServer, run: string): Promise<[string, string]> {
  const design = { share: 1, layout_share: 1, fixed_share: true };
  await server.post("/v1/runs", { id: run, seed: 4, tasks: ["kessler/survival"], placement: false, design });
  const { designs } = await waitFor(
    async () => {
      await reportHeldEpisodes(server, run, 16).catch(() => null); // not ready: a status of 503
      return server.get<DesignPage>(`/v1/runs/${run}/designs?state=active`);
    },
    (list) => list.designs.some(({ results }) => results.episodes > 0),
  );
  const layout = designs.find(({ results }) => results.episodes > 0)?.id ?? "";
  const { episodes } = await server.get<KesslerDesign>(`/v1/runs/${run}/designs/${layout}`);
  return [layout, episodes[0] ?? ""];
}

test("the reference plan of a design is shown by keyboard, once no run uses the scenario", async () => {
  const { server } = fixture;
  const [layout, episode] = await flyDesignedLayout(server, "aimed");
  await server.post(`/v1/runs/aimed/designs/${layout}/retire`, {});
  const critique = () =>
    server.get<{ withheld: string | null }>(`/v1/runs/aimed/episodes/${episode}/critique`);
  await waitFor(critique, ({ withheld }) => withheld === null);
  const { page, problems } = await fixture.openPage({ width: 1440, height: 900 });
  await visit(page, server.url, `/runs/aimed/designs/${layout}`);
  const checkbox = picture(page).getByRole("checkbox", { name: "Reference plan" });
  await checkbox.focus();
  await page.keyboard.press("Space");
  const legend = picture(page).getByRole("list", { name: "Legend" });
  await legend.getByText("path by the reference plan").waitFor();
  await page.screenshot({ path: `${SCREENSHOT_FOLDER}/design-reference.png`, fullPage: true });
  await page.keyboard.press("Shift+Tab");
  await page.keyboard.press("ArrowRight");
  await picture(page).getByText("Step 1", { exact: true }).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});
