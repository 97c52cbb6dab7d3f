/** Checks the table of runs: search, order, groups, columns and pages in the address, a thousand runs, bulk actions, and the keyboard. */
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit, waitUntilIdle, SCREENSHOT_FOLDER, openPage } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { checkAccessibility } from "./page-checks";
import { waitFor } from "./poll";
import { SparringServer } from "./server";

const MANY = 1000;
/** Requests at a time that create runs. */
const AT_ONCE = 8;

interface Run {
  id: string;
  note: string;
  tags: string[];
  archived_at: string | null;
}

async function createMany(server: SparringServer, count: number) {
  for (let first = 0; first < count; first += AT_ONCE) {
    const numbers = Array.from({ length: Math.min(AT_ONCE, count - first) }, (_, i) => first + i);
    await Promise.all(
      numbers.map((n) =>
        server.post("/v1/runs", {
          id: `many-${String(n).padStart(4, "0")}`,
          tasks: [n % 2 === 0 ? "kessler/survival" : "docking/single"],
          strategy: n % 3 === 0 ? "uniform" : "ladder",
          design: { designer: "off" },
          tags: n % 10 === 0 ? ["even", "tenth"] : [],
        }),
      ),
    );
  }
}

/** A server with a run that has results, and a thousand others. */
const fixture = useFixture(async (server) => {
  await createHeldRun(server, "flown", 8, { name: "Flown once", tags: ["paper"], note: "first encoder" });
  await createMany(server, MANY);
});

const rows = (page: Page) => page.locator("[data-run]");
const names = async (page: Page) =>
  (await rows(page).getByRole("rowheader").allTextContents()).map((name) => name.trim());
const firstName = async (page: Page) => (await names(page))[0];

test("a thousand runs are searched, sorted and scrolled with few rows in the document", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/");
  await page.getByText(`${(MANY + 1).toLocaleString("en")} runs`).waitFor();
  expect(await firstName(page)).toMatch(/^many-099/); // the last ones were created at the same time
  expect(await rows(page).first().getByText("waiting").count()).toBe(1);
  expect(await rows(page).count()).toBeLessThan(60);
  // The last run is the first one that was created.
  await expect
    .poll(async () => {
      await page.evaluate(() => {
        scrollTo(0, document.documentElement.scrollHeight);
      });
      return (await names(page)).join();
    })
    .toContain("Flown once");
  expect(await rows(page).count()).toBeLessThan(60);
  await page.evaluate(() => {
    scrollTo(0, 0);
  });
  await page.getByRole("button", { name: "Run", exact: true }).click();
  await expect.poll(() => firstName(page)).toContain("Flown once");
  expect(page.url()).toContain("#/?sort=name");
  await page.getByRole("button", { name: /^Episodes/ }).click();
  await expect.poll(() => page.url()).toContain("sort=episodes");
  expect(await page.getByRole("columnheader", { name: /Episodes/ }).getAttribute("aria-sort")).toBe(
    "descending",
  );
  await expect.poll(() => firstName(page)).toContain("Flown once");
  await page.getByLabel("Search").fill("encoder flown");
  await expect.poll(() => rows(page).count()).toBe(1);
  expect(await page.getByText("1 run", { exact: true }).count()).toBe(1);
  await page.getByLabel("Search").fill("nothing like this");
  await page.getByText("No runs match these filters.").waitFor();
  await page.getByRole("button", { name: "Clear filters" }).click();
  await expect.poll(() => rows(page).count()).toBeGreaterThan(10);
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the address has the whole view, and groups open", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/?search=many-000&tag=tenth&columns=strategy,seed&sort=name&order=desc");
  await expect.poll(() => names(page)).toEqual(["many-0000"]);
  expect(await page.getByRole("columnheader").allTextContents()).toEqual([
    "",
    "Run\u00a0↓",
    "Strategy",
    "Seed",
    "Actions",
  ]);
  await page.getByRole("button", { name: "Columns" }).click();
  await page.getByRole("checkbox", { name: "Note" }).check();
  await expect.poll(() => page.url()).toContain("columns=strategy,note,seed");
  await page.keyboard.press("Escape");
  await page.reload();
  await page.getByRole("columnheader", { name: "Note" }).waitFor();

  await visit(page, server.url, "/?group=strategy");
  await page.getByText("334 runs, 0 episodes").waitFor();
  await page.getByRole("button", { name: "uniform" }).click();
  await expect.poll(() => firstName(page)).toMatch(/^many-09/);
  await page.getByLabel("Group by").selectOption("tag");
  await page.getByRole("button", { name: "paper" }).click();
  await expect.poll(() => firstName(page)).toContain("Flown once");
  expect(page.url()).toContain("group=tag");
  // A run with two tags is in two groups, and counts once.
  await page.getByText("1,001 runs", { exact: true }).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("a name has the free width, and tags that do not fit are counted", async () => {
  const { server } = fixture;
  const name = "sparring demo: learn, seed 1";
  await server.post("/v1/runs", {
    id: "long-name",
    name,
    tags: ["demo", "demo-learn", "encoder-512", "lr:3e-4"],
    design: { designer: "off" },
  });
  const { page, problems } = await fixture.openPage({ width: 1440, height: 900 });
  await visit(page, server.url, "/?search=long-name");
  const link = page.getByRole("link", { name });
  await link.waitFor();
  expect(await link.evaluate((node) => node.scrollWidth - node.clientWidth)).toBeLessThanOrEqual(0);
  const cell = rows(page).first().locator(".tags .value");
  expect(await cell.getAttribute("title")).toBe("demo, demo-learn, encoder-512, lr:3e-4");
  expect(await cell.textContent()).toMatch(/\+[1-3]$/);
  expect(await page.evaluate(() => document.documentElement.scrollWidth - innerWidth)).toBeLessThanOrEqual(0);
  const box = await page.getByRole("table", { name: "Runs" }).boundingBox();
  expect((box?.x ?? 0) + (box?.width ?? Infinity), "the table fits the window").toBeLessThanOrEqual(1440);
  expect(await page.getByRole("columnheader", { name: /^Skill, recent/ }).getAttribute("title")).toContain(
    "at the level of the run",
  );
  expect(await page.getByRole("columnheader").allTextContents()).toContain("Level");
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the address has the selection and the open dialog", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/?search=many-010&selected=many-0100,flown,unknown");
  const bar = page.getByRole("region", { name: "Selected runs" });
  await bar.getByText("2 selected").waitFor(); // also a run that the search leaves out, but no unknown one
  expect(await page.getByLabel("Select many-0100").isChecked()).toBe(true);
  await expect.poll(() => page.url()).toMatch(/selected=many-0100,flown$/);
  await page.getByRole("button", { name: "Edit tags and note of many-0101" }).click();
  await expect.poll(() => page.url()).toContain("dialog=edit%3Amany-0101");
  await page.reload();
  const dialog = page.getByRole("dialog");
  await dialog.getByRole("heading", { name: "Tags and note of many-0101" }).waitFor();
  await dialog.getByRole("button", { name: "Cancel" }).click();
  await expect.poll(() => page.url()).not.toContain("dialog");
  await bar.getByRole("button", { name: /^Delete/ }).click();
  await expect.poll(() => page.url()).toContain("dialog=delete");
  await page.reload();
  await dialog.getByRole("heading", { name: "Delete 2 runs" }).waitFor();
  await page.keyboard.press("Escape");
  await dialog.waitFor({ state: "detached" });
  await bar.getByRole("button", { name: "Clear selection" }).click();
  await expect.poll(() => page.url()).toMatch(/#\/\?search=many-010$/);
  await page.getByRole("button", { name: "New run" }).click();
  await expect.poll(() => page.url()).toContain("dialog=new");
  await dialog.getByRole("button", { name: "Create" }).waitFor(); // a dialog that is still loading has no keys
  await page.keyboard.press("Escape");
  await expect.poll(() => page.url()).not.toContain("dialog");
  expect(problems.filter((problem) => !problem.includes("/v1/runs/unknown"))).toEqual([]);
  await page.context().close();
});

test("tags and the note of a run are edited", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/?search=flown");
  await page.getByRole("button", { name: "Edit tags and note of Flown once" }).click();
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("Note").fill("second encoder");
  await dialog.getByLabel(/^Tags/).fill("paper Not-Valid");
  await dialog.getByRole("button", { name: "Save" }).click();
  await dialog.getByRole("alert").waitFor();
  expect(await dialog.getByLabel(/^Tags/).getAttribute("aria-invalid")).toBe("true");
  await dialog.getByLabel(/^Tags/).fill("paper, lr:3e-4");
  await dialog.getByRole("button", { name: "Save" }).click();
  await dialog.waitFor({ state: "detached" });
  const run = await server.get<Run>("/v1/runs/flown");
  expect([run.note, run.tags]).toEqual(["second encoder", ["lr:3e-4", "paper"]]);
  await page.getByText("lr:3e-4").waitFor();
  problems.splice(0, problems.length, ...problems.filter((problem) => !problem.includes("422")));
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the keyboard alone searches, selects, compares and deletes runs", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/");
  /** Moves the focus forwards until the label of the focused element is the wanted one. */
  const tabTo = async (label: string) => {
    for (let i = 0; i < 80; i++) {
      const focused = await page.evaluate(() => {
        const element = document.activeElement as HTMLInputElement | null;
        return element?.ariaLabel ?? element?.labels?.[0]?.textContent.trim() ?? element?.textContent.trim();
      });
      if (focused?.startsWith(label)) return;
      await page.keyboard.press("Tab");
    }
    throw new Error(`the focus does not reach ${label}`);
  };
  await tabTo("Search");
  await page.keyboard.type("many-099");
  await expect.poll(() => rows(page).count()).toBe(10);
  for (const name of ["many-0999", "many-0998"]) {
    await tabTo(`Select ${name}`);
    await page.keyboard.press("Space");
  }
  await page.getByText("2 selected").waitFor();
  await expect.poll(() => page.url()).toContain("selected=many-0999,many-0998");
  await page.evaluate(() => {
    document.getElementById("main")?.focus();
  });
  await tabTo("Compare");
  await page.keyboard.press("Enter");
  await page.getByRole("heading", { name: "Comparison of runs" }).waitFor();
  expect(page.url()).toContain("#/compare?runs=many-0999,many-0998");
  await page.getByRole("cell", { name: "docking/single" }).first().waitFor();
  await page.goBack();
  await expect.poll(() => rows(page).count()).toBe(10);
  await page.getByText("2 selected").waitFor(); // the address has the selection
  await page.evaluate(() => {
    document.getElementById("main")?.focus();
  });
  await tabTo("Delete");
  await page.keyboard.press("Enter");
  const dialog = page.getByRole("dialog");
  await dialog.waitFor();
  await tabTo("Type delete");
  await page.keyboard.type("delete");
  await page.keyboard.press("Enter");
  await dialog.waitFor({ state: "detached" });
  await expect.poll(() => rows(page).count()).toBe(8);
  await waitFor(
    () => server.get<{ runs: Run[] }>("/v1/runs?search=many-0999"),
    ({ runs }) => runs.length === 0,
  );
  expect(problems).toEqual([]);
  await page.context().close();
});

test("all runs that match are selected and archived, also those that are not loaded", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/?strategy=uniform");
  const { total } = await server.get<{ total: number }>("/v1/runs?strategy=uniform&limit=1");
  expect(total).toBeGreaterThan(300);
  await page.getByRole("checkbox", { name: "Select all loaded runs" }).check();
  const bar = page.getByRole("region", { name: "Selected runs" });
  await bar.getByRole("button", { name: `Select all ${String(total)} runs that match` }).click();
  await bar.getByText(`${String(total)} selected`).waitFor();
  expect(await bar.getByRole("button", { name: /^Select all/ }).count()).toBe(0);
  await bar.getByText("Select at most 100 runs to compare.").waitFor();
  await bar.getByRole("button", { name: "Archive" }).click();
  await page.getByText("No runs match these filters.").waitFor();
  const archived = await server.get<{ total: number }>("/v1/runs?strategy=uniform&activity=archived&limit=1");
  expect(archived.total).toBe(total);
  await page.getByRole("combobox", { name: /^Activity/ }).selectOption("archived");
  await expect.poll(() => rows(page).count()).toBeGreaterThan(10);
  await page.getByRole("checkbox", { name: "Select all loaded runs" }).check();
  await bar.getByRole("button", { name: /^Select all/ }).click();
  await bar.getByText(`${String(total)} selected`).waitFor();
  await bar.getByRole("button", { name: "Restore" }).click();
  await page.getByText("No runs match these filters.").waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});

test("the form of a new run has all settings, the commands, and errors at the fields", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/");
  await page.getByRole("button", { name: "New run" }).click();
  const dialog = page.getByRole("dialog");
  // Enter in the form, before anything is filled in, must not create a run by the focused button.
  await expect
    .poll(() => page.evaluate(() => document.activeElement?.getAttribute("id")))
    .toMatch(/^setting-/);
  await dialog.getByLabel("id", { exact: true }).fill("made");
  await dialog.getByLabel("Strategy", { exact: true }).selectOption("plr");
  await dialog.getByLabel("kessler/survival").check();
  await dialog.getByText("Settings of kessler/survival").click();
  await dialog.getByLabel("contact", { exact: true }).selectOption({ index: 1 });
  await dialog.getByText("Groups and evidence").click();
  await dialog.getByLabel("group size", { exact: true }).fill("4");
  await dialog.getByText("Designed layouts", { exact: true }).click();
  await dialog.getByLabel("share", { exact: true }).fill("2");
  const code = dialog.getByRole("region", { name: "curl" });
  expect(await code.textContent()).toContain('"share": 2');
  expect(await dialog.getByRole("region", { name: "Python" }).textContent()).toContain('"strategy": "plr"');
  await dialog.getByText("Designed layouts", { exact: true }).click(); // the error opens the section again
  await dialog.getByRole("button", { name: "Create" }).click();
  const error = dialog.getByRole("alert");
  await error.waitFor();
  expect(await dialog.getByLabel("share", { exact: true }).getAttribute("aria-invalid")).toBe("true");
  expect(
    await dialog.getByLabel("share", { exact: true }).evaluate((node) => node === document.activeElement),
  ).toBe(true);
  await checkAccessibility({ page, problems, pending: new Set() }, "new-run");
  await page.screenshot({ path: `${SCREENSHOT_FOLDER}/new-run-error.png` });
  await dialog.getByLabel("share", { exact: true }).fill("0.1");
  await dialog.getByRole("button", { name: "Create" }).click();
  await dialog.waitFor({ state: "detached" });
  await page.getByRole("heading", { name: "made", exact: true }).waitFor();
  const made = await server.get<{ settings: { group_size: number; design: { share: number } } }>(
    "/v1/runs/made",
  );
  expect([made.settings.group_size, made.settings.design.share]).toEqual([4, 0.1]);
  expect(problems.filter((problem) => !problem.includes("422"))).toEqual([]);
  await page.context().close();
});

test("the table and the form are accessible in both colour schemes, and cards fit a phone", async () => {
  for (const dark of [false, true]) {
    for (const [width, height] of [
      [1440, 900],
      [390, 844],
    ] as const) {
      const observed = await openPage(fixture.browser, fixture.server.url, { dark, width, height });
      const { page, problems } = observed;
      const name = `many-runs-${String(width)}-${dark ? "dark" : "light"}`;
      for (const [route, part] of [
        ["/?sort=episodes", "list"],
        ["/?group=strategy", "groups"],
      ] as const) {
        await visit(page, fixture.server.url, route);
        if (part === "groups") await page.getByRole("button", { name: "uniform" }).click();
        await page
          .getByLabel(/^Select many/)
          .first()
          .check();
        await waitUntilIdle(observed);
        await page.screenshot({ path: `${SCREENSHOT_FOLDER}/${name}-${part}.png` });
        await checkAccessibility(observed, `${name}-${part}`);
        const overflow = await page.evaluate(
          () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
        );
        expect(overflow, name).toBeLessThanOrEqual(0);
      }
      await page.getByRole("button", { name: "New run" }).click();
      await page.getByRole("dialog").getByText("Groups and evidence").click();
      await waitUntilIdle(observed);
      await page.screenshot({ path: `${SCREENSHOT_FOLDER}/${name}-form.png` });
      await checkAccessibility(observed, `${name}-form`);
      const wider = await page
        .getByRole("dialog")
        .evaluate((dialog) => dialog.scrollWidth - dialog.clientWidth);
      expect(wider, `${name}-form`).toBeLessThanOrEqual(0);
      expect(problems).toEqual([]);
      await page.context().close();
    }
  }
});
