/** Time on the charts of a run: chosen by dragging, moved along, and left again, the same for all of them. */
import { execFileSync } from "node:child_process";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { go, launch, open } from "./browser";
import { hold, Sparring } from "./sparring";

const HOURS = 10;
/** Its last minute of history once more in each of the minutes before: a run of ten hours. */
const LENGTHEN = `
import sqlite3, sys
db = sqlite3.connect(sys.argv[1])
rows = db.execute("SELECT * FROM history WHERE width = 60000 ORDER BY start DESC LIMIT 1").fetchall()
for back in range(1, 60 * ${String(HOURS)}):
    for row in rows:
        row = list(row)
        row[3] -= 60000 * back
        db.execute("INSERT INTO history VALUES (" + ",".join("?" * len(row)) + ") ON CONFLICT DO NOTHING", row)
db.execute("UPDATE runs SET created_at = created_at - ?", (3600000 * ${String(HOURS)},))
db.commit()
`;

let browser: Browser;
let service: Sparring;
beforeAll(async () => {
  [browser, service] = [await launch(), await Sparring.start()];
  await service.post("/v1/runs", {
    id: "long",
    seed: 7,
    tasks: ["kessler/survival"],
    design: { designer: "off" },
  });
  await hold(service, "long", 16);
  await service.kill();
  execFileSync("python3", ["-c", LENGTHEN, service.db]);
  await service.again();
});
afterAll(async () => {
  await browser.close();
  await service.end();
});

/** How long all the charts say that they show, in seconds: by what the service was asked for last. */
async function asked(page: Page, act: () => Promise<unknown>): Promise<[number, number]> {
  const [answer] = await Promise.all([
    page.waitForResponse(
      (response) => response.url().includes("/series?") && response.url().includes("from="),
    ),
    act(),
  ]);
  const words = new URL(answer.url()).searchParams;
  return [Date.parse(words.get("from") ?? ""), Date.parse(words.get("to") ?? "")].map((at) => at / 1000) as [
    number,
    number,
  ];
}

test("a stretch is chosen on one chart, and all of them show it", async () => {
  const { page, wrong } = await open(browser, service.url);
  await go(page, service.url, "/runs/long");
  const all = page.getByRole("button", { name: "All", exact: true });
  expect(await all.getAttribute("aria-pressed")).toBe("true");
  const plots = page.locator(".u-over");
  await plots.first().waitFor();
  expect(await plots.count()).toBeGreaterThanOrEqual(4);
  const box = await plots.first().boundingBox();
  if (!box) throw new Error("there is no plot");

  // A quarter of it, from the first to the second.
  const [from, to] = await asked(page, async () => {
    await page.mouse.move(box.x + box.width / 4, box.y + box.height / 2);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width / 3, box.y + box.height / 2);
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.up();
  });
  expect(to - from).toBeGreaterThan(0.23 * HOURS * 3600);
  expect(to - from).toBeLessThan(0.27 * HOURS * 3600);
  expect(await all.getAttribute("aria-pressed")).toBe("false");

  // Along by half of what is shown, nearer to half of it, and back again.
  const later = await asked(page, () => page.getByRole("button", { name: "Later" }).click());
  expect(later[0] - from).toBeCloseTo((to - from) / 2, 0);
  expect(later[1] - later[0]).toBeCloseTo(to - from, 0);
  const nearer = await asked(page, () => page.getByRole("button", { name: "Nearer" }).click());
  expect(nearer[1] - nearer[0]).toBeCloseTo((to - from) / 2, 0);
  const hour = await asked(page, () => page.getByRole("button", { name: "1 h" }).click());
  expect(hour[1] - hour[0]).toBeCloseTo(3600, 0);

  // What is given as CSV is what is shown.
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
  expect(wrong).toEqual([]);
  await page.context().close();
});
