/** Checks the time range that the charts of a run share: it is selected by dragging, moved, narrowed and reset. */
import { execFileSync } from "node:child_process";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit, waitUntilIdle, type ObservedPage } from "./browser";
import { createHeldRun, useFixture } from "./fixture";

const HOURS = 10;
/** Copies the last minute of history to every minute of the ten hours before it. */
const EXTEND_HISTORY = `
import sqlite3, sys
db = sqlite3.connect(sys.argv[1])
rows = db.execute("SELECT * FROM task_history WHERE width = 60000 ORDER BY start DESC LIMIT 1").fetchall()
for back in range(1, 60 * ${String(HOURS)}):
    for row in rows:
        row = list(row)
        row[3] -= 60000 * back
        db.execute("INSERT INTO task_history VALUES (" + ",".join("?" * len(row)) + ") ON CONFLICT DO NOTHING", row)
db.execute("UPDATE runs SET created_at = created_at - ?", (3600000 * ${String(HOURS)},))
db.commit()
`;

const fixture = useFixture(async (server) => {
  await createHeldRun(server, "long", 16);
  await server.kill();
  execFileSync("python3", ["-c", EXTEND_HISTORY, server.databasePath]);
  await server.restart();
});

/** Range of the charts that a request has, as text; undefined for other requests. */
function rangeOf(url: string): string | undefined {
  const { pathname, searchParams } = new URL(url);
  const from = searchParams.get("from");
  return pathname.endsWith("/series") && from ? `${from} ${searchParams.get("to") ?? ""}` : undefined;
}

/** Returns the ranges that the charts of a page request, also repeatedly because the page refreshes them. */
function recordRanges(page: Page): Set<string> {
  const ranges = new Set<string>();
  page.on("request", (request) => {
    const range = rangeOf(request.url());
    if (range) ranges.add(range);
  });
  return ranges;
}

/**
 * Runs `action` and waits until the charts show the new range that they then request.
 * Returns its start and its end (Unix time, s).
 */
async function requestedRange(
  observed: ObservedPage,
  ranges: Set<string>,
  action: () => Promise<unknown>,
): Promise<[number, number]> {
  const earlier = new Set(ranges);
  const [response] = await Promise.all([
    observed.page.waitForResponse((response) => {
      const range = rangeOf(response.url());
      return range !== undefined && !earlier.has(range);
    }),
    action(),
  ]);
  await waitUntilIdle(observed);
  const query = new URL(response.url()).searchParams;
  return [Date.parse(query.get("from") ?? "") / 1000, Date.parse(query.get("to") ?? "") / 1000];
}

test("a range selected on one chart applies to all charts", async () => {
  const observed = await fixture.openPage();
  const { page, problems } = observed;
  const ranges = recordRanges(page);
  await visit(page, fixture.server.url, "/runs/long");
  const all = page.getByRole("button", { name: "All", exact: true });
  expect(await all.getAttribute("aria-pressed")).toBe("true");
  const plots = page.locator(".u-over");
  await plots.first().waitFor();
  await waitUntilIdle(observed); // all plots are drawn, so that none of them moves the first one
  expect(await plots.count()).toBeGreaterThanOrEqual(4);
  const box = await plots.first().boundingBox();
  if (!box) throw new Error("no plot is visible");

  // Selects the second quarter of the plot.
  const [from, to] = await requestedRange(observed, ranges, async () => {
    await page.mouse.move(box.x + box.width / 4, box.y + box.height / 2);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 3, box.y + box.height / 2);
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.up();
  });
  expect(to - from).toBeGreaterThan(0.23 * HOURS * 3600);
  expect(to - from).toBeLessThan(0.27 * HOURS * 3600);
  expect(await all.getAttribute("aria-pressed")).toBe("false");

  const press = (name: string) => page.getByRole("button", { name }).click();
  // "Later" moves by half of the range; "Zoom in" halves it.
  const later = await requestedRange(observed, ranges, () => press("Later"));
  expect(later[0] - from).toBeCloseTo((to - from) / 2, 0);
  expect(later[1] - later[0]).toBeCloseTo(to - from, 0);
  const zoomed = await requestedRange(observed, ranges, () => press("Zoom in"));
  expect(zoomed[1] - zoomed[0]).toBeCloseTo((to - from) / 2, 0);
  const hour = await requestedRange(observed, ranges, () => press("1 h"));
  expect(hour[1] - hour[0]).toBeCloseTo(3600, 0);

  // The CSV file holds the selected range.
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: "CSV of Skill of survival" }).click(),
  ]);
  const stream = await download.createReadStream();
  const chunks: Buffer[] = [];
  for await (const chunk of stream) chunks.push(chunk as Buffer);
  const lines = Buffer.concat(chunks).toString().trim().split("\n").slice(1);
  const times = lines.map((line) => Date.parse(line.split(",")[0] ?? "") / 1000);
  expect(times.length).toBeGreaterThan(50);
  expect(times.length).toBeLessThan(70);
  expect(Math.min(...times)).toBeGreaterThanOrEqual(hour[0] - 60);

  await plots.nth(1).dblclick();
  await expect.poll(() => all.getAttribute("aria-pressed")).toBe("true");
  expect(problems).toEqual([]);
  await page.context().close();
});
