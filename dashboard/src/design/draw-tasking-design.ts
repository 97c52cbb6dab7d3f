/** Draws what a tasking design adds to the map of its episode: the Sun, whole tracks, fields and the images of the reference plan. */
import { agentColour, traceCircle } from "../replay/canvas-shapes";
import { strokeLine, type Point, type TaskingPicture } from "../replay/draw-tasking";
import type { EpisodeMotion } from "../replay/tasking-motion";
import type { DesignParts } from "./design-parts";

/** Content of the picture. */
export interface TaskingDesignScene {
  parts: DesignParts;
  motion: EpisodeMotion;
  /** Motion of the reference plan; null if it is not shown. */
  reference: EpisodeMotion | null;
}

/** Visible share of the Sun below which a track is drawn as in the shadow. */
const DARK = 0.5;

/** Draws the scene on the map, below the satellites. */
export function drawTaskingDesign(picture: TaskingPicture, { parts, motion, reference }: TaskingDesignScene) {
  // The episode may end early if all hold; the reference plan goes on.
  (reference ?? motion).satellites.forEach((track, satellite) => {
    drawWholeTrack(picture, track, satellite);
  });
  drawSun(picture, motion.sun[0]);
  const { ctx, at, colours } = picture;
  const place = (target: number): Point => [
    motion.objects.target_longitudes[target] ?? 0,
    motion.objects.target_latitudes[target] ?? 0,
  ];
  ctx.strokeStyle = colours.ink;
  ctx.lineWidth = 1.2;
  for (const { target } of reference?.images ?? []) {
    traceCircle(ctx, ...at(place(target)), 4.5);
    ctx.stroke();
  }
  fieldTargets(parts, motion).forEach((targets, field) => {
    drawField(picture, targets.map(place), field);
  });
}

/** Returns the numbers of the targets of each field: they follow the drawn targets, in the order of the fields. */
export function fieldTargets({ fields }: DesignParts, { objects }: EpisodeMotion): number[][] {
  const ofFields = fields.reduce((sum, { targets }) => sum + targets, 0);
  let next = Math.max(0, objects.target_priorities.length - ofFields);
  return fields.map(({ targets }) => Array.from({ length: targets }, () => next++));
}

/** Draws the track of a whole episode, dashed in the shadow. */
function drawWholeTrack(
  { ctx, at, colours }: TaskingPicture,
  track: EpisodeMotion["satellites"][number],
  satellite: number,
) {
  ctx.strokeStyle = agentColour(colours, satellite);
  for (let first = 0; first < track.longitude.length - 1;) {
    const isDark = (track.sunlight[first] ?? 1) < DARK;
    let last = first + 1;
    while (last < track.longitude.length - 1 && (track.sunlight[last] ?? 1) < DARK === isDark) last++;
    const points: Point[] = [];
    for (let i = first; i <= last; i++) points.push([track.longitude[i] ?? 0, track.latitude[i] ?? 0]);
    [ctx.globalAlpha, ctx.lineWidth] = isDark ? [0.5, 1] : [0.75, 1.4];
    ctx.setLineDash(isDark ? [2, 4] : []);
    strokeLine(ctx, at, points);
    first = last;
  }
  ctx.setLineDash([]);
  ctx.globalAlpha = 1;
}

function drawSun({ ctx, at, colours }: TaskingPicture, sun: Point | undefined) {
  if (!sun) return;
  traceCircle(ctx, ...at(sun), 6);
  ctx.fillStyle = colours.decoy;
  ctx.fill();
  traceCircle(ctx, ...at(sun), 9);
  ctx.strokeStyle = colours.decoy;
  ctx.lineWidth = 1;
  ctx.stroke();
}

/** Marks a field by its targets, and by its number where they begin. */
function drawField({ ctx, at, colours }: TaskingPicture, targets: Point[], field: number) {
  ctx.fillStyle = colours.aim;
  for (const target of targets) {
    traceCircle(ctx, ...at(target), 2);
    ctx.fill();
  }
  const first = targets[0];
  if (!first) return;
  const [x, y] = at(first);
  ctx.fillText(String(field), x + 6, y - 6);
}
