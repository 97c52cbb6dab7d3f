/** Draws a frame of a kessler replay. */
import { agentColour, agentOpacity, drawArrow, drawCross, traceCircle, type Palette } from "./canvas-shapes";
import {
  CONTACT_DISTANCE,
  EARTH_RADIUS,
  closestApproaches,
  type Approach,
  type KesslerFrame,
  type KesslerState,
} from "./frames";

export interface DrawOptions {
  /** Length of the trail behind each body, in steps. */
  trail: number;
  /** Number of steps to look ahead for close approaches. */
  ahead: number;
  /** Position between this frame and the next, 0 to 1. */
  between: number;
  /** Agent that is emphasised; null for all. */
  chosen?: number | null;
  /** Draws below the bodies, above the background. */
  underlay?: ((picture: KesslerPicture) => void) | undefined;
}

/** Distance from the centre to the edge of the picture, in LU. */
export const EXTENT = 118;
/** Radii of the distance circles, in LU. */
export const RINGS = [50, 80, 100];
/** Smallest picture whose distance circles have labels, in pixels. */
const MIN_LABELLED_SIZE = 280;
/** Length of the arrow of a burn of 1 LU/TU, in LU. */
export const ARROW_SCALE = 22;
/** Maximum length of the trail of a piece of debris, in steps. */
const MAX_DEBRIS_TRAIL = 4;

/** Returns the pixels per LU in a picture of `size` pixels. */
export function scaleOf(size: number): number {
  return size / (2 * EXTENT);
}

/** Canvas, colours and mapping from LU to pixels of one picture. */
export interface KesslerPicture {
  ctx: CanvasRenderingContext2D;
  colours: Palette;
  size: number;
  scale: number;
  px: (x: number) => number;
  py: (y: number) => number;
}

/** Draws frame `at`, with bodies interpolated towards the next frame; returns the close approaches, nearest first. */
export function drawKessler(
  ctx: CanvasRenderingContext2D,
  size: number,
  frames: KesslerFrame[],
  at: number,
  options: DrawOptions,
  colours: Palette,
): Approach[] {
  const frame = frames[at];
  if (!frame) return [];
  const next = frames[at + 1];
  const scale = scaleOf(size);
  const picture: KesslerPicture = {
    ctx,
    colours,
    size,
    scale,
    px: (x) => size / 2 + x * scale,
    py: (y) => size / 2 - y * scale,
  };
  const between = next ? options.between : 0;
  drawBackground(picture, frame.state.target_radius);
  options.underlay?.(picture);
  const chosen = options.chosen ?? null;
  drawTrails(picture, frames, at, options.trail, chosen);
  drawDebris(picture, frame, next, between);
  const approaches = cachedApproaches(frame.state, options.ahead);
  drawApproaches(picture, approaches, chosen);
  drawSatellites(picture, frame, next, between, chosen);
  return approaches;
}

/** Approaches of states that were drawn before: a playing replay draws each state many times. */
const approachCache = new WeakMap<KesslerState, Approach[]>();

function cachedApproaches(state: KesslerState, ahead: number): Approach[] {
  const cached = approachCache.get(state);
  if (cached) return cached;
  const approaches = closestApproaches(state, ahead, 3 * CONTACT_DISTANCE);
  approachCache.set(state, approaches);
  return approaches;
}

/** Draws the Earth, the distance circles, and the orbit to reach if the task has one. */
function drawBackground(
  { ctx, colours, size, scale, px, py }: KesslerPicture,
  targetRadius: number | null | undefined,
) {
  ctx.fillStyle = colours.paper;
  ctx.fillRect(0, 0, size, size);
  traceCircle(ctx, px(0), py(0), EARTH_RADIUS * scale);
  ctx.fillStyle = colours.earth;
  ctx.fill();
  ctx.strokeStyle = colours.line;
  ctx.lineWidth = 1;
  ctx.textAlign = "center";
  for (const r of RINGS) {
    traceCircle(ctx, px(0), py(0), r * scale);
    ctx.stroke();
    ctx.fillStyle = colours.soft;
    if (size > MIN_LABELLED_SIZE) ctx.fillText(`${String(r)} LU`, px(0), py(r) - 3);
  }
  ctx.textAlign = "start";
  if (!targetRadius) return;
  ctx.setLineDash([6, 5]);
  ctx.strokeStyle = colours.soft;
  traceCircle(ctx, px(0), py(0), targetRadius * scale);
  ctx.stroke();
  ctx.setLineDash([]);
}

function drawTrails(
  { ctx, colours, px, py }: KesslerPicture,
  frames: KesslerFrame[],
  at: number,
  length: number,
  chosen: number | null,
) {
  const from = Math.max(0, at - length);
  if (from === at) return;
  ctx.lineWidth = 1;
  ctx.strokeStyle = colours.line;
  ctx.beginPath();
  for (const body of frames[at]?.state.radar_debris ?? []) {
    let hasStarted = false;
    for (let i = Math.max(from, at - MAX_DEBRIS_TRAIL); i <= at; i++) {
      const past = frames[i]?.state.radar_debris[body.id];
      if (past?.id !== body.id) continue;
      if (hasStarted) ctx.lineTo(px(past.x), py(past.y));
      else ctx.moveTo(px(past.x), py(past.y));
      hasStarted = true;
    }
  }
  ctx.stroke();
  for (const satellite of frames[at]?.state.satellites ?? []) {
    ctx.strokeStyle = agentColour(colours, satellite.id);
    ctx.globalAlpha = agentOpacity(satellite.id, chosen);
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    for (let i = from; i <= at; i++) {
      const past = frames[i]?.state.satellites[satellite.id];
      if (!past || past.status !== "active") continue;
      if (i === from) ctx.moveTo(px(past.x), py(past.y));
      else ctx.lineTo(px(past.x), py(past.y));
    }
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

function drawDebris(
  { ctx, colours, scale, px, py }: KesslerPicture,
  frame: KesslerFrame,
  next: KesslerFrame | undefined,
  between: number,
) {
  const nextBodies = new Map(next?.state.radar_debris.map((body) => [body.id, body]));
  const radius = Math.max(1.5, 0.5 * CONTACT_DISTANCE * scale);
  ctx.fillStyle = colours.debris;
  // One path for all debris, because each fill call is slow.
  ctx.beginPath();
  for (const body of frame.state.radar_debris) {
    const to = nextBodies.get(body.id) ?? body;
    const [x, y] = [px(body.x + (to.x - body.x) * between), py(body.y + (to.y - body.y) * between)];
    ctx.moveTo(x + radius, y);
    ctx.arc(x, y, radius, 0, 2 * Math.PI);
  }
  ctx.fill();
}

/** Draws a ring where each satellite passes debris, in red if they touch. */
function drawApproaches(
  { ctx, colours, scale, px, py }: KesslerPicture,
  approaches: Approach[],
  chosen: number | null,
) {
  for (const approach of approaches) {
    ctx.globalAlpha = agentOpacity(approach.satellite, chosen);
    ctx.strokeStyle = approach.miss < CONTACT_DISTANCE ? colours.bad : colours.soft;
    ctx.lineWidth = 1.5;
    traceCircle(ctx, px(approach.x), py(approach.y), CONTACT_DISTANCE * scale);
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

/** Draws each satellite with its number, contact distance, radar range and the burns of the next step. */
function drawSatellites(
  { ctx, colours, scale, px, py }: KesslerPicture,
  { state }: KesslerFrame,
  next: KesslerFrame | undefined,
  between: number,
  chosen: number | null,
) {
  for (const satellite of state.satellites) {
    ctx.globalAlpha = agentOpacity(satellite.id, chosen);
    const to = next?.state.satellites.find((other) => other.id === satellite.id) ?? satellite;
    const x = px(satellite.x + (to.x - satellite.x) * between);
    const y = py(satellite.y + (to.y - satellite.y) * between);
    const colour = agentColour(colours, satellite.id);
    if (satellite.status !== "active") {
      drawCross(ctx, x, y, 6, colours.bad);
      continue;
    }
    if (state.radar_range > 0 && state.radar_range < 2 * EXTENT) {
      ctx.setLineDash([2, 4]);
      ctx.strokeStyle = colour;
      traceCircle(ctx, x, y, state.radar_range * scale);
      ctx.stroke();
      ctx.setLineDash([]);
    }
    traceCircle(ctx, x, y, CONTACT_DISTANCE * scale);
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1.5;
    ctx.stroke();
    traceCircle(ctx, x, y, 3.5);
    ctx.fillStyle = colour;
    ctx.fill();
    ctx.fillText(String(satellite.id), x + 7, y - 7);
    const burns = next?.actions.filter((action) => action[0] === satellite.id) ?? [];
    for (const [, dx = 0, dy = 0] of burns) {
      if (dx !== 0 || dy !== 0)
        drawArrow(ctx, x, y, x + dx * ARROW_SCALE * scale, y - dy * ARROW_SCALE * scale, colours.burn);
    }
  }
  ctx.globalAlpha = 1;
}
