/** Draws what a kessler design adds to the picture of its episode: paths of debris, the sector of the aim, orbits and burns. */
import { agentColour, drawArrow, traceCircle, type Palette } from "../replay/canvas-shapes";
import type { KesslerPicture } from "../replay/draw-kessler";
import type { KesslerFrame } from "../replay/frames";
import type { DesignedEncounter } from "./design-parts";
import { AIM_TOLERANCE_DEG, placeAfter, stepOfLoss } from "./kessler-passes";
import type { AimSector, EncounterPass, Place } from "./kessler-passes";

/** Content of the picture. */
export interface KesslerDesignScene {
  passes: EncounterPass[];
  sector: AimSector | null;
  /** Paths of the satellites if they hold, by their index. */
  coast: Place[][];
  /** Frames of the episode in which all satellites hold. */
  hold: KesslerFrame[];
  /** Frames of the reference plan; empty if they are not shown. */
  reference: KesslerFrame[];
}

/** Number of steps before an encounter in which the path of its debris is drawn boldly. */
const BOLD_STEPS = 6;
/** Length of the sector of the aim, in LU. */
const SECTOR_LENGTH = 30;
/** Length of the arrow of a burn of 1 LU/TU, in pixels, and of the shortest one. */
const [BURN_LENGTH, SHORTEST_BURN] = [40, 16];

/** Returns the colour of a kind of encounter. */
export function encounterColour(kind: DesignedEncounter["kind"], colours: Palette): string {
  return { threat: colours.bad, decoy: colours.decoy, screen: colours.soft }[kind];
}

/** Draws the scene above the background and below the bodies. */
export function drawKesslerDesign(picture: KesslerPicture, scene: KesslerDesignScene) {
  if (scene.sector) drawSector(picture, scene.sector);
  for (const pass of scene.passes) drawPass(picture, pass);
  drawOrbits(picture, scene);
  drawBurns(picture, scene.reference);
  drawEncounters(picture, scene);
}

function drawSector({ ctx, colours, px, py }: KesslerPicture, { from, directionDeg }: AimSector) {
  ctx.beginPath();
  ctx.moveTo(px(from.x), py(from.y));
  for (let part = -1; part <= 1.001; part += 0.2) {
    const angle = ((directionDeg + AIM_TOLERANCE_DEG * part) * Math.PI) / 180;
    ctx.lineTo(px(from.x + SECTOR_LENGTH * Math.cos(angle)), py(from.y + SECTOR_LENGTH * Math.sin(angle)));
  }
  ctx.closePath();
  ctx.fillStyle = colours.aim;
  ctx.strokeStyle = colours.aim;
  ctx.globalAlpha = 0.18;
  ctx.fill();
  ctx.globalAlpha = 1;
  ctx.lineWidth = 1.5;
  ctx.stroke();
}

function strokePath({ ctx, px, py }: KesslerPicture, places: (Place | undefined)[]) {
  ctx.beginPath();
  for (const place of places) if (place) ctx.lineTo(px(place.x), py(place.y));
  ctx.stroke();
}

/** Draws the path of debris: faint from its start, bold in the last steps, with a star where a rogue appears. */
function drawPass(picture: KesslerPicture, pass: EncounterPass) {
  const { ctx, colours, px, py } = picture;
  const { encounter, firstStep, path } = pass;
  const colour = encounterColour(encounter.kind, colours);
  const boldFrom = Math.max(firstStep, encounter.step - BOLD_STEPS);
  const part = (from: number, to: number) => path.slice(Math.max(0, from - firstStep), to - firstStep + 1);
  ctx.strokeStyle = colour;
  ctx.fillStyle = colour;
  [ctx.globalAlpha, ctx.lineWidth] = [0.45, 1];
  strokePath(picture, part(firstStep, boldFrom));
  strokePath(picture, part(encounter.step, Infinity));
  [ctx.globalAlpha, ctx.lineWidth] = [1, 2.2];
  if (encounter.rogue) ctx.setLineDash([5, 3]);
  strokePath(picture, part(boldFrom, encounter.step));
  ctx.setLineDash([]);
  const start = path[0];
  if (start && encounter.rogue) drawStar(ctx, px(start.x), py(start.y), colour);
  else if (start) {
    traceCircle(ctx, px(start.x), py(start.y), 2.5);
    ctx.fill();
  }
  // A head halfway along the bold part shows the direction.
  const middle = Math.max(firstStep + 1, encounter.step - BOLD_STEPS / 2);
  const [before, then] = [placeAfter(pass, middle - 1), placeAfter(pass, middle)];
  if (before && then) drawArrow(ctx, px(before.x), py(before.y), px(then.x), py(then.y), colour);
}

/** Draws the star that marks where a rogue appears. */
function drawStar(ctx: CanvasRenderingContext2D, x: number, y: number, colour: string) {
  ctx.strokeStyle = colour;
  ctx.lineWidth = 1.4;
  ctx.beginPath();
  for (const [dx, dy] of [
    [5, 0],
    [2.5, 4.3],
    [-2.5, 4.3],
  ] as const) {
    ctx.moveTo(x - dx, y - dy);
    ctx.lineTo(x + dx, y + dy);
  }
  ctx.stroke();
}

/** Draws the orbits of holding satellites, faint after a loss, and those of the reference plan dashed. */
function drawOrbits(picture: KesslerPicture, { coast, hold, reference }: KesslerDesignScene) {
  const { ctx, colours } = picture;
  coast.forEach((path, id) => {
    ctx.strokeStyle = agentColour(colours, id);
    const end = stepOfLoss(hold, id) ?? path.length;
    [ctx.globalAlpha, ctx.lineWidth] = [0.25, 1.2];
    strokePath(picture, path.slice(end));
    [ctx.globalAlpha, ctx.lineWidth] = [0.7, 2];
    strokePath(picture, path.slice(0, end + 1));
    [ctx.globalAlpha, ctx.lineWidth] = [1, 1.6];
    ctx.setLineDash([3, 4]);
    strokePath(
      picture,
      reference.map(({ state }) => state.satellites[id]),
    );
    ctx.setLineDash([]);
  });
}

/** Draws the burns of the reference plan, longer for larger ones. */
function drawBurns({ ctx, colours, px, py }: KesslerPicture, reference: KesslerFrame[]) {
  reference.forEach((frame, index) => {
    for (const [agent = 0, dx = 0, dy = 0] of frame.actions) {
      const satellite = reference[index - 1]?.state.satellites[agent];
      const size = Math.hypot(dx, dy);
      if (!satellite || size === 0) continue;
      const length = SHORTEST_BURN + Math.min(BURN_LENGTH, BURN_LENGTH * size);
      const [x, y] = [px(satellite.x), py(satellite.y)];
      drawArrow(ctx, x, y, x + (length * dx) / size, y - (length * dy) / size, colours.ink);
    }
  });
}

/** Draws a mark at each encounter, with its number and step where there is room. */
function drawEncounters(
  { ctx, colours, px, py, size }: KesslerPicture,
  { passes, coast }: KesslerDesignScene,
) {
  const labels: [number, number][] = [];
  const marks = passes.flatMap(({ encounter }): [number, number][] => {
    const place = coast[encounter.satellite]?.[encounter.step];
    return place ? [[px(place.x), py(place.y)]] : [];
  });
  passes.forEach(({ encounter }, index) => {
    const satellite = coast[encounter.satellite]?.[encounter.step];
    if (!satellite) return;
    const [x, y] = [px(satellite.x), py(satellite.y)];
    const colour = encounterColour(encounter.kind, colours);
    const text = `${String(index)}: step ${String(encounter.step)}`;
    const width = ctx.measureText(text).width + 8;
    const [left, top] = placeLabel([x, y], width, { labels, marks }, size);
    labels.push([left, top]);
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1;
    ctx.beginPath();
    ctx.moveTo(x, y);
    ctx.lineTo(left + width / 2, top + LABEL_HEIGHT / 2);
    ctx.stroke();
    ctx.lineWidth = 2;
    traceCircle(ctx, x, y, 4);
    ctx.fillStyle = colours.paper;
    ctx.fill();
    ctx.stroke();
    ctx.globalAlpha = 0.8;
    ctx.fillRect(left, top, width, LABEL_HEIGHT);
    ctx.globalAlpha = 1;
    ctx.fillStyle = colour;
    ctx.fillText(text, left + 4, top + 13);
  });
}

const LABEL_HEIGHT = 18;

/** Returns the upper left corner of a label near a point: the first place in which it covers no label and no mark. */
function placeLabel(
  [x, y]: [number, number],
  width: number,
  { labels, marks }: { labels: [number, number][]; marks: [number, number][] },
  size: number,
): [number, number] {
  const candidates = [22, 44, 66].flatMap((distance) =>
    Array.from({ length: 8 }, (_, k): [number, number] => {
      const angle = -Math.PI / 4 + (k * Math.PI) / 4;
      const [cx, cy] = [x + (distance + width / 4) * Math.cos(angle), y + distance * Math.sin(angle)];
      return [cx - width / 2, cy - LABEL_HEIGHT / 2];
    }),
  );
  const isFree = ([left, top]: [number, number]) =>
    left > 0 &&
    top > 0 &&
    left + width < size &&
    top + LABEL_HEIGHT < size &&
    labels.every(([l, t]) => Math.abs(l - left) > width || Math.abs(t - top) > LABEL_HEIGHT) &&
    marks.every(
      ([mx, my]) => mx < left - 5 || mx > left + width + 5 || my < top - 5 || my > top + LABEL_HEIGHT + 5,
    );
  return candidates.find(isFree) ?? [x + 8, y - LABEL_HEIGHT - 8];
}
