// Measures the speed of the dashboard in a headless browser: node scripts/measure.js http://127.0.0.1:8700
// Prints the measured value, the goal and their ratio. The machine must be idle and the server running. A headless
// browser draws without a graphics card, so a browser with a window is faster.
import { chromium } from "playwright-core";

const url = process.argv[2];
if (!url) {
  console.error("usage: node scripts/measure.js SERVER_URL");
  process.exit(2);
}
/** Number of loads of which the median is reported. */
const LOADS = 7;
/** Duration of scrubbing, in milliseconds. */
const SCRUB_MS = 4000;
/** Level of kessler/survival: 150 debris. */
const LEVEL = 7;

const launchOptions = { executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"] };
const browser = await chromium.launch(launchOptions);
const request = async (path, body) => {
  const response = await fetch(
    url + path,
    body
      ? { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) }
      : {},
  );
  if (!response.ok) throw new Error(`${path}: ${response.status} ${await response.text()}`);
  return response.json();
};
const median = (values) => values.toSorted((a, b) => a - b)[Math.floor(values.length / 2)];
const report = (label, measured, unit, goal, lowerIsBetter) =>
  console.log(
    `${label.padEnd(58)} ${measured.toFixed(1).padStart(9)} ${unit.padEnd(5)} goal ${lowerIsBetter ? "<=" : ">="} ${goal}   ratio ${(lowerIsBetter ? goal / measured : measured / goal).toFixed(2)}`,
  );

/** Returns the run with the most episodes. */
async function largestRun() {
  const { runs } = await request("/v1/runs?limit=500");
  const all = await Promise.all(
    runs.map(async ({ id }) => ({ id, episodes: (await request(`/v1/runs/${id}/overview`)).episodes })),
  );
  return all.toSorted((a, b) => b.episodes - a.episodes)[0];
}

const run = await largestRun();
if (!run) throw new Error("the server has no runs");

/** Loads the page of the run and returns the milliseconds until its first chart. */
async function timeToFirstChart() {
  const page = await browser.newPage();
  await page.goto(`${url}/dashboard/#/runs/${run.id}`);
  await page.locator(".uplot canvas").first().waitFor();
  const ms = await page.evaluate(() => performance.now());
  await page.close();
  return ms;
}
await timeToFirstChart(); // warms up: a new browser compiles the scripts
const chartTimes = [];
for (let i = 0; i < LOADS; i++) chartTimes.push(await timeToFirstChart());
report(`first chart, ${run.episodes} episodes`, median(chartTimes), "ms", 1000, true);

/** Returns the frames per second while a replay is scrubbed back and forth. */
async function measureScrubbing() {
  const search = `/v1/runs/${run.id}/episodes/search?task=kessler/survival&level=${LEVEL}&state=finished&limit=50`;
  const { episodes } = await request(search);
  // Uses a long episode: the replay of an early failure has few frames.
  const details = await Promise.all(
    episodes.map(async ({ episode }) => ({
      episode,
      ...(await request(`/v1/runs/${run.id}/episodes/${episode}`)),
    })),
  );
  const longEpisode = details.find(({ flown }) => flown?.steps >= 50);
  if (!longEpisode)
    throw new Error(
      `no long episode of kessler/survival at level ${LEVEL} is stored; train a learner up to that level`,
    );
  const { episode } = longEpisode;
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  await page.goto(`${url}/dashboard/#/runs/${run.id}/episodes/${episode}`);
  await page.locator("canvas").first().waitFor();
  const frames = await page.evaluate(
    (durationMs) =>
      new Promise((resolve) => {
        const scrub = document.querySelector("input.scrub");
        const lastStep = Number(scrub.max);
        let [count, at, started] = [0, 0, performance.now()];
        requestAnimationFrame(function tick(now) {
          at = (at + 1) % (2 * lastStep);
          scrub.value = String(at > lastStep ? 2 * lastStep - at : at);
          scrub.dispatchEvent(new Event("input", { bubbles: true }));
          count += 1;
          if (now - started < durationMs) requestAnimationFrame(tick);
          else resolve((1000 * count) / (now - started));
        });
      }),
    SCRUB_MS,
  );
  await page.close();
  return { frames, debris: longEpisode.scenario.params.debris };
}
const { frames, debris } = await measureScrubbing();
report(`scrubbing a replay of ${debris} debris`, frames, "fps", 50, false);

// A first load: nothing may be in a cache.
const fresh = await chromium.launch(launchOptions);
const page = await (await fresh.newContext()).newPage();
const network = await page.context().newCDPSession(page);
await network.send("Network.enable");
await network.send("Network.setCacheDisabled", { cacheDisabled: true });
const pending = new Set();
const sizes = [];
const isPartOfDashboard = (request) => new URL(request.url()).pathname.startsWith("/dashboard");
page.on("request", (request) => {
  if (isPartOfDashboard(request)) pending.add(request);
});
page.on("requestfinished", (request) => {
  if (pending.delete(request)) sizes.push(request.sizes().then(({ responseBodySize }) => responseBodySize));
});
await page.goto(`${url}/dashboard/#/runs/${run.id}`);
await page.locator(".uplot canvas").first().waitFor();
while (pending.size > 0) await page.waitForEvent("requestfinished");
const bytes = (await Promise.all(sizes)).reduce((sum, size) => sum + size, 0);
report("first load of the heaviest page", bytes / 1024, "KiB", 150, true);
await fresh.close();
await browser.close();
