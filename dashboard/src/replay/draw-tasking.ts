/** Draws a map of an episode of tasking: tracks, day and night, stations, targets and where the instruments look. */
import coastline from "../../../env-core/src/tasking/data/coastline.json";
import { agentColour, agentOpacity, drawCross, traceCircle, type Palette } from "./canvas-shapes";
import type { TaskingFrame } from "./frames";
import { indexAt, placeAt, type EpisodeMotion } from "./tasking-motion";

/** Time of the track ahead, s. */
const AHEAD_S = 1500;
/** Visible share of the Sun below which a satellite counts as in eclipse. */
const ECLIPSED = 0.5;
/** Steps of a circle on the map. */
const CIRCLE_POINTS = 48;

/** Longitude and latitude in degrees, or a position on the map in pixels. */
export type Point = [number, number];

/** Moment that is drawn. */
export interface MapView {
  motion: EpisodeMotion;
  /** Frame of the last step that has ended. */
  frame: TaskingFrame;
  time: number;
  /** Time of the track behind, s. */
  trail: number;
  /** Agent that is emphasised; null for all. */
  chosen?: number | null;
  /** Draws below the satellites, above the map. */
  underlay?: ((map: TaskingPicture) => void) | undefined;
}

/** Canvas, colours and mapping from degrees to pixels of a map. */
export interface TaskingPicture {
  ctx: CanvasRenderingContext2D;
  colours: Palette;
  at: (point: Point) => Point;
}

/** Returns the height of a map, in pixels. */
export function mapHeight(width: number): number {
  return width / 2;
}

/** Draws the map of a moment. */
export function drawTasking(ctx: CanvasRenderingContext2D, width: number, view: MapView, colours: Palette) {
  const height = mapHeight(width);
  const at = ([longitude, latitude]: Point): Point => [
    ((longitude + 180) / 360) * width,
    ((90 - latitude) / 180) * height,
  ];
  ctx.fillStyle = colours.paper;
  ctx.fillRect(0, 0, width, height);
  drawGrid(ctx, at, colours);
  drawCoast(ctx, at, colours);
  drawNight(ctx, at, view, colours);
  drawStations(ctx, at, view, colours);
  drawTargets(ctx, at, view, colours);
  view.underlay?.({ ctx, colours, at });
  view.motion.satellites.forEach((_, satellite) => {
    drawTrack(ctx, at, view, satellite, colours);
  });
  drawLinks(ctx, at, view, colours);
  view.motion.satellites.forEach((_, satellite) => {
    drawSatellite(ctx, at, view, satellite, colours);
  });
}

function drawGrid(ctx: CanvasRenderingContext2D, at: (point: Point) => Point, colours: Palette) {
  ctx.strokeStyle = colours.line;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let longitude = -180; longitude <= 180; longitude += 30) {
    ctx.moveTo(...at([longitude, 90]));
    ctx.lineTo(...at([longitude, -90]));
  }
  for (let latitude = -90; latitude <= 90; latitude += 30) {
    ctx.moveTo(...at([-180, latitude]));
    ctx.lineTo(...at([180, latitude]));
  }
  ctx.stroke();
  ctx.fillStyle = colours.soft;
  for (const longitude of [-120, -60, 0, 60, 120]) {
    const [x, y] = at([longitude, -90]);
    ctx.fillText(degreesText(longitude, "E", "W"), x + 3, y - 4);
  }
  for (const latitude of [-60, -30, 0, 30, 60]) {
    const [x, y] = at([-180, latitude]);
    ctx.fillText(degreesText(latitude, "N", "S"), x + 3, y - 3);
  }
}

/** Formats a longitude or latitude: "60° E", "30° S", "0°". */
function degreesText(degrees: number, positive: string, negative: string): string {
  if (degrees === 0) return "0°";
  return `${String(Math.abs(degrees))}° ${degrees > 0 ? positive : negative}`;
}

function drawCoast(ctx: CanvasRenderingContext2D, at: (point: Point) => Point, colours: Palette) {
  ctx.strokeStyle = colours.soft;
  ctx.lineWidth = 1;
  for (const line of coastline) {
    const points: Point[] = [];
    for (let i = 0; i + 1 < line.length; i += 2) points.push([(line[i] ?? 0) / 10, (line[i + 1] ?? 0) / 10]);
    strokeLine(ctx, at, points);
  }
}

/** Strokes a line on the map, without the part between the map's edges where it leaves one of them. */
export function strokeLine(ctx: CanvasRenderingContext2D, at: (point: Point) => Point, points: Point[]) {
  ctx.beginPath();
  let previous: Point | null = null;
  for (const point of points) {
    if (previous && Math.abs(point[0] - previous[0]) <= 180) ctx.lineTo(...at(point));
    else ctx.moveTo(...at(point));
    previous = point;
  }
  ctx.stroke();
}

/** Shades the side of the Earth that the Sun does not light. */
function drawNight(
  ctx: CanvasRenderingContext2D,
  at: (point: Point) => Point,
  { motion, time }: MapView,
  colours: Palette,
) {
  const [sunLongitude, sunLatitude] = motion.sun[indexAt(motion.times, time)] ?? [0, 0];
  const declination = (Math.abs(sunLatitude) < 0.1 ? 0.1 : sunLatitude) * (Math.PI / 180);
  const border: Point[] = [];
  for (let longitude = -180; longitude <= 180; longitude += 3) {
    const hour = (longitude - sunLongitude) * (Math.PI / 180);
    border.push([longitude, (Math.atan(-Math.cos(hour) / Math.tan(declination)) * 180) / Math.PI]);
  }
  const pole = declination > 0 ? -90 : 90;
  ctx.beginPath();
  ctx.moveTo(...at([-180, pole]));
  for (const point of border) ctx.lineTo(...at(point));
  ctx.lineTo(...at([180, pole]));
  ctx.closePath();
  ctx.globalAlpha = 0.12;
  ctx.fillStyle = colours.ink;
  ctx.fill();
  ctx.globalAlpha = 1;
}

function drawStations(
  ctx: CanvasRenderingContext2D,
  at: (point: Point) => Point,
  { motion }: MapView,
  colours: Palette,
) {
  ctx.strokeStyle = colours.soft;
  ctx.fillStyle = colours.soft;
  ctx.lineWidth = 1;
  ctx.setLineDash([3, 3]);
  for (const { longitude, latitude, radius, name } of motion.objects.stations) {
    strokeLine(ctx, at, circleAround([longitude, latitude], radius));
    const [x, y] = at([longitude, latitude]);
    ctx.fillRect(x - 2, y - 2, 4, 4);
    ctx.fillText(name, x + 5, y - 4);
  }
  ctx.setLineDash([]);
}

/** Returns points at a distance from a place, along great circles; all in degrees. */
export function circleAround([longitude, latitude]: Point, radius: number): Point[] {
  const [phi, reach] = [(latitude * Math.PI) / 180, (radius * Math.PI) / 180];
  return Array.from({ length: CIRCLE_POINTS + 1 }, (_, i): Point => {
    const bearing = (2 * Math.PI * i) / CIRCLE_POINTS;
    const sine = Math.sin(phi) * Math.cos(reach) + Math.cos(phi) * Math.sin(reach) * Math.cos(bearing);
    const across = Math.sin(bearing) * Math.sin(reach) * Math.cos(phi);
    const turn = Math.atan2(across, Math.cos(reach) - Math.sin(phi) * sine);
    const wrapped = ((longitude + (turn * 180) / Math.PI + 540) % 360) - 180;
    return [wrapped, (Math.asin(sine) * 180) / Math.PI];
  });
}

/** Draws targets: the larger, the higher their priority; imaged ones in the colour of the satellite. */
function drawTargets(
  ctx: CanvasRenderingContext2D,
  at: (point: Point) => Point,
  { motion, frame, time, chosen }: MapView,
  colours: Palette,
) {
  const { target_longitudes, target_latitudes, target_priorities } = motion.objects;
  const imagedBy = new Map(
    motion.images.filter((image) => image.time <= time).map(({ target, satellite }) => [target, satellite]),
  );
  const place = (target: number): Point => [target_longitudes[target] ?? 0, target_latitudes[target] ?? 0];
  target_priorities.forEach((priority, target) => {
    const satellite = imagedBy.get(target);
    const [x, y] = at(place(target));
    traceCircle(ctx, x, y, satellite === undefined ? 0.6 + 1.6 * priority : 3);
    ctx.globalAlpha = satellite === undefined ? 0.5 : 1;
    ctx.fillStyle = satellite === undefined ? colours.soft : agentColour(colours, satellite);
    ctx.fill();
  });
  ctx.globalAlpha = 1;
  frame.state.map.upcoming.forEach((targets, satellite) => {
    ctx.strokeStyle = agentColour(colours, satellite);
    ctx.globalAlpha = agentOpacity(satellite, chosen ?? null);
    ctx.lineWidth = 1;
    for (const target of targets) {
      traceCircle(ctx, ...at(place(target)), 4);
      ctx.stroke();
    }
  });
  ctx.globalAlpha = 1;
}

/** Draws the track of a satellite behind (solid) and ahead (dashed); it is thick where the satellite has sunlight. */
function drawTrack(
  ctx: CanvasRenderingContext2D,
  at: (point: Point) => Point,
  { motion, time, trail, chosen }: MapView,
  satellite: number,
  colours: Palette,
) {
  const track = motion.satellites[satellite];
  if (!track) return;
  ctx.strokeStyle = agentColour(colours, satellite);
  const opacity = agentOpacity(satellite, chosen ?? null);
  const first = indexAt(motion.times, time - trail);
  const last = indexAt(motion.times, time + AHEAD_S);
  for (let i = first; i < last; i++) {
    const from: Point = [track.longitude[i] ?? 0, track.latitude[i] ?? 0];
    const to: Point = [track.longitude[i + 1] ?? 0, track.latitude[i + 1] ?? 0];
    const isAhead = (motion.times[i] ?? 0) >= time;
    if (isAhead && i % 4 > 1) continue; // dashes that do not move with the satellite
    ctx.globalAlpha = opacity * (isAhead ? 0.6 : 0.9);
    ctx.lineWidth = (track.sunlight[i] ?? 1) < ECLIPSED ? 1 : 2.5;
    strokeLine(ctx, at, [from, to]);
  }
  ctx.globalAlpha = 1;
}

function drawLinks(
  ctx: CanvasRenderingContext2D,
  at: (point: Point) => Point,
  { motion, frame, time }: MapView,
  colours: Palette,
) {
  ctx.strokeStyle = colours.burn;
  ctx.lineWidth = 1;
  for (const [a, b] of frame.state.map.links) {
    strokeLine(ctx, at, [placeAt(motion, a, time), placeAt(motion, b, time)]);
  }
}

/** Draws a satellite, and the point that its instrument sees. */
function drawSatellite(
  ctx: CanvasRenderingContext2D,
  at: (point: Point) => Point,
  { motion, frame, time, chosen }: MapView,
  satellite: number,
  colours: Palette,
) {
  const place = placeAt(motion, satellite, time);
  ctx.globalAlpha = agentOpacity(satellite, chosen ?? null);
  const [x, y] = at(place);
  if (frame.state.satellites[satellite]?.alive === false) {
    drawCross(ctx, x, y, 6, colours.bad);
    ctx.globalAlpha = 1;
    return;
  }
  const seen = motion.satellites[satellite]?.view[indexAt(motion.times, time)];
  if (seen) {
    ctx.strokeStyle = colours.burn;
    ctx.lineWidth = 1.5;
    strokeLine(ctx, at, [place, seen]);
    traceCircle(ctx, ...at(seen), 3);
    ctx.stroke();
  }
  ctx.fillStyle = agentColour(colours, satellite);
  traceCircle(ctx, x, y, 5);
  ctx.fill();
  ctx.fillText(String(satellite), x + 7, y - 7);
  ctx.globalAlpha = 1;
}
