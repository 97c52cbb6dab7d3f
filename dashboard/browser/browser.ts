/** Chromium as Debian packs it, and a page that remembers what went wrong in it. */
import { mkdirSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { chromium, type Browser, type Page } from "playwright-core";

const EXECUTABLE = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
/** Where pictures of every page go. */
export const SHOTS =
  process.env["SPARRING_SHOTS"] ??
  fileURLToPath(new URL("../../target/dashboard-screenshots", import.meta.url));
mkdirSync(SHOTS, { recursive: true });

export function launch(): Promise<Browser> {
  // Tests run as root in containers, where Chromium has no sandbox.
  const quiet = [
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
  ];
  return chromium.launch({ executablePath: EXECUTABLE, args: ["--no-sandbox", ...quiet] });
}

export interface Watched {
  page: Page;
  /** Errors of scripts, of the console, and requests to other addresses. */
  wrong: string[];
}

export interface Look {
  dark?: boolean;
  width?: number;
  height?: number;
}

export async function open(
  browser: Browser,
  url: string,
  { dark = false, width = 1280, height = 900 }: Look = {},
): Promise<Watched> {
  const context = await browser.newContext({
    viewport: { width, height },
    colorScheme: dark ? "dark" : "light",
    timezoneId: "America/New_York",
  });
  const page = await context.newPage();
  const wrong: string[] = [];
  page.on("pageerror", (error) => wrong.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") wrong.push(`${message.text()} ${message.location().url}`);
  });
  page.on("request", (request) => {
    const to = request.url();
    if (!to.startsWith(url) && !to.startsWith("data:") && !to.startsWith("blob:"))
      wrong.push(`a request to ${to}`);
  });
  page.on("dialog", (dialog) => {
    wrong.push(`a dialog: ${dialog.message()}`);
    void dialog.dismiss();
  });
  return { page, wrong };
}

/** Goes to a place of the dashboard and waits until it has loaded what it shows. */
export async function go(page: Page, url: string, place: string) {
  await page.goto(`${url}/dashboard/#${place}`);
  await settled(page);
}

export async function settled(page: Page) {
  await page.locator("main :is(h1, h2)").first().waitFor();
  await page.waitForFunction(() => !/Loading …/.test(document.querySelector("main")?.textContent ?? ""));
}
