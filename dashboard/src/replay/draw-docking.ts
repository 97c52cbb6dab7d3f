/** Draws a frame of a docking replay: two projections, and the speed of each deputy with its limit over the distance. */
import { agentColour, drawCross, traceCircle, type Palette } from "./canvas-shapes";
import type { DockingFrame, Deputy } from "./frames";

/** Projection of positions to a plane. */
interface Projection {
  title: string;
  project: (deputy: Deputy) => [number, number];
}

const PROJECTIONS: Projection[] = [
  { title: "right: radial (m), up: in-track (m)", project: (deputy) => [deputy.x, deputy.y] },
  { title: "right: radial (m), up: cross-track (m)", project: (deputy) => [deputy.x, deputy.z] },
];

/** Largest distances of the deputies in a replay, in metres. */
export interface Reach {
  /** Largest distance along one axis. */
  along: number;
  /** Largest distance from the chief. */
  away: number;
}

/** Returns the reach of all frames, with a margin of a tenth. */
export function maxReach(frames: DockingFrame[]): Reach {
  let [along, away] = [10, 10];
  for (const frame of frames)
    for (const d of frame.state.deputies) {
      along = Math.max(along, Math.abs(d.x), Math.abs(d.y), Math.abs(d.z));
      away = Math.max(away, d.distance);
    }
  return { along: 1.1 * along, away: 1.1 * away };
}

/** Width in pixels below which the pictures are stacked. */
const NARROW_WIDTH = 560;

/** Returns the total height of the three pictures, in pixels. */
export function heightOf(width: number): number {
  return width < NARROW_WIDTH ? 2.7 * width : Math.max(260, width / 3);
}

/** Returns the upper left corners of the three square pictures, and their size. */
function pictureSquares(width: number): { corners: [number, number][]; size: number } {
  const [across, down] = width < NARROW_WIDTH ? [1, 3] : [3, 1];
  const [w, h] = [width / across, heightOf(width) / down];
  const size = Math.min(w - 24, h) - 48;
  const corners = [0, 1, 2].map((i): [number, number] => [
    (i % across) * w + (w - size) / 2,
    Math.floor(i / across) * h + (h - size) / 2,
  ]);
  return { corners, size };
}

/** Draws frame `at` with trails of `trail` steps. */
export function drawDocking(
  ctx: CanvasRenderingContext2D,
  width: number,
  frames: DockingFrame[],
  at: number,
  trail: number,
  reach: Reach,
  colours: Palette,
) {
  const frame = frames[at];
  if (!frame) return;
  ctx.fillStyle = colours.paper;
  ctx.fillRect(0, 0, width, heightOf(width));
  const { corners, size } = pictureSquares(width);
  PROJECTIONS.forEach(({ title, project }, i) => {
    const [left, top] = corners[i] ?? [0, 0];
    const [cx, cy] = [left + size / 2, top + size / 2];
    const scale = size / (2 * reach.along);
    const edge = formatLength(reach.along);
    ctx.strokeStyle = colours.line;
    ctx.lineWidth = 1;
    ctx.strokeRect(left, top, size, size);
    ctx.fillStyle = colours.soft;
    ctx.fillText(title, left, top - 6);
    drawAxisEnds(ctx, [left, top, size], [`−${edge}`, edge], [`−${edge}`, edge]);
    traceCircle(ctx, cx, cy, 4);
    ctx.fillStyle = colours.earth;
    ctx.fill();
    for (const deputy of frame.state.deputies) {
      const colour = agentColour(colours, deputy.id);
      ctx.strokeStyle = colour;
      ctx.lineWidth = 1.5;
      ctx.beginPath();
      for (let k = Math.max(0, at - trail); k <= at; k++) {
        const past = frames[k]?.state.deputies[deputy.id];
        if (!past) continue;
        const [x, y] = project(past);
        if (k === Math.max(0, at - trail)) ctx.moveTo(cx + x * scale, cy - y * scale);
        else ctx.lineTo(cx + x * scale, cy - y * scale);
      }
      ctx.stroke();
      const [x, y] = project(deputy);
      drawDeputy(ctx, cx + x * scale, cy - y * scale, deputy, colour, colours.bad);
    }
  });
  const [left, top] = corners[2] ?? [0, 0];
  drawSpeedLimit(ctx, left, top, size, frame, reach.away, colours);
}

/** Formats a length or speed with few digits. */
function formatLength(value: number): string {
  return value >= 10 ? value.toFixed(0) : value.toFixed(1);
}

/** Labels both ends of the axes of a square. */
function drawAxisEnds(
  ctx: CanvasRenderingContext2D,
  [left, top, size]: [number, number, number],
  along: [string, string],
  up: [string, string],
) {
  const previousAlign = ctx.textAlign;
  ctx.fillText(along[0], left, top + size + 14);
  ctx.textAlign = "right";
  ctx.fillText(along[1], left + size, top + size + 14);
  ctx.fillText(up[0], left - 4, top + size);
  ctx.fillText(up[1], left - 4, top + 10);
  ctx.textAlign = previousAlign;
}

function drawDeputy(
  ctx: CanvasRenderingContext2D,
  x: number,
  y: number,
  deputy: Deputy,
  colour: string,
  bad: string,
) {
  if (deputy.status === "active" || deputy.status === "docked") {
    traceCircle(ctx, x, y, deputy.status === "docked" ? 6 : 4);
    ctx.fillStyle = colour;
    ctx.fill();
    ctx.fillText(String(deputy.id), x + 7, y - 7);
  } else {
    drawCross(ctx, x, y, 6, bad);
  }
}

/** Draws speed over distance, and the limit above which a deputy is penalised. */
function drawSpeedLimit(
  ctx: CanvasRenderingContext2D,
  left: number,
  top: number,
  size: number,
  frame: DockingFrame,
  reach: number,
  colours: Palette,
) {
  const deputies = frame.state.deputies;
  const first = deputies[0];
  if (!first) return;
  const slope = first.distance > 0 ? (first.speed_limit - 0.2) / first.distance : 0;
  const fastest = 1.1 * Math.max(0.2 + slope * reach, ...deputies.map((deputy) => deputy.speed));
  const px = (distance: number) => left + (size * Math.min(distance, reach)) / reach;
  const py = (speed: number) => top + size - (size * speed) / fastest;
  ctx.strokeStyle = colours.line;
  ctx.strokeRect(left, top, size, size);
  ctx.fillStyle = colours.soft;
  ctx.fillText("right: distance (m), up: speed (m/s)", left, top - 6);
  drawAxisEnds(ctx, [left, top, size], ["0", formatLength(reach)], ["0", formatLength(fastest)]);
  ctx.strokeStyle = colours.bad;
  ctx.setLineDash([6, 4]);
  ctx.beginPath();
  ctx.moveTo(px(0), py(0.2));
  ctx.lineTo(px(reach), py(0.2 + slope * reach));
  ctx.stroke();
  ctx.setLineDash([]);
  for (const deputy of deputies) {
    const colour = agentColour(colours, deputy.id);
    drawDeputy(ctx, px(deputy.distance), py(deputy.speed), deputy, colour, colours.bad);
  }
}
