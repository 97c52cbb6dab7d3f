/** The list of all pages, and the checks that each of them must pass. */
import { AxeBuilder } from "@axe-core/playwright";
import type { Browser } from "playwright-core";
import { expect } from "vitest";
import { openPage, SCREENSHOT_FOLDER, visit, waitUntilIdle, type ObservedPage } from "./browser";
import type { SparringServer } from "./server";

export interface PageCase {
  route: string;
  /** Text that the page shows once it has loaded. */
  text: string;
}

/** Returns all pages of a server on which a learner trained, by name. */
export async function pagesOfTrainedRun(url: string, run: string): Promise<Record<string, PageCase>> {
  const get = async (path: string) => (await (await fetch(url + path)).json()) as Record<string, never>;
  const failures: { episode: string }[] =
    (await get(`/v1/runs/${run}/failures?task=kessler/survival&mode=collision&limit=1`))["failures"] ?? [];
  const designs: { id: string }[] =
    (await get(`/v1/runs/${run}/designs?limit=1&state=active`))["designs"] ?? [];
  return {
    runs: { route: "/", text: "sparring demo" },
    "runs-grouped": { route: "/?group=tasks", text: "1 run," },
    run: { route: `/runs/${run}`, text: "Mastery of survival" },
    "run-parameters": { route: `/runs/${run}?tab=parameters`, text: "bodies the generator draws" },
    "run-failures": { route: `/runs/${run}?tab=failures`, text: "Failure modes" },
    "run-trainer": { route: `/runs/${run}?tab=trainer`, text: "Policy versions" },
    "run-activity": { route: `/runs/${run}?tab=activity`, text: "Level moves" },
    "run-settings": { route: `/runs/${run}?tab=settings`, text: "Strategy: ladder" },
    failures: { route: `/runs/${run}/failures`, text: "collision" },
    episodes: { route: `/runs/${run}/episodes`, text: "Role" },
    replay: { route: `/runs/${run}/episodes/${failures[0]?.episode ?? ""}?step=3`, text: "Timeline" },
    designs: { route: `/runs/${run}/designs`, text: "Designers" },
    design: { route: `/runs/${run}/designs/${designs[0]?.id ?? ""}`, text: "Agent results" },
    evaluations: { route: "/evaluations", text: "eval-1" },
    evaluation: { route: "/evaluations/eval-1", text: "Results by scenario" },
    compare: { route: "/evaluations/compare?a=eval-1&b=eval-2", text: "Difference in success" },
    compareRuns: { route: `/compare?runs=${run}`, text: "Values at the end" },
    play: { route: "/play?task=kessler/survival&seed=7&level=4", text: "Holding" },
    docking: { route: "/play?task=docking/multiagent&seed=7", text: "Holding" },
    tasking: { route: "/play?task=tasking/constellation&seed=7", text: "Actions over time" },
    missing: { route: "/nowhere", text: "Page not found" },
  };
}

/** Pages of a server whose only run, `new`, has no episodes. */
export const PAGES_OF_EMPTY_RUN: Record<string, PageCase> = {
  runs: { route: "/", text: "survival" },
  run: { route: "/runs/new", text: "No episodes yet" },
  "run-failures": { route: "/runs/new?tab=failures", text: "No episodes analysed yet" },
  "run-activity": { route: "/runs/new?tab=activity", text: "No level has moved" },
  failures: { route: "/runs/new/failures", text: "No episodes analysed yet" },
  episodes: { route: "/runs/new/episodes", text: "No episodes yet" },
  designs: { route: "/runs/new/designs", text: "No designs yet" },
  evaluations: { route: "/evaluations", text: "No evaluations yet" },
  alerts: { route: "/alerts", text: "There are no alerts" },
  server: { route: "/server", text: "Commit takes" },
  workers: { route: "/workers", text: "does all jobs itself" },
};

/** Creates the run of `PAGES_OF_EMPTY_RUN`. */
export async function createEmptyRun(server: SparringServer) {
  await server.post("/v1/runs", { id: "new" });
}

/** Rules of axe whose verdict depends on colours. */
const COLOUR_RULES = ["color-contrast", "link-in-text-block"];

/** Opens each page, takes its screenshot, and checks its errors and its accessibility. */
export async function checkPages(
  browser: Browser,
  url: string,
  pages: Record<string, PageCase>,
  dark: boolean,
  prefix = "",
) {
  for (const [name, page] of Object.entries(pages)) {
    const observed = await openPage(browser, url, { dark });
    await checkPage(observed, url, `${prefix}${name}-${dark ? "dark" : "light"}`, page);
    await checkAccessibility(observed, name, { coloursOnly: dark });
    await observed.page.context().close();
  }
}

/** Opens a page, waits for its text, takes its screenshot, and checks that it had no errors. */
export async function checkPage(
  observed: ObservedPage,
  url: string,
  name: string,
  { route, text }: PageCase,
) {
  const { page, problems } = observed;
  await visit(page, url, route);
  // Options of a closed list have texts too, but are not visible.
  await page.locator("main").getByText(text).filter({ visible: true }).first().waitFor();
  await waitUntilIdle(observed);
  await page.screenshot({ path: `${SCREENSHOT_FOLDER}/${name}.png`, fullPage: true });
  expect(problems, name).toEqual([]);
}

export interface AccessibilityOptions {
  /** Selects elements that are not checked. */
  excluded?: string;
  /** True for a page that was checked in the other colour scheme: only its colours differ. */
  coloursOnly?: boolean;
}

/** Checks that axe finds no serious problem of accessibility. */
export async function checkAccessibility(
  { page }: ObservedPage,
  name: string,
  { excluded, coloursOnly = false }: AccessibilityOptions = {},
) {
  // One call in the page that keeps violations only: half of the time for the same verdict, as the pages have no frames.
  const axe = new AxeBuilder({ page })
    .options({ resultTypes: ["violations"], selectors: false })
    .setLegacyMode();
  if (coloursOnly) axe.withRules(COLOUR_RULES);
  if (excluded && (await page.locator(excluded).count()) > 0) axe.exclude(excluded);
  const { violations } = await axe.analyze();
  const serious = violations.filter(({ impact }) => impact === "serious" || impact === "critical");
  const messages = serious.map(({ id, nodes }) => {
    const elements = nodes.slice(0, 3).map((node) => node.html.slice(0, 120));
    return `${name}: ${id}: ${elements.join(" | ")}`;
  });
  expect(messages).toEqual([]);
}
