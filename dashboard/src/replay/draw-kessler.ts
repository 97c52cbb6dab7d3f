/** Draws a frame of a kessler replay. */
import { closestApproaches, type Approach, type KesslerFrame, type KesslerState } from "./frames";

export interface Palette {
  paper: string;
  ink: string;
  soft: string;
  line: string;
  earth: string;
  satellite: string[];
  debris: string;
  bad: string;
  burn: string;
}

export interface DrawOptions {
  /** Length of the trail behind each body, in steps. */
  trail: number;
  /** Number of steps to look ahead for close approaches. */
  ahead: number;
  /** Position between this frame and the next, 0 to 1. */
  between: number;
}

/** Distance from the centre to the edge of the picture, in LU. */
export const EXTENT = 118;
/** Radii of the distance circles, in LU. */
export const RINGS = [50, 80, 100];
const EARTH = 20;
const CONTACT = 2;
/** Length of the arrow of a burn of 1 LU/TU, in LU. */
export const ARROW_SCALE = 22;

/** Pixels per LU in a picture of `size` pixels. */
export function scaleOf(size: number): number {
  return size / (2 * EXTENT);
}

/** Approaches of states that were drawn before: a playing replay draws each state many times. */
const approachCache = new WeakMap<KesslerState, Approach[]>();

function cachedApproaches(state: KesslerState, ahead: number): Approach[] {
  const before = approachCache.get(state);
  if (before) return before;
  const found = closestApproaches(state, ahead, 3 * CONTACT);
  approachCache.set(state, found);
  return found;
}

export function drawKessler(
  ctx: CanvasRenderingContext2D,
  size: number,
  frames: KesslerFrame[],
  at: number,
  look: DrawOptions,
  colours: Palette,
): Approach[] {
  const frame = frames[at];
  if (!frame) return [];
  const next = frames[at + 1];
  const scale = scaleOf(size);
  const px = (x: number) => size / 2 + x * scale;
  const py = (y: number) => size / 2 - y * scale;
  const between = next ? look.between : 0;

  ctx.fillStyle = colours.paper;
  ctx.fillRect(0, 0, size, size);
  circle(ctx, px(0), py(0), EARTH * scale);
  ctx.fillStyle = colours.earth;
  ctx.fill();
  ctx.strokeStyle = colours.line;
  ctx.lineWidth = 1;
  for (const r of RINGS) {
    circle(ctx, px(0), py(0), r * scale);
    ctx.stroke();
  }
  const { state } = frame;
  if (state.target_radius) {
    ctx.setLineDash([6, 5]);
    ctx.strokeStyle = colours.soft;
    circle(ctx, px(0), py(0), state.target_radius * scale);
    ctx.stroke();
    ctx.setLineDash([]);
  }

  const later = new Map(next?.state.radar_debris.map((body) => [body.id, body]));
  trails(ctx, frames, at, look.trail, px, py, colours);
  ctx.fillStyle = colours.debris;
  // One path for all debris, because each fill call is slow.
  const radius = Math.max(1.5, 0.5 * CONTACT * scale);
  ctx.beginPath();
  for (const body of state.radar_debris) {
    const to = later.get(body.id) ?? body;
    const [x, y] = [px(body.x + (to.x - body.x) * between), py(body.y + (to.y - body.y) * between)];
    ctx.moveTo(x + radius, y);
    ctx.arc(x, y, radius, 0, 2 * Math.PI);
  }
  ctx.fill();

  const close = cachedApproaches(state, look.ahead);
  for (const approach of close) {
    ctx.strokeStyle = approach.miss < CONTACT ? colours.bad : colours.soft;
    ctx.lineWidth = 1.5;
    circle(ctx, px(approach.x), py(approach.y), CONTACT * scale);
    ctx.stroke();
  }

  for (const satellite of state.satellites) {
    const to = next?.state.satellites.find((other) => other.id === satellite.id) ?? satellite;
    const x = px(satellite.x + (to.x - satellite.x) * between);
    const y = py(satellite.y + (to.y - satellite.y) * between);
    const colour = colours.satellite[satellite.id % colours.satellite.length] ?? colours.ink;
    if (satellite.status !== "active") {
      cross(ctx, x, y, 6, colours.bad);
      continue;
    }
    if (state.radar_range > 0 && state.radar_range < 2 * EXTENT) {
      ctx.setLineDash([2, 4]);
      ctx.strokeStyle = colour;
      circle(ctx, x, y, state.radar_range * scale);
      ctx.stroke();
      ctx.setLineDash([]);
    }
    circle(ctx, x, y, CONTACT * scale);
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1.5;
    ctx.stroke();
    circle(ctx, x, y, 3.5);
    ctx.fillStyle = colour;
    ctx.fill();
    ctx.fillText(String(satellite.id), x + 7, y - 7);
    // Burns of the next step, at the satellite.
    const burn = next?.actions.filter((action) => action[0] === satellite.id) ?? [];
    for (const [, dx = 0, dy = 0] of burn) {
      if (dx !== 0 || dy !== 0)
        arrow(ctx, x, y, x + dx * ARROW_SCALE * scale, y - dy * ARROW_SCALE * scale, colours.burn);
    }
  }
  return close;
}

function trails(
  ctx: CanvasRenderingContext2D,
  frames: KesslerFrame[],
  at: number,
  length: number,
  px: (x: number) => number,
  py: (y: number) => number,
  colours: Palette,
) {
  const from = Math.max(0, at - length);
  if (from === at) return;
  ctx.lineWidth = 1;
  ctx.strokeStyle = colours.line;
  ctx.beginPath();
  for (const body of frames[at]?.state.radar_debris ?? []) {
    let pen = false;
    for (let i = Math.max(from, at - 4); i <= at; i++) {
      const then = frames[i]?.state.radar_debris[body.id];
      if (then?.id !== body.id) continue;
      if (pen) ctx.lineTo(px(then.x), py(then.y));
      else ctx.moveTo(px(then.x), py(then.y));
      pen = true;
    }
  }
  ctx.stroke();
  for (const satellite of frames[at]?.state.satellites ?? []) {
    ctx.strokeStyle = colours.satellite[satellite.id % colours.satellite.length] ?? colours.ink;
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    for (let i = from; i <= at; i++) {
      const then = frames[i]?.state.satellites[satellite.id];
      if (!then || then.status !== "active") continue;
      if (i === from) ctx.moveTo(px(then.x), py(then.y));
      else ctx.lineTo(px(then.x), py(then.y));
    }
    ctx.stroke();
  }
}

export function circle(ctx: CanvasRenderingContext2D, x: number, y: number, r: number) {
  ctx.beginPath();
  ctx.arc(x, y, r, 0, 2 * Math.PI);
}

export function cross(ctx: CanvasRenderingContext2D, x: number, y: number, size: number, colour: string) {
  ctx.strokeStyle = colour;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(x - size, y - size);
  ctx.lineTo(x + size, y + size);
  ctx.moveTo(x - size, y + size);
  ctx.lineTo(x + size, y - size);
  ctx.stroke();
}

export function arrow(
  ctx: CanvasRenderingContext2D,
  x: number,
  y: number,
  toX: number,
  toY: number,
  colour: string,
) {
  const angle = Math.atan2(toY - y, toX - x);
  ctx.strokeStyle = colour;
  ctx.fillStyle = colour;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.lineTo(toX, toY);
  ctx.stroke();
  ctx.beginPath();
  ctx.moveTo(toX, toY);
  ctx.lineTo(toX - 8 * Math.cos(angle - 0.4), toY - 8 * Math.sin(angle - 0.4));
  ctx.lineTo(toX - 8 * Math.cos(angle + 0.4), toY - 8 * Math.sin(angle + 0.4));
  ctx.fill();
}
