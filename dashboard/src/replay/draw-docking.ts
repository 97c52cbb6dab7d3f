/** Draws a frame of a docking replay: two projections, and the speed of each deputy with its limit over the distance. */
import { agentColour, agentOpacity, drawCross, traceCircle, type Palette } from "./canvas-shapes";
import type { DockingFrame, Deputy } from "./frames";

/** Vector in the axes of the chief: radial, in-track and cross-track. */
export type Vector = [number, number, number];

/** Projection of positions to a plane. */
interface Projection {
  across: string;
  up: string;
  project: (vector: Vector) => [number, number];
}

const PROJECTIONS: Projection[] = [
  { across: "radial (m)", up: "in-track (m)", project: ([x, y]) => [x, y] },
  { across: "radial (m)", up: "cross-track (m)", project: ([x, , z]) => [x, z] },
];

/** Largest distances that a picture shows, in metres. */
interface Reach {
  /** Largest distance along one axis. */
  along: number;
  /** Largest distance from the chief. */
  away: number;
}

/** Mapping of one projection to pixels. */
export interface DockingPicture {
  ctx: CanvasRenderingContext2D;
  colours: Palette;
  /** Returns the pixel of a position in metres. */
  at: (position: Vector) => [number, number];
  /** Returns the direction on the page of a vector, in its unit, with up as −y. */
  direction: (vector: Vector) => [number, number];
  size: number;
  /** True for the projection to the plane of the orbit. */
  isOrbitPlane: boolean;
}

/** View of a docking replay. */
export interface DockingView {
  frames: DockingFrame[];
  at: number;
  /** Length of the trails, in steps. */
  trail: number;
  /** Agent that is emphasised; null for all. */
  chosen?: number | null;
  /** Draws below the deputies of each projection. */
  underlay?: ((picture: DockingPicture) => void) | undefined;
}

/** Round numbers of a decade to which a reach is rounded up, so that a replay zooms in steps. */
const ZOOM_STEPS = [1, 1.5, 2, 3, 5, 7, 10];
/** Smallest reach of a picture, in metres. */
const MIN_REACH = 10;

/** Returns the reach of the deputies in the frames of the trail, rounded up to a round number. */
export function reachAt(frames: DockingFrame[], at: number, trail: number): Reach {
  let [along, away] = [0, 0];
  for (const frame of frames.slice(Math.max(0, at - trail), at + 1))
    for (const d of frame.state.deputies) {
      along = Math.max(along, Math.abs(d.x), Math.abs(d.y), Math.abs(d.z));
      away = Math.max(away, d.distance);
    }
  return { along: roundUp(1.15 * along), away: roundUp(1.15 * away) };
}

function roundUp(value: number): number {
  const decade = 10 ** Math.floor(Math.log10(Math.max(value, MIN_REACH)));
  return decade * (ZOOM_STEPS.find((step) => step * decade >= value) ?? 10);
}

/** Space around a square for the labels of its axes, in pixels. */
const MARGIN = { left: 46, right: 10, top: 10, bottom: 34 };
const PICTURES = 3;
/** Space around a square for the numbers of deputies at its edge, in pixels. */
const LABEL_SPACE = 8;

/** Arrangement of the three squares in rows and columns. */
interface Arrangement {
  columns: number;
  side: number;
  height: number;
}

/** Returns the arrangement with the largest squares that fit a width and, if possible, a height. */
function arrange(width: number, maxHeight: number): Arrangement {
  const options = [1, 2, 3].map((columns): Arrangement => {
    const rows = Math.ceil(PICTURES / columns);
    const widest = width / columns - MARGIN.left - MARGIN.right;
    const side = Math.floor(Math.min(widest, maxHeight / rows - MARGIN.top - MARGIN.bottom));
    return { columns, side, height: rows * (side + MARGIN.top + MARGIN.bottom) };
  });
  const [best] = options.sort((a, b) => b.side - a.side);
  const narrow = Math.max(60, Math.floor(width - MARGIN.left - MARGIN.right));
  if (best && best.side >= 60) return best;
  return { columns: 1, side: narrow, height: PICTURES * (narrow + MARGIN.top + MARGIN.bottom) };
}

/** Returns the total height of the three pictures, in pixels. */
export function heightOf(width: number, maxHeight: number): number {
  return arrange(width, maxHeight).height;
}

/** Returns the upper left corners of the three squares, and their size. */
function pictureSquares(width: number, height: number): { corners: [number, number][]; size: number } {
  const { columns, side } = arrange(width, height);
  const cell = side + MARGIN.left + MARGIN.right;
  const free = (width - columns * cell) / 2;
  const corners = [0, 1, 2].map((i): [number, number] => [
    free + (i % columns) * cell + MARGIN.left,
    Math.floor(i / columns) * (side + MARGIN.top + MARGIN.bottom) + MARGIN.top,
  ]);
  return { corners, size: side };
}

/** Draws a frame into a canvas of a width and height in pixels. */
export function drawDocking(
  ctx: CanvasRenderingContext2D,
  width: number,
  height: number,
  view: DockingView,
  colours: Palette,
) {
  const { frames, at, trail } = view;
  const reach = reachAt(frames, at, trail);
  const frame = frames[at];
  if (!frame) return;
  ctx.fillStyle = colours.paper;
  ctx.fillRect(0, 0, width, height);
  const { corners, size } = pictureSquares(width, height);
  PROJECTIONS.forEach(({ across, up, project }, i) => {
    const [left, top] = corners[i] ?? [0, 0];
    const scale = size / (2 * reach.along);
    const direction = (vector: Vector): [number, number] => {
      const [right, upwards] = project(vector);
      return [right, -upwards];
    };
    const pixel = (position: Vector): [number, number] => {
      const [dx, dy] = direction(position);
      return [left + size / 2 + dx * scale, top + size / 2 + dy * scale];
    };
    const edge = formatLength(reach.along);
    const ends: [string, string] = [`−${edge}`, edge];
    drawFrame(ctx, [left, top, size], { across, up, acrossEnds: ends, upEnds: ends }, colours);
    ctx.save();
    ctx.beginPath();
    ctx.rect(left - LABEL_SPACE, top - LABEL_SPACE, size + 2 * LABEL_SPACE, size + 2 * LABEL_SPACE);
    ctx.clip();
    view.underlay?.({ ctx, colours, at: pixel, direction, size, isOrbitPlane: i === 0 });
    traceCircle(ctx, ...pixel([0, 0, 0]), 4);
    ctx.fillStyle = colours.earth;
    ctx.fill();
    drawDeputies(ctx, view, pixel, colours);
    ctx.restore();
  });
  drawSpeedLimit(
    ctx,
    corners[2] ?? [0, 0],
    size,
    frame,
    { away: reach.away, chosen: view.chosen ?? null },
    colours,
  );
}

/** Draws the trails and places of all deputies in one projection. */
function drawDeputies(
  ctx: CanvasRenderingContext2D,
  { frames, at, trail, chosen = null }: DockingView,
  pixel: (position: Vector) => [number, number],
  colours: Palette,
) {
  const from = Math.max(0, at - trail);
  for (const deputy of frames[at]?.state.deputies ?? []) {
    const colour = agentColour(colours, deputy.id);
    ctx.globalAlpha = agentOpacity(deputy.id, chosen);
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    for (let k = from; k <= at; k++) {
      const past = frames[k]?.state.deputies[deputy.id];
      if (past) ctx.lineTo(...pixel([past.x, past.y, past.z]));
    }
    ctx.stroke();
    drawDeputy(ctx, pixel([deputy.x, deputy.y, deputy.z]), deputy, colour, colours.bad);
  }
  ctx.globalAlpha = 1;
}

/** Formats a length or speed with few digits. */
function formatLength(value: number): string {
  return value >= 10 ? value.toFixed(0) : value.toFixed(1);
}

/** Labels of the two axes of a square. */
interface AxisLabels {
  across: string;
  up: string;
  acrossEnds: [string, string];
  upEnds: [string, string];
}

/** Draws the outline of a square with the quantities of its axes and their ends. */
function drawFrame(
  ctx: CanvasRenderingContext2D,
  [left, top, size]: [number, number, number],
  { across, up, acrossEnds, upEnds }: AxisLabels,
  colours: Palette,
) {
  ctx.strokeStyle = colours.line;
  ctx.lineWidth = 1;
  ctx.strokeRect(left, top, size, size);
  ctx.fillStyle = colours.soft;
  ctx.textAlign = "center";
  ctx.fillText(across, left + size / 2, top + size + 16);
  ctx.save();
  ctx.translate(left - 8, top + size / 2);
  ctx.rotate(-Math.PI / 2);
  ctx.fillText(up, 0, 0);
  ctx.restore();
  ctx.textAlign = "left";
  ctx.fillText(acrossEnds[0], left, top + size + 16);
  ctx.textAlign = "right";
  ctx.fillText(acrossEnds[1], left + size, top + size + 16);
  ctx.fillText(upEnds[0], left - 4, top + size);
  ctx.fillText(upEnds[1], left - 4, top + 10);
  ctx.textAlign = "start";
}

function drawDeputy(
  ctx: CanvasRenderingContext2D,
  [x, y]: [number, number],
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
  [left, top]: [number, number],
  size: number,
  frame: DockingFrame,
  { away, chosen }: { away: number; chosen: number | null },
  colours: Palette,
) {
  const deputies = frame.state.deputies;
  const first = deputies[0];
  if (!first) return;
  const slope = first.distance > 0 ? (first.speed_limit - 0.2) / first.distance : 0;
  const fastest = 1.1 * Math.max(0.2 + slope * away, ...deputies.map((deputy) => deputy.speed));
  const px = (distance: number) => left + (size * Math.min(distance, away)) / away;
  const py = (speed: number) => top + size - (size * speed) / fastest;
  const labels = { across: "distance (m)", up: "speed (m/s)" };
  const acrossEnds: [string, string] = ["0", formatLength(away)];
  const upEnds: [string, string] = ["0", formatLength(fastest)];
  drawFrame(ctx, [left, top, size], { ...labels, acrossEnds, upEnds }, colours);
  ctx.strokeStyle = colours.bad;
  ctx.setLineDash([6, 4]);
  ctx.beginPath();
  ctx.moveTo(px(0), py(0.2));
  ctx.lineTo(px(away), py(0.2 + slope * away));
  ctx.stroke();
  ctx.setLineDash([]);
  for (const deputy of deputies) {
    const colour = agentColour(colours, deputy.id);
    ctx.globalAlpha = agentOpacity(deputy.id, chosen);
    drawDeputy(ctx, [px(deputy.distance), py(deputy.speed)], deputy, colour, colours.bad);
  }
  ctx.globalAlpha = 1;
}
