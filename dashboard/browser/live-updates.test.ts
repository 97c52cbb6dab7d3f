/** Checks live updates: events appear without a reload, also after a restart of the server. */
import { readFile } from "node:fs/promises";
import { expect, test } from "vitest";
import { visit } from "./browser";
import { createHeldRun, useFixture } from "./fixture";
import { reportHeldEpisodes } from "./server";

const fixture = useFixture(async (server) => {
  await createHeldRun(server, "run", 16);
});

test("events appear live and once, also after a restart", async () => {
  const { server } = fixture;
  const { page } = await fixture.openPage();
  await visit(page, server.url, "/runs/run?tab=activity");
  const status = page.getByRole("status");
  await page.getByText("live", { exact: true }).waitFor();
  await reportHeldEpisodes(server, "run", 8);
  await page.locator(".events li").filter({ hasText: "succeeded" }).first().waitFor();
  const events = page.locator(".events li");
  await expect.poll(() => events.count()).toBeGreaterThanOrEqual(8);
  const countBefore = await events.count();
  const episodes = page
    .locator("dl div")
    .filter({ hasText: /^Episodes\s*\d/ })
    .locator("dd");
  await expect.poll(() => episodes.textContent()).toBe("24");

  await server.kill();
  await expect.poll(() => status.textContent()).toContain("not live");
  await server.restart();
  await page.getByText("live", { exact: true }).waitFor();
  await reportHeldEpisodes(server, "run", 8);
  await expect.poll(() => episodes.textContent()).toBe("32");
  await expect.poll(() => events.count()).toBeGreaterThan(countBefore + 8);
  // The stream resumes after the last event: none is shown twice.
  const ids = await events.evaluateAll((lines) =>
    lines.map((line) => (line as HTMLElement).dataset["event"]),
  );
  expect(new Set(ids).size).toBe(ids.length);
  await page.context().close();
});

test("a chart exports its values as CSV", async () => {
  const { server } = fixture;
  const { page, problems } = await fixture.openPage();
  await visit(page, server.url, "/runs/run");
  await page.getByRole("heading", { name: "Mastery of survival" }).waitFor();
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: "CSV of Mastery of survival" }).click(),
  ]);
  const text = await readFile(await download.path(), "utf8");
  const [header, firstRow] = text.split("\n");
  expect(header).toBe(
    'time,"mastery","mastery, low","mastery, high","contested scenarios","all episodes","blind panel"',
  );
  expect(firstRow).toMatch(/^\d{4}-\d\d-\d\dT/);
  const series = await server.get<{ tasks: { success: number[] }[] }>("/v1/runs/run/series?points=600");
  expect(Number(firstRow?.split(",")[5])).toBeCloseTo(series.tasks[0]?.success[0] ?? NaN, 9);
  expect(problems).toEqual([]);
  await page.context().close();
});
