/** Checks every component in all states: no errors, no overflow on a phone, accessible in both colour schemes. */
import { readdir, readFile } from "node:fs/promises";
import { join } from "node:path";
import { expect, test } from "vitest";
import { SCREENSHOT_FOLDER, waitUntilIdle } from "./browser";
import { SECTIONS, useGallery } from "./gallery";
import { checkAccessibility } from "./page-checks";

const gallery = useGallery();

/** Rows of tables that repeat those before them; axe needs seconds for a long table. */
const REPEATED_ROWS = "tbody tr:nth-child(n + 9)";

test.each(SECTIONS)("the section %s has no errors, and fits a window and a phone", async (section) => {
  for (const dark of [false, true]) {
    for (const [width, height] of [
      [1440, 900],
      [390, 844],
    ] as const) {
      const observed = await gallery().open(section, { dark, width, height });
      const { page, problems } = observed;
      const name = `gallery-${section}-${String(width)}-${dark ? "dark" : "light"}`;
      await page.screenshot({ path: `${SCREENSHOT_FOLDER}/${name}.png`, fullPage: true });
      const overflow = await page.evaluate(
        () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
      );
      expect(overflow, name).toBeLessThanOrEqual(0);
      // The width changes neither names nor roles: one check on a phone is enough.
      if (width > 400 || !dark)
        await checkAccessibility(observed, name, { excluded: REPEATED_ROWS, coloursOnly: dark });
      expect(problems, name).toEqual([]);
      await page.context().close();
    }
  }
});

test("dialogs fit a phone and are accessible", async () => {
  for (const dark of [false, true]) {
    const observed = await gallery().open("dialogs", { dark, width: 390, height: 844 });
    const { page, problems } = observed;
    for (const name of ["Edit", "Delete one", "Delete many"]) {
      await page.getByRole("button", { name, exact: true }).click();
      const dialog = page.getByRole("dialog");
      await dialog.waitFor();
      await waitUntilIdle(observed);
      const file = `gallery-dialog-${name.replace(" ", "-")}-${dark ? "dark" : "light"}.png`;
      await page.screenshot({ path: `${SCREENSHOT_FOLDER}/${file}` });
      const wider = await dialog.evaluate((node) => node.scrollWidth - node.clientWidth);
      expect(wider, name).toBeLessThanOrEqual(0);
      await checkAccessibility(observed, `dialog ${name}`, { coloursOnly: dark });
      await page.keyboard.press("Escape");
      await dialog.waitFor({ state: "detached" });
    }
    expect(problems).toEqual([]);
    await page.context().close();
  }
});

const ROOT = join(import.meta.dirname, "..");
/** Folders whose components all have a case. */
const COVERED = ["charts", "parts", "run", "workers"];
/** Components that need a live server, with the tests that show them. */
const EXCEPTIONS = {
  "src/parts/NewRunDialog.svelte": "runs.test.ts",
  "src/run/RunPage.svelte": "run-tabs.test.ts",
  "src/run/ChartTabs.svelte": "run-tabs.test.ts",
};

/** Returns the components that a file uses, directly or through others. */
async function componentsOf(file: string, found = new Set<string>()): Promise<Set<string>> {
  const source = await readFile(join(ROOT, file), "utf8");
  for (const [, path] of source.matchAll(/from "(\.[^"]*\/[A-Z]\w*\.svelte)"/g)) {
    const component = join(file, "..", path ?? "");
    if (found.has(component)) continue;
    found.add(component);
    await componentsOf(component, found);
  }
  return found;
}

test("every component of the covered folders is in the gallery", async () => {
  const shown = await componentsOf("gallery/sections.ts");
  const names = await Promise.all(
    COVERED.map(async (folder) =>
      (await readdir(join(ROOT, "src", folder)))
        .filter((name) => name.endsWith(".svelte"))
        .map((name) => `src/${folder}/${name}`),
    ),
  );
  const missing = names.flat().filter((name) => !shown.has(name) && !(name in EXCEPTIONS));
  expect(missing).toEqual([]);
});
