/**
 * Compares the gallery with its snapshots, which show when a chart, a column or a colour changes or vanishes.
 *
 * Snapshots are screenshots reduced to the mean colours of blocks (see block-image.ts). The gallery brings its own font, and its letters
 * have the same widths on every machine (gallery.css), so that lines break at the same words; the texts on canvases may
 * differ. SPARRING_SNAPSHOTS=write writes the snapshots anew: look at them before you commit them.
 */
import { existsSync } from "node:fs";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import { PNG } from "pngjs";
import { expect, test } from "vitest";
import { describeDifference, reduceToBlocks } from "./block-image";
import { SCREENSHOT_FOLDER } from "./browser";
import { useGallery, type Section } from "./gallery";

const FOLDER = fileURLToPath(new URL("./snapshots", import.meta.url));
const isWriting = process.env["SPARRING_SNAPSHOTS"] === "write";

/** Height to which a section is compared, in pixels: long tables repeat themselves below. */
const MAX_HEIGHT = 3600;

interface Snapshot {
  section: Section;
  dark?: boolean;
  phone?: boolean;
  /** Elements with symbols that the font of the gallery lacks, so that their width depends on the machine; they are left out. */
  omitted?: string;
}
const SNAPSHOTS: Snapshot[] = [
  { section: "charts" },
  { section: "charts", dark: true },
  { section: "distributions" },
  { section: "replay", omitted: '[aria-label="Replay"] .buttons, [aria-label="Episodes of the group"]' },
  { section: "table" },
  { section: "table", phone: true },
  { section: "tasks" },
  { section: "tasks", phone: true },
  { section: "run" },
  { section: "compare" },
  { section: "workers", dark: true },
  { section: "workers", phone: true },
];

const gallery = useGallery();

/** Takes the screenshot of a section, reduced to blocks. */
async function take({ section, dark = false, phone = false, omitted }: Snapshot, style = ""): Promise<PNG> {
  const size = phone ? { width: 390, height: 844 } : { width: 1200, height: 900 };
  const { page } = await gallery().open(section, { dark, ...size });
  // The list of sections is omitted too, so that a new section changes no snapshot.
  const selector = ["main > nav", ...(omitted ? [omitted] : [])].join(", ");
  await page.addStyleTag({ content: `${selector} { display: none !important } ${style}` });
  const height = await page.evaluate(() => document.documentElement.scrollHeight);
  const clip = { x: 0, y: 0, width: size.width, height: Math.min(height, MAX_HEIGHT) };
  const screenshot = await page.screenshot({ fullPage: true, clip, animations: "disabled" });
  await page.context().close();
  return reduceToBlocks(screenshot);
}

const nameOf = ({ section, dark, phone }: Snapshot) =>
  `${section}-${phone ? "phone" : "window"}-${dark ? "dark" : "light"}`;

test.each(SNAPSHOTS.map((snapshot) => ({ name: nameOf(snapshot), snapshot })))(
  "$name looks like its snapshot",
  async ({ name, snapshot }) => {
    const file = `${FOLDER}/${name}.png`;
    const actual = await take(snapshot);
    const written = PNG.sync.write(actual, { colorType: 2 }); // without an alpha channel
    if (isWriting) {
      await mkdir(FOLDER, { recursive: true });
      await writeFile(file, written);
    }
    await writeFile(`${SCREENSHOT_FOLDER}/snapshot-${name}.png`, written);
    expect(existsSync(file), `${file}: SPARRING_SNAPSHOTS=write creates it`).toBe(true);
    const difference = describeDifference(actual, PNG.sync.read(await readFile(file)));
    expect(difference, `${name}: compare with ${SCREENSHOT_FOLDER}/snapshot-${name}.png`).toBe("");
  },
);

test("a chart that vanishes, a missing curve and another colour are differences", async () => {
  const snapshot = { section: "charts" } as const;
  const expected = await take(snapshot);
  expect(describeDifference(await take(snapshot), expected)).toBe("");
  const first = ".charts > .case:first-child";
  for (const style of [
    `${first} .plot canvas { visibility: hidden }`,
    `${first} .u-legend tr:nth-child(2) { visibility: hidden }`,
    ":root { --card: #f4e8e8 !important }",
  ])
    expect(describeDifference(await take(snapshot, style), expected), style).not.toBe("");
});
