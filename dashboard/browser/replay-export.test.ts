/** Checks the files that the page of a replay saves: the frame as PNG, and the replay as GIF. */
import { copyFile, mkdir, readFile } from "node:fs/promises";
import type { Download, Page } from "playwright-core";
import { expect, test } from "vitest";
import { visit } from "./browser";
import { useFixture } from "./fixture";
import { createFlownRun, FLOWN_TASKS } from "./flown-run";

type World = keyof typeof FLOWN_TASKS;
const WORLDS = Object.keys(FLOWN_TASKS) as World[];
/** Folder of the files for people to look at; none are copied without it. */
const PICTURES = process.env["SPARRING_SCREENSHOTS"];
/** The highest speeds, so that few frames are drawn. */
const SPEEDS: Record<World, number> = { kessler: 50, docking: 50, tasking: 1800 };

const episodes: Partial<Record<World, string>> = {};
const fixture = useFixture(async (server) => {
  for (const world of WORLDS) [episodes[world]] = await createFlownRun(server, world, FLOWN_TASKS[world], 1);
});

async function save(page: Page, button: string): Promise<Download> {
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: button, exact: true }).click(),
  ]);
  return download;
}

/** Frames of a GIF: number, size, and number of the frames that differ from their predecessor in the file. */
function readGif(file: Buffer): { width: number; height: number; frames: number; distinct: number } {
  const [width, height] = [file.readUInt16LE(6), file.readUInt16LE(8)];
  let at = 13 + ((file[10] ?? 0) & 0x80 ? 3 * 2 ** (((file[10] ?? 0) & 7) + 1) : 0);
  const frames: string[] = [];
  const skipBlocks = () => {
    while (file[at] !== 0) at += 1 + (file[at] ?? 0);
    at += 1;
  };
  while (file[at] !== 0x3b) {
    if (file[at] === 0x21) {
      at += 2;
      skipBlocks();
      continue;
    }
    if (file[at] !== 0x2c) throw new Error(`no block begins at byte ${String(at)}`);
    const flags = file[at + 9] ?? 0;
    at += 10 + (flags & 0x80 ? 3 * 2 ** ((flags & 7) + 1) : 0) + 1;
    const start = at;
    skipBlocks();
    frames.push(file.subarray(start, at).toString("base64"));
  }
  return { width, height, frames: frames.length, distinct: new Set(frames).size };
}

async function keep(download: Download, name: string) {
  if (!PICTURES) return;
  await mkdir(PICTURES, { recursive: true });
  await copyFile(await download.path(), `${PICTURES}/${name}`);
}

for (const world of WORLDS) {
  test(`${world}: the frame is saved as PNG and the replay as GIF`, async () => {
    const dark = world === "docking";
    const { page, problems } = await fixture.openPage({ dark, width: 1440, height: 900 });
    const episode = episodes[world] ?? "";
    const route = `/runs/${world}/episodes/${episode}?step=5&speed=${String(SPEEDS[world])}`;
    await visit(page, fixture.server.url, route);
    const png = await save(page, "PNG");
    expect(png.suggestedFilename()).toBe(`${episode}-step-5.png`);
    const picture = await readFile(await png.path());
    expect(picture.subarray(1, 4).toString()).toBe("PNG");
    const [pngWidth, pngHeight] = [picture.readUInt32BE(16), picture.readUInt32BE(20)];
    expect(Math.min(pngWidth, pngHeight)).toBeGreaterThan(800);
    await keep(png, `${world}.png`);

    const gif = await save(page, "GIF");
    expect(gif.suggestedFilename()).toBe(`${episode}.gif`);
    const animation = await readFile(await gif.path());
    expect(animation.subarray(0, 6).toString()).toBe("GIF89a");
    const { width, height, frames, distinct } = readGif(animation);
    expect(Math.min(width, height)).toBeGreaterThan(280);
    expect(frames).toBeGreaterThan(10);
    expect(distinct).toBeGreaterThan(0.8 * frames); // the picture moves
    await keep(gif, `${world}.gif`);
    // The browser decodes it.
    const decoded = await page.evaluate(async (text) => {
      const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
      const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/gif" }));
      return [bitmap.width, bitmap.height];
    }, animation.toString("base64"));
    expect(decoded).toEqual([width, height]);
    expect(problems).toEqual([]);
    await page.context().close();
  });
}

test("a comparison is part of the files, and a GIF can be cancelled", async () => {
  const { page, problems } = await fixture.openPage();
  const route = `/runs/kessler/episodes/${episodes.kessler ?? ""}`;
  await visit(page, fixture.server.url, `${route}?step=5`);
  const alone = await readFile(await (await save(page, "PNG")).path());
  await page.getByLabel("Compare with").selectOption("hold");
  await expect.poll(() => page.locator("canvas").count()).toBe(2);
  const both = await readFile(await (await save(page, "PNG")).path());
  expect(both.readUInt32BE(16)).toBeGreaterThan(1.8 * alone.readUInt32BE(16));
  await page.getByLabel("Speed").selectOption("1 step/s"); // many frames
  await page.getByRole("button", { name: "GIF", exact: true }).click();
  await page.getByRole("progressbar", { name: "Frames of the GIF" }).waitFor();
  await page.getByRole("button", { name: "Cancel" }).click();
  await page.getByRole("button", { name: "GIF", exact: true }).waitFor();
  expect(problems).toEqual([]);
  await page.context().close();
});
