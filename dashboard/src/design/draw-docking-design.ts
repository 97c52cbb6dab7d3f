/** Draws what a docking design adds to the picture of its episode: coasting paths, the reference plan, starts and the aim. */
import { agentColour, drawArrow, traceCircle } from "../replay/canvas-shapes";
import type { DockingPicture, Vector } from "../replay/draw-docking";
import type { Deputy, DockingFrame } from "../replay/frames";
import type { DesignParts } from "./design-parts";
import { AIM_TOLERANCE_DEG } from "./kessler-passes";

/** Content of the picture. */
export interface DockingDesignScene {
  parts: DesignParts;
  /** Frames of the episode without thrust. */
  hold: DockingFrame[];
  /** Frames of the reference plan; empty if they are not shown. */
  reference: DockingFrame[];
}

/** Length of the arrow of the fastest start, in pixels. */
const LONGEST_ARROW = 60;
/** Length of the shortest arrow that is drawn, in pixels. */
const SHORTEST_ARROW = 4;
/** Length of the sector of the aim, as a share of the picture. */
const SECTOR_SHARE = 0.2;
/** Largest number of points of a path. */
const MAX_POINTS = 200;

/** Draws the scene into one projection, below the deputies. */
export function drawDockingDesign(picture: DockingPicture, { parts, hold, reference }: DockingDesignScene) {
  const { ctx, colours, at, direction } = picture;
  const starts = hold[0]?.state.deputies ?? [];
  const aimed = aimedDeputy(parts, starts);
  if (aimed && picture.isOrbitPlane) drawDockingSector(picture, parts.aimBearing ?? 0, aimed);
  const fastest = Math.max(1e-9, ...starts.map(({ vx, vy, vz }) => Math.hypot(vx, vy, vz)));
  for (const start of starts) {
    ctx.strokeStyle = agentColour(colours, start.id);
    [ctx.globalAlpha, ctx.lineWidth] = [0.7, 1.2];
    ctx.setLineDash([2, 4]);
    strokeDeputy(picture, hold, start.id);
    ctx.setLineDash([]);
    [ctx.globalAlpha, ctx.lineWidth] = [1, 1.8];
    strokeDeputy(picture, reference, start.id);
    const [x, y] = at([start.x, start.y, start.z]);
    const [vx, vy] = direction([start.vx, start.vy, start.vz]);
    const length = (Math.hypot(vx, vy) * LONGEST_ARROW) / fastest;
    const scale = LONGEST_ARROW / fastest;
    if (length > SHORTEST_ARROW) drawArrow(ctx, x, y, x + vx * scale, y + vy * scale, colours.ink);
    if (start.id !== aimed?.id) continue;
    traceCircle(ctx, x, y, 10);
    ctx.strokeStyle = colours.aim;
    ctx.lineWidth = 1.6;
    ctx.stroke();
  }
}

function strokeDeputy({ ctx, at }: DockingPicture, frames: DockingFrame[], deputy: number) {
  const every = Math.max(1, Math.ceil(frames.length / MAX_POINTS));
  ctx.beginPath();
  frames.forEach(({ state }, index) => {
    const place = state.deputies[deputy];
    if (place && (index % every === 0 || index === frames.length - 1))
      ctx.lineTo(...at([place.x, place.y, place.z]));
  });
  ctx.stroke();
}

/** Returns the deputy that meets a body in the direction nearest to the aimed bearing; null if the design aims at no bearing. */
export function aimedDeputy({ mode, aimBearing }: DesignParts, starts: Deputy[]): Deputy | null {
  if (aimBearing === null) return null;
  const chief = { x: 0, y: 0 };
  let best: { deputy: Deputy; off: number } | null = null;
  for (const deputy of starts) {
    const others = mode === "collision" ? starts.filter(({ id }) => id !== deputy.id) : [chief];
    for (const { x, y } of others) {
      const bearing = (Math.atan2(y - deputy.y, x - deputy.x) * 180) / Math.PI;
      const off = Math.abs(((((bearing - aimBearing + 180) % 360) + 360) % 360) - 180);
      if (!best || off < best.off) best = { deputy, off };
    }
  }
  return best?.deputy ?? null;
}

/** Draws the sector of the aimed bearing from a deputy, in the plane of the orbit. */
function drawDockingSector(
  { ctx, colours, at, direction, size }: DockingPicture,
  bearing: number,
  from: Deputy,
) {
  const [x, y] = at([from.x, from.y, from.z]);
  ctx.beginPath();
  ctx.moveTo(x, y);
  for (let part = -1; part <= 1.001; part += 0.2) {
    const angle = ((bearing + AIM_TOLERANCE_DEG * part) * Math.PI) / 180;
    const unit: Vector = [Math.cos(angle), Math.sin(angle), 0];
    const [dx, dy] = direction(unit);
    ctx.lineTo(x + SECTOR_SHARE * size * dx, y + SECTOR_SHARE * size * dy);
  }
  ctx.closePath();
  ctx.fillStyle = colours.aim;
  ctx.globalAlpha = 0.22;
  ctx.fill();
  ctx.globalAlpha = 1;
}
