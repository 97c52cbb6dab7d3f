/** Checks the actions of the pages by their effect on the server. */
import { fileURLToPath } from "node:url";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { openPage, SCREENSHOT_FOLDER, visit } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { waitFor } from "./poll";
import { reportHeldEpisodes, SparringServer } from "./server";

const fixture = useFixture();

interface Run {
  status: string;
  archived_at: string | null;
  settings: { curriculum: { strategy: string; tasks: { task: string }[] }; group_size: number };
}

interface Failures {
  tasks: { criticised: number }[];
}

interface Designs {
  designs: { id: string }[];
}

/** Folder of policy files whose rollouts fail. */
const FAULTY_POLICIES = fileURLToPath(new URL("../../tests/fixtures/onnx/faulty", import.meta.url));
/** Time that two evaluations at once may take on a busy machine. */
const EVALUATION_TIMEOUT_MS = 300_000;

async function press(page: Page, name: string) {
  await page.getByRole("button", { name }).click();
}

test("a run is created, paused, resumed, archived and restored", async () => {
  const server = await SparringServer.start(); // without the runs of the other tests
  const { page, problems } = await openPage(fixture.browser, server.url);
  await visit(page, server.url, "/");
  await page.getByText("No runs yet").waitFor();
  await press(page, "New run");
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("id", { exact: true }).fill("mine");
  await dialog.getByLabel("Strategy", { exact: true }).selectOption("uniform");
  await dialog.getByText("Groups and evidence").click();
  await dialog.getByLabel("group size", { exact: true }).fill("4");
  await dialog.getByLabel("kessler/survival").check();
  await dialog.getByRole("button", { name: "Create" }).click();
  // The page of the new run opens, and its sampler has drawn nothing that says something about the agent.
  await page.getByRole("heading", { name: "mine", exact: true }).waitFor();
  expect(new URL(page.url()).hash).toBe("#/runs/mine");
  await expect.poll(() => page.locator("tr.task td.number").first().textContent()).toBe("–");
  await page.goBack();
  await page.getByRole("rowheader", { name: "mine" }).waitFor();
  expect(new URL(page.url()).hash).toBe("#/");
  const getRun = () => server.get<Run>("/v1/runs/mine");
  const { settings } = await getRun();
  expect([
    settings.curriculum.strategy,
    settings.group_size,
    settings.curriculum.tasks.map((task) => task.task),
  ]).toEqual(["uniform", 4, ["kessler/survival"]]);
  await press(page, "Pause mine");
  await waitFor(getRun, ({ status }) => status === "paused");
  await press(page, "Resume mine");
  await waitFor(getRun, ({ status }) => status === "active");
  await page.getByLabel("Select mine").check();
  await press(page, "Archive");
  await waitFor(getRun, (run) => run.archived_at !== null);
  await page.getByText("No runs yet").waitFor();
  await page.getByRole("combobox", { name: /^Activity/ }).selectOption("archived");
  await press(page, "Resume mine");
  await waitFor(getRun, (run) => run.archived_at === null);
  expect(problems).toEqual([]);
  await page.context().close();
  await server.dispose();
});

test("a rejected request is reported in its dialog", async () => {
  const { server } = fixture;
  await server.post("/v1/runs", { id: "taken" });
  const { page } = await fixture.openPage();
  await visit(page, server.url, "/");
  await press(page, "New run");
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("id", { exact: true }).fill("taken");
  await dialog.getByRole("button", { name: "Create" }).click();
  expect(await dialog.getByRole("alert").textContent()).toContain("taken");
  await page.keyboard.press("Escape");
  await dialog.waitFor({ state: "detached" });
});

test("designs are requested, shown, retired and played", async () => {
  const { server } = fixture;
  await server.post("/v1/runs", { id: "beaten", seed: 3, tasks: ["kessler/survival"] });
  for (let i = 0; i < 4; i++) await reportHeldEpisodes(server, "beaten", 64);
  await waitFor(
    () => server.get<Failures>("/v1/runs/beaten/failure_profiles"),
    ({ tasks }) => (tasks[0]?.criticised ?? 0) > 100,
  );
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/runs/beaten/designs");
  await page.getByLabel("Layouts", { exact: true }).fill("3");
  await page.getByRole("button", { name: "Request", exact: true }).click();
  await page.getByText(/Request ask-/).waitFor();
  const { designs } = await waitFor(
    () => server.get<Designs>("/v1/runs/beaten/designs?state=active"),
    (list) => list.designs.length > 0,
  );
  const design = designs[0];
  if (!design) throw new Error("no design is active");
  await visit(page, server.url, `/runs/beaten/designs/${design.id}`);
  await page.locator("canvas").first().waitFor();
  await press(page, "Retire");
  await waitFor(
    () => server.get<{ state: string }>(`/v1/runs/beaten/designs/${design.id}`),
    ({ state }) => state === "retired",
  );
  await press(page, "Restore");
  await page.getByRole("button", { name: "Retire" }).waitFor();
  await page.getByRole("link", { name: "Play layout" }).click();
  await page.getByText(`Current layout: ${design.id}`).waitFor();
  await press(page, "Hold");
  await page.locator('output[data-step="1"]').waitFor();
  expect(problems).toEqual([]);
});

test("two evaluated policies are compared", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/evaluations");
  await page.getByLabel("Suite").selectOption("docking-heldout-v1");
  for (const policy of ["hold", "heuristic"]) {
    await page.getByRole("combobox", { name: /^Policy/ }).selectOption(policy);
    await page.getByRole("button", { name: "Evaluate", exact: true }).click();
  }
  // Either evaluation may complete first; a row has its check boxes once its evaluation is complete.
  const checkbox = (policy: string, side: string) =>
    page
      .getByRole("row")
      .filter({ has: page.getByRole("cell", { name: policy, exact: true }) })
      .getByLabel(side, { exact: true });
  await checkbox("heuristic", "A").check({ timeout: EVALUATION_TIMEOUT_MS });
  await checkbox("hold", "B").check({ timeout: EVALUATION_TIMEOUT_MS });
  await press(page, "Compare A with B");
  await page.getByText("Difference in success rate, A").waitFor();
  const cells = await page.locator("tbody tr").first().locator("td").allTextContents();
  expect(cells[2]).toMatch(/^\+[1-9]\d*\.\d pp \[\+[1-9]/); // better than holding: a positive difference
  expect(problems).toEqual([]);
});

test("the address sets the episode filter, and terms have help", async () => {
  const { server } = fixture;
  await createHeldRun(server, "flown", 12, { seed: 5 });
  const { page, problems } = await fixture.openPage();
  const rows = page.locator("tbody tr");
  await visit(page, server.url, "/runs/flown/episodes?success=false&order=oldest");
  await rows.first().waitFor();
  const failed = await rows.count();
  expect(await page.getByLabel("Outcome").inputValue()).toBe("false");
  expect(failed).toBeLessThan(12);
  await page.getByLabel("Outcome").selectOption("true");
  await expect.poll(() => rows.count()).toBe(12 - failed);
  expect(page.url()).toContain("success=true&order=oldest");
  // The link removes the filter, and the back button restores it.
  await page.getByRole("link", { name: "Episodes", exact: true }).click();
  await expect.poll(() => rows.count()).toBe(12);
  expect(await page.getByLabel("Outcome").inputValue()).toBe("");
  await page.goBack();
  await expect.poll(() => rows.count()).toBe(12 - failed);
  expect(await page.getByLabel("Outcome").inputValue()).toBe("true");

  const help = page.getByText("Position of a score between floor and reference");
  expect(await help.isVisible()).toBe(false);
  await page.getByRole("button", { name: "Skill" }).click();
  await help.waitFor();
  await page.keyboard.press("Escape");
  await help.waitFor({ state: "hidden" });
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the keyboard reaches every control of the runs page", async () => {
  const { server } = fixture;
  await server.post("/v1/runs", { id: "keyboard" });
  const { page } = await fixture.openPage();
  await visit(page, server.url, "/");
  await page.getByRole("button", { name: "Pause keyboard" }).waitFor();
  const reached: string[] = [];
  for (let i = 0; i < 60; i++) {
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
  for (const name of [
    "Runs",
    "Evaluations",
    "Play",
    "New run",
    "Columns",
    "Select keyboard",
    "Pause keyboard",
  ])
    expect(reached).toContain(name);
});

test("a policy file is evaluated, and its long error stays in its column", async () => {
  const server = await SparringServer.start(["--policy-folder", FAULTY_POLICIES]);
  const { page, problems } = await openPage(fixture.browser, server.url);
  await visit(page, server.url, "/evaluations");
  await page.getByRole("combobox", { name: /^Policy/ }).selectOption("policy file");
  await page.getByRole("textbox", { name: "File" }).fill("onnx:not_finite.onnx");
  await press(page, "Evaluate");
  const row = page.getByRole("row").filter({ hasText: "onnx:not_finite.onnx@" });
  const state = row.getByRole("cell", { name: /^failed:.*[0-9a-f]{64}/ });
  await state.waitFor({ timeout: EVALUATION_TIMEOUT_MS });
  expect(await row.getByRole("cell", { name: "server", exact: true }).count()).toBe(1);
  const [text, cell] = await state.evaluate((cell) => [
    cell.querySelector(".badge")?.getBoundingClientRect().right ?? Infinity,
    cell.getBoundingClientRect().right,
  ]);
  expect(text).toBeLessThanOrEqual(cell ?? 0);
  expect(await state.evaluate((cell) => cell.scrollWidth - cell.clientWidth)).toBeLessThanOrEqual(0);
  await page.screenshot({ path: `${SCREENSHOT_FOLDER}/evaluation-failed.png`, fullPage: true });
  expect(problems).toEqual([]);
  await page.context().close();
  await server.dispose();
});
