/** The pages that there are, and how they are looked at. */
import { AxeBuilder } from "@axe-core/playwright";
import type { Browser } from "playwright-core";
import { expect } from "vitest";
import { go, open, SHOTS, type Watched } from "./browser";
import type { Sparring } from "./sparring";

export interface Shown {
  place: string;
  /** What is to be read there once it has loaded. */
  shows: string;
}

/** All pages of a service in which a learner trained. */
export async function full(url: string, run: string): Promise<Record<string, Shown>> {
  const look = async (path: string) => (await (await fetch(url + path)).json()) as Record<string, never>;
  const failures: { episode: string }[] =
    (await look(`/v1/runs/${run}/failures/list?task=kessler/survival&mode=collision&limit=1`))["failures"] ??
    [];
  const designs: { id: string }[] =
    (await look(`/v1/runs/${run}/designs?limit=1&state=active`))["designs"] ?? [];
  return {
    runs: { place: "/", shows: "sparring demo" },
    run: { place: `/runs/${run}`, shows: "Mastery of survival" },
    failures: { place: `/runs/${run}/failures`, shows: "collision" },
    episodes: { place: `/runs/${run}/episodes`, shows: "Origin" },
    replay: { place: `/runs/${run}/episodes/${failures[0]?.episode ?? ""}?step=3`, shows: "What happened" },
    designs: { place: `/runs/${run}/designs`, shows: "Who designs" },
    design: { place: `/runs/${run}/designs/${designs[0]?.id ?? ""}`, shows: "What agents did on it" },
    evaluations: { place: "/evaluations", shows: "eval-1" },
    evaluation: { place: "/evaluations/eval-1", shows: "Scenario by scenario" },
    compare: { place: "/evaluations/compare?a=eval-1&b=eval-2", shows: "Difference of success" },
    play: { place: "/play?task=kessler/survival&seed=7&level=4", shows: "Where nobody acts" },
    docking: { place: "/play?task=docking/multiagent&seed=7", shows: "Where nobody acts" },
    missing: { place: "/nowhere", shows: "There is no such page" },
  };
}

/** Those of a service that has one run, called new, of which nothing came back. */
export const EMPTY: Record<string, Shown> = {
  runs: { place: "/", shows: "Leases" },
  run: { place: "/runs/new", shows: "Nothing came back yet" },
  failures: { place: "/runs/new/failures", shows: "Nothing was criticised yet" },
  episodes: { place: "/runs/new/episodes", shows: "Nothing came back yet" },
  designs: { place: "/runs/new/designs", shows: "Nothing was designed" },
  evaluations: { place: "/evaluations", shows: "There are none yet" },
};

/** Goes to a page, waits for what it shows, and takes its picture: nothing went wrong in it meanwhile. */
export async function shoot({ page, wrong }: Watched, url: string, name: string, { place, shows }: Shown) {
  await go(page, url, place);
  await page.locator("main").getByText(shows).first().waitFor();
  await page.waitForTimeout(600); // charts are drawn a frame later
  await page.screenshot({ path: `${SHOTS}/${name}.png`, fullPage: true });
  expect(wrong, name).toEqual([]);
}

/** Whether everybody can use a page, as far as axe can tell. */
async function usable({ page }: Watched, name: string) {
  const found = await new AxeBuilder({ page }).analyze();
  const bad = found.violations.filter((one) => one.impact === "serious" || one.impact === "critical");
  const told = bad.map(({ id, nodes }) => {
    const where = nodes.slice(0, 3).map((node) => node.html.slice(0, 120));
    return `${name}: ${id}: ${where.join(" | ")}`;
  });
  expect(told).toEqual([]);
}

/** Looks at each of these pages. */
export async function look(
  browser: Browser,
  url: string,
  pages: Record<string, Shown>,
  dark: boolean,
  kind = "",
) {
  for (const [name, page] of Object.entries(pages)) {
    const watched = await open(browser, url, { dark });
    await shoot(watched, url, `${kind}${name}-${dark ? "dark" : "light"}`, page);
    await usable(watched, name);
    await watched.page.context().close();
  }
}

/** A service with one run, of which nothing came back. */
export async function emptied(service: Sparring): Promise<Sparring> {
  await service.post("/v1/runs", { id: "new" });
  return service;
}
