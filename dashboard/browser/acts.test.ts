/** What one does there is done: each act is looked up in the service, not on the page. */
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { go, launch, open } from "./browser";
import { hold, Sparring } from "./sparring";

let browser: Browser;
let service: Sparring;
beforeAll(async () => {
  [browser, service] = [await launch(), await Sparring.start()];
});
afterAll(async () => {
  await browser.close();
  await service.end();
});

async function eventually<T>(look: () => Promise<T>, wanted: (found: T) => boolean): Promise<T> {
  for (let i = 0; ; i++) {
    const found = await look();
    if (wanted(found) || i > 100) return found;
    await new Promise((wake) => setTimeout(wake, 100));
  }
}

interface Run {
  status: string;
  archived_at: string | null;
  settings: { curriculum: { strategy: string; tasks: { task: string }[] }; group_size: number };
}

async function press(page: Page, name: string) {
  await page.getByRole("button", { name }).click();
}

test("a run is made, paused, resumed, archived and taken up again", async () => {
  const { page, wrong } = await open(browser, service.url);
  await go(page, service.url, "/");
  await page.getByText("There are no runs yet").waitFor();
  await press(page, "New run");
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("Id").fill("mine");
  await dialog.getByLabel("Strategy").selectOption("uniform");
  await dialog.getByLabel("Episodes of a scenario").fill("4");
  await dialog.getByLabel("kessler/survival").check();
  await dialog.getByRole("button", { name: "Make it" }).click();
  await page.getByRole("article", { name: "mine" }).waitFor();
  const look = () => service.get<Run>("/v1/runs/mine");
  const { settings } = await look();
  expect([
    settings.curriculum.strategy,
    settings.group_size,
    settings.curriculum.tasks.map((task) => task.task),
  ]).toEqual(["uniform", 4, ["kessler/survival"]]);
  await press(page, "Pause mine");
  expect((await eventually(look, (run) => run.status === "paused")).status).toBe("paused");
  await press(page, "Resume mine");
  expect((await eventually(look, (run) => run.status === "active")).status).toBe("active");
  await press(page, "Archive mine");
  expect((await eventually(look, (run) => run.archived_at !== null)).archived_at).not.toBeNull();
  await page.getByText("There are no runs yet").waitFor();
  await page.getByLabel("those that are archived").check();
  await press(page, "Resume mine");
  expect((await eventually(look, (run) => run.archived_at === null)).archived_at).toBeNull();
  expect(wrong).toEqual([]);
});

test("what the service refuses is said where it was asked", async () => {
  const { page } = await open(browser, service.url);
  await go(page, service.url, "/");
  await press(page, "New run");
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("Id").fill("mine");
  await dialog.getByRole("button", { name: "Make it" }).click();
  expect(await dialog.getByRole("alert").textContent()).toContain("mine");
  await page.keyboard.press("Escape");
  await dialog.waitFor({ state: "detached" });
});

test("designs are asked for, shown with their picture, retired and flown by hand", async () => {
  await service.post("/v1/runs", { id: "beaten", seed: 3, tasks: ["kessler/survival"] });
  for (let i = 0; i < 4; i++) await hold(service, "beaten", 64);
  interface Failures {
    tasks: { criticised: number }[];
  }
  await eventually(
    () => service.get<Failures>("/v1/runs/beaten/failures"),
    (found) => (found.tasks[0]?.criticised ?? 0) > 100,
  );
  const { page, wrong } = await open(browser, service.url);
  await go(page, service.url, "/runs/beaten/designs");
  await page.getByLabel("How many").fill("3");
  await press(page, "Ask");
  await page.getByText(/Asked: ask-/).waitFor();
  interface Designs {
    designs: { id: string; state: string; name: string }[];
  }
  const found = await eventually(
    () => service.get<Designs>("/v1/runs/beaten/designs?state=active"),
    ({ designs }) => designs.length > 0,
  );
  const design = found.designs[0];
  if (!design) throw new Error("nothing was designed");
  await go(page, service.url, `/runs/beaten/designs/${design.id}`);
  await page.locator("canvas").first().waitFor();
  await press(page, "Retire");
  const state = await eventually(
    () => service.get<{ state: string }>(`/v1/runs/beaten/designs/${design.id}`),
    (told) => told.state === "retired",
  );
  expect(state.state).toBe("retired");
  await press(page, "Let it serve again");
  await page.getByRole("button", { name: "Retire" }).waitFor();
  await page.getByRole("link", { name: "Fly it" }).click();
  await page.getByText(`Now: layout ${design.id}`).waitFor();
  await press(page, "Hold");
  await page.locator('output[data-step="1"]').waitFor();
  expect(wrong).toEqual([]);
});

test("a policy is evaluated, and compared", async () => {
  const { page, wrong } = await open(browser, service.url);
  await go(page, service.url, "/evaluations");
  await page.getByLabel("Suite").selectOption("docking-heldout-v1");
  for (const policy of ["hold", "heuristic"]) {
    await page.getByRole("combobox", { name: /^Policy/ }).selectOption(policy);
    await press(page, "Evaluate it");
  }
  await page.getByLabel("A", { exact: true }).nth(1).waitFor({ timeout: 60_000 });
  await page.getByLabel("A", { exact: true }).nth(0).check(); // the newest first: heuristic
  await page.getByLabel("B", { exact: true }).nth(1).check();
  await press(page, "Compare A with B");
  await page.getByText("Difference of success").waitFor();
  const cells = await page.locator("tbody tr").first().locator("td").allTextContents();
  expect(cells[2]).toMatch(/^[1-9]\d*\.\d % \[[1-9]/); // better than holding: a positive difference
  expect(wrong).toEqual([]);
});

test("episodes are filtered by what the address says, and words are explained to who asks", async () => {
  await service.post("/v1/runs", {
    id: "flown",
    seed: 5,
    tasks: ["kessler/survival"],
    design: { designer: "off" },
  });
  await hold(service, "flown", 12);
  const { page, wrong } = await open(browser, service.url);
  const rows = page.locator("tbody tr");
  await go(page, service.url, "/runs/flown/episodes?success=false&order=oldest");
  await rows.first().waitFor();
  const failed = await rows.count();
  expect(await page.getByLabel("Outcome").inputValue()).toBe("false");
  expect(failed).toBeLessThan(12);
  await page.getByLabel("Outcome").selectOption("true");
  await expect.poll(() => rows.count()).toBe(12 - failed);
  expect(page.url()).toContain("success=true&order=oldest");
  // A link to all of them, and back to what was chosen.
  await page.getByRole("link", { name: "episodes", exact: true }).click();
  await expect.poll(() => rows.count()).toBe(12);
  expect(await page.getByLabel("Outcome").inputValue()).toBe("");
  await page.goBack();
  await expect.poll(() => rows.count()).toBe(12 - failed);
  expect(await page.getByLabel("Outcome").inputValue()).toBe("true");

  const explained = page.getByText("Where a score lies between floor and reference");
  expect(await explained.isVisible()).toBe(false);
  await page.getByRole("button", { name: "Skill" }).click();
  await explained.waitFor();
  await page.keyboard.press("Escape");
  await explained.waitFor({ state: "hidden" });
  expect(wrong).toEqual([]);
  await page.context().close();
});

test("everything on the runs page is reached by the keyboard", async () => {
  const { page } = await open(browser, service.url);
  await go(page, service.url, "/");
  await page.getByRole("button", { name: "Pause mine" }).waitFor();
  const reached: string[] = [];
  for (let i = 0; i < 40; i++) {
    await page.keyboard.press("Tab");
    reached.push(
      await page.evaluate(
        () =>
          document.activeElement?.getAttribute("aria-label") ??
          document.activeElement?.textContent.trim() ??
          "",
      ),
    );
  }
  for (const name of ["Runs", "Evaluations", "Play", "New run", "Pause mine", "Archive mine"])
    expect(reached).toContain(name);
});
