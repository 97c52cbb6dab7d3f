/** Size and resolution of the canvases that show a world; app.css has their style (`figure.world`). */
import { innerHeight } from "svelte/reactivity/window";

/** Largest side of a square picture, in CSS pixels. */
const MAX_SIDE = 720;
/** Smallest side that a low window causes, in CSS pixels. */
const MIN_SIDE = 320;
/** Height that a page needs beside a picture by default, in CSS pixels. */
const DEFAULT_RESERVED = 260;
/** Height of the window before it is known, in CSS pixels. */
const DEFAULT_WINDOW_HEIGHT = 900;

/** Returns the largest height of a picture: it fits the window together with `reserved` pixels for all else. */
export function maxPictureHeight(reserved = DEFAULT_RESERVED): number {
  const windowHeight = innerHeight.current ?? DEFAULT_WINDOW_HEIGHT;
  return Math.min(MAX_SIDE, Math.max(MIN_SIDE, windowHeight - reserved));
}

/** Returns the side of a square picture, in CSS pixels: it fits the width and the window. */
export function squareSide(width: number): number {
  return Math.min(width, maxPictureHeight());
}

/** Sets the resolution of a canvas to device pixels, and returns its context, scaled to CSS pixels; null if there is none. */
export function beginDrawing(
  canvas: HTMLCanvasElement | undefined,
  width: number,
  height: number,
): CanvasRenderingContext2D | null {
  const ctx = canvas?.getContext("2d");
  if (!canvas || !ctx) return null;
  const ratio = devicePixelRatio;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  // Setting the size clears the canvas, even if the size is the same.
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.font = "12px system-ui, sans-serif";
  return ctx;
}
