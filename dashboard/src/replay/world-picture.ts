/** Pictures of all worlds: the data that each needs once, their size, and the drawing of a moment. */
import type { Palette } from "./canvas-shapes";
import { drawDocking, heightOf, type DockingPicture } from "./draw-docking";
import { drawKessler, type KesslerPicture } from "./draw-kessler";
import { drawTasking, mapHeight, type TaskingPicture } from "./draw-tasking";
import {
  isKessler,
  isTasking,
  type AnyFrame,
  type Approach,
  type DockingFrame,
  type KesslerFrame,
  type TaskingFrame,
} from "./frames";
import { joinMotion, timeAtStep, type EpisodeMotion } from "./tasking-motion";

/** Number of steps in which close approaches are predicted. */
const LOOK_AHEAD = 12;
/** Duration of one step of a trail in worlds whose steps differ in duration, s. */
const TRAIL_STEP_S = 300;
/** Steps of docking, which last a second, for one step of a trail. */
const DOCKING_TRAIL_STEPS = 10;

/** Frames of one world with the data that its picture needs. */
export type WorldPicture =
  | { world: "kessler"; frames: KesslerFrame[] }
  | { world: "docking"; frames: DockingFrame[] }
  | { world: "tasking"; frames: TaskingFrame[]; motion: EpisodeMotion; times: number[] };

/** Additions to the picture of a world, below its agents. */
export interface WorldUnderlay {
  kessler?: (picture: KesslerPicture) => void;
  docking?: (picture: DockingPicture) => void;
  tasking?: (picture: TaskingPicture) => void;
}

/** Moment and style of a picture. */
export interface PictureView {
  /** Position in steps, with fractions while a replay plays. */
  at: number;
  /** Length of trails, in steps. */
  trail: number;
  /** Agent that is emphasised; null for all. */
  chosen: number | null;
  underlay?: WorldUnderlay | undefined;
}

/** Width and height in pixels of the style sheet. */
export interface PictureSize {
  width: number;
  height: number;
}

/** Prepares the frames of an episode; null if there are none. */
export function prepareWorldPicture(frames: AnyFrame[]): WorldPicture | null {
  if (frames.length === 0) return null;
  if (isKessler(frames)) return { world: "kessler", frames };
  if (isTasking(frames)) {
    const times = frames.map(({ state }) => state.time_s);
    return { world: "tasking", frames, motion: joinMotion(frames), times };
  }
  return { world: "docking", frames: frames as DockingFrame[] };
}

/** Returns the size of a picture in a width, not higher than `maxHeight` if that is possible. */
export function worldPictureSize(picture: WorldPicture, width: number, maxHeight: number): PictureSize {
  if (picture.world === "kessler") {
    const side = Math.min(width, maxHeight);
    return { width: side, height: side };
  }
  if (picture.world === "docking") return { width, height: heightOf(width, maxHeight) };
  const mapWidth = Math.min(width, 2 * maxHeight);
  return { width: mapWidth, height: mapHeight(mapWidth) };
}

/** Draws a moment; returns the close approaches of kessler, nearest first. */
export function drawWorldPicture(
  ctx: CanvasRenderingContext2D,
  { width, height }: PictureSize,
  picture: WorldPicture,
  { at, trail, chosen, underlay }: PictureView,
  colours: Palette,
): Approach[] {
  const step = Math.max(0, Math.min(Math.floor(at), picture.frames.length - 1));
  if (picture.world === "kessler") {
    const options = { trail, ahead: LOOK_AHEAD, between: at - step, chosen, underlay: underlay?.kessler };
    return drawKessler(ctx, width, picture.frames, step, options, colours);
  }
  if (picture.world === "docking") {
    const steps = Math.max(trail * DOCKING_TRAIL_STEPS, 1);
    const view = { frames: picture.frames, at: step, trail: steps, chosen, underlay: underlay?.docking };
    drawDocking(ctx, width, height, view, colours);
    return [];
  }
  const { frames, motion, times } = picture;
  const frame = frames[step];
  const view = { motion, time: timeAtStep(times, at), trail: trail * TRAIL_STEP_S, chosen };
  if (frame) drawTasking(ctx, width, { ...view, frame, underlay: underlay?.tasking }, colours);
  return [];
}
