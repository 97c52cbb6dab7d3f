// How fast the dashboard is, in a real browser before a service that runs: node scripts/measure.js http://127.0.0.1:8700
// Prints measured, goal and ratio. On an idle machine; a headless browser draws without a graphics card, so a real one is faster.
import { chromium } from "playwright-core";

const url = process.argv[2];
if (!url) {
  console.error("usage: node scripts/measure.js URL-OF-A-SERVICE");
  process.exit(2);
}
const TIMES = 7;
const FRAMES_MS = 4000;
/** Of survival: 150 debris. */
const LEVEL = 7;

const how = { executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"] };
const browser = await chromium.launch(how);
const ask = async (path, body) => {
  const answer = await fetch(
    url + path,
    body
      ? { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) }
      : {},
  );
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${await answer.text()}`);
  return answer.json();
};
const median = (values) => values.toSorted((a, b) => a - b)[Math.floor(values.length / 2)];
const say = (what, measured, unit, goal, most) =>
  console.log(
    `${what.padEnd(58)} ${measured.toFixed(1).padStart(9)} ${unit.padEnd(5)} goal ${most ? "<=" : ">="} ${goal}   ratio ${(most ? goal / measured : measured / goal).toFixed(2)}`,
  );

/** The run with the most episodes. */
async function largest() {
  const { runs } = await ask("/v1/runs?limit=500");
  const all = await Promise.all(
    runs.map(async ({ id }) => ({ id, episodes: (await ask(`/v1/runs/${id}/overview`)).episodes })),
  );
  return all.toSorted((a, b) => b.episodes - a.episodes)[0];
}

const run = await largest();
if (!run) throw new Error("the service has no runs");

async function firstChart() {
  const page = await browser.newPage();
  await page.goto(`${url}/dashboard/#/runs/${run.id}`);
  await page.locator(".uplot canvas").first().waitFor();
  const ms = await page.evaluate(() => performance.now());
  await page.close();
  return ms;
}
await firstChart(); // a browser that has seen nothing yet compiles what it sees
const charts = [];
for (let i = 0; i < TIMES; i++) charts.push(await firstChart());
say(`first chart, ${run.episodes} episodes`, median(charts), "ms", 1000, true);

/** Frames a second while a replay is scrubbed to and fro. */
async function scrubbing() {
  const many = `/v1/runs/${run.id}/episodes/search?task=kessler/survival&level=${LEVEL}&state=finished&limit=50`;
  const { episodes } = await ask(many);
  // One that goes on to the end: frames of what is left of a flight that failed early are few.
  const shown = await Promise.all(
    episodes.map(async ({ episode }) => ({
      episode,
      ...(await ask(`/v1/runs/${run.id}/episodes/${episode}`)),
    })),
  );
  const found = shown.find(({ flown }) => flown?.steps >= 50);
  if (!found) throw new Error(`no episode of survival at level ${LEVEL} is kept: let a learner come so far`);
  const { episode } = found;
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  await page.goto(`${url}/dashboard/#/runs/${run.id}/episodes/${episode}`);
  await page.locator("canvas").first().waitFor();
  const frames = await page.evaluate(
    (lasts) =>
      new Promise((done) => {
        const scrub = document.querySelector("input.scrub");
        const most = Number(scrub.max);
        let [count, at, begun] = [0, 0, performance.now()];
        requestAnimationFrame(function tick(now) {
          at = (at + 1) % (2 * most);
          scrub.value = String(at > most ? 2 * most - at : at);
          scrub.dispatchEvent(new Event("input", { bubbles: true }));
          count += 1;
          if (now - begun < lasts) requestAnimationFrame(tick);
          else done((1000 * count) / (now - begun));
        });
      }),
    FRAMES_MS,
  );
  await page.close();
  return { frames, debris: found.scenario.params.debris };
}
const { frames, debris } = await scrubbing();
say(`scrubbing a replay of ${debris} debris`, frames, "fps", 50, false);

// As somebody loads it who never did: nothing of the pages above may be in a cache.
const fresh = await chromium.launch(how);
const page = await (await fresh.newContext()).newPage();
const network = await page.context().newCDPSession(page);
await network.send("Network.enable");
await network.send("Network.setCacheDisabled", { cacheDisabled: true });
let bytes = 0;
const sized = [];
page.on("requestfinished", (request) => {
  if (new URL(request.url()).pathname.startsWith("/dashboard"))
    sized.push(request.sizes().then(({ responseBodySize }) => (bytes += responseBodySize)));
});
await page.goto(`${url}/dashboard/#/runs/${run.id}`);
await page.locator(".uplot canvas").first().waitFor();
await page.waitForTimeout(500);
await Promise.all(sized);
say("first load of the heaviest page", bytes / 1024, "KiB", 150, true);
await fresh.close();
await browser.close();
