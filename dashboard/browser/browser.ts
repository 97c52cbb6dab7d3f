/** Starts Chromium and opens pages that record their errors. */
import { mkdirSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { chromium, type Browser, type Page, type Request } from "playwright-core";
import { waitFor } from "./poll";

/** Path of Chromium; the default is the one of Debian's package. */
const EXECUTABLE = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
/** Folder of the screenshots of all pages. */
export const SCREENSHOT_FOLDER =
  process.env["SPARRING_SHOTS"] ??
  fileURLToPath(new URL("../../target/dashboard-screenshots", import.meta.url));
mkdirSync(SCREENSHOT_FOLDER, { recursive: true });
/** Time that an action on a page may take: generous, because machines that run tests are often busy. */
const ACTION_TIMEOUT_MS = 120_000;
/** A page is idle if its document has not changed for this long. */
const QUIET_MS = 200;

export function launchBrowser(): Promise<Browser> {
  const quiet = [
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
  ];
  // Tests run as root in containers, where Chromium has no sandbox.
  return chromium.launch({ executablePath: EXECUTABLE, args: ["--no-sandbox", ...quiet] });
}

export interface ObservedPage {
  page: Page;
  /** Errors of scripts and of the console, dialogs, and requests to other addresses. */
  problems: string[];
  /** Requests without a response so far, event streams excepted. */
  pending: Set<Request>;
}

export interface PageOptions {
  dark?: boolean;
  width?: number;
  height?: number;
}

/** Opens an empty page in a context of its own; `url` is the only address that it may send requests to. */
export async function openPage(
  browser: Browser,
  url: string,
  { dark = false, width = 1280, height = 900 }: PageOptions = {},
): Promise<ObservedPage> {
  const context = await browser.newContext({
    viewport: { width, height },
    colorScheme: dark ? "dark" : "light",
    timezoneId: "America/New_York",
  });
  context.setDefaultTimeout(ACTION_TIMEOUT_MS);
  const page = await context.newPage();
  return { page, problems: recordProblems(page, url), pending: recordPendingRequests(page) };
}

function recordProblems(page: Page, url: string): string[] {
  const problems: string[] = [];
  page.on("pageerror", (error) => problems.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") problems.push(`${message.text()} ${message.location().url}`);
  });
  page.on("request", (request) => {
    const target = request.url();
    if (!target.startsWith(url) && !target.startsWith("data:") && !target.startsWith("blob:"))
      problems.push(`request to ${target}`);
  });
  page.on("dialog", (dialog) => {
    problems.push(`dialog: ${dialog.message()}`);
    void dialog.dismiss();
  });
  return problems;
}

function recordPendingRequests(page: Page): Set<Request> {
  const pending = new Set<Request>();
  page.on("request", (request) => {
    if (!new URL(request.url()).pathname.endsWith("/events")) pending.add(request);
  });
  page.on("requestfinished", (request) => pending.delete(request));
  page.on("requestfailed", (request) => pending.delete(request));
  return pending;
}

/** Opens a route of the dashboard and waits until its data is loaded. */
export async function visit(page: Page, url: string, route: string) {
  await page.goto(`${url}/dashboard/#${route}`);
  await waitUntilLoaded(page);
}

export async function waitUntilLoaded(page: Page) {
  await page.locator("main :is(h1, h2)").first().waitFor();
  await page.waitForFunction(() => !/Loading …/.test(document.querySelector("main")?.textContent ?? ""));
}

/** Waits until all requests have their response and the document no longer changes: charts are drawn. */
export async function waitUntilIdle({ page, pending }: ObservedPage) {
  const countPending = () => Promise.resolve(pending.size);
  do {
    await waitFor(countPending, (count) => count === 0);
    await page.evaluate(
      (quietMs) =>
        new Promise<void>((resolve) => {
          const finish = () => {
            observer.disconnect();
            resolve();
          };
          let timer = setTimeout(finish, quietMs);
          const observer = new MutationObserver(() => {
            clearTimeout(timer);
            timer = setTimeout(finish, quietMs);
          });
          observer.observe(document, {
            subtree: true,
            childList: true,
            attributes: true,
            characterData: true,
          });
        }),
      QUIET_MS,
    );
  } while (pending.size > 0);
}
