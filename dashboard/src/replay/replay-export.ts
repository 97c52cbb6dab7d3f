/** Files of a replay: the current frame as PNG, and the whole replay as GIF. */
import type { Palette } from "./canvas-shapes";
import { drawWorldPicture, worldPictureSize, type PictureView, type WorldPicture } from "./world-picture";

/** Picture of an exported file. */
export interface ExportPanel {
  title: string;
  picture: WorldPicture;
  /** Returns the position in the frames of the panel at a position of the episode. */
  positionAt: (at: number) => number;
}

/** Content of an exported file. */
export interface ReplayExport {
  /** Panels from left to right. */
  panels: ExportPanel[];
  /** Returns the line above the panels at a position. */
  captionAt: (at: number) => string;
  view: Omit<PictureView, "at">;
  colours: Palette;
}

/** Height of the caption, and of the titles of panels, in pixels. */
const LINE_HEIGHT = 22;
const PADDING = 8;
/** Largest width and height of a panel, in pixels. */
const PNG_PANEL = { width: 960, height: 720 };
const GIF_PANEL = { width: 560, height: 480 };
/** Time between two frames of a GIF, ms. Its unit is 10 ms. */
export const GIF_DELAY_MS = 80;
/** Largest number of frames of a GIF; a longer replay is faster in it. */
export const MAX_GIF_FRAMES = 240;
/** How long the last frame of a GIF stays, ms. */
const GIF_END_DELAY_MS = 1500;
const GIF_COLOURS = 128;

/**
 * Returns the positions of the frames of a GIF, from the first to the last step. `positionAfter` returns the position after a time
 * of the replay, which lasts `durationS`; both in s.
 */
export function gifPositions(durationS: number, positionAfter: (seconds: number) => number): number[] {
  const count = Math.max(2, Math.min(MAX_GIF_FRAMES, Math.ceil((1000 * durationS) / GIF_DELAY_MS) + 1));
  return Array.from({ length: count }, (_, k) => positionAfter((k * durationS) / (count - 1)));
}

/** Returns the current frame as a PNG file. */
export async function exportPng(content: ReplayExport, at: number): Promise<Blob> {
  const canvas = document.createElement("canvas");
  drawExport(canvas, content, at, PNG_PANEL, 2);
  return new Promise((resolve, reject) =>
    canvas.toBlob((blob) => {
      if (blob) resolve(blob);
      else reject(new Error("The browser cannot write a PNG file of this size."));
    }),
  );
}

/** Returns the replay as a GIF file; null if `signal` aborted it. `report` receives the number of frames that are done. */
export async function exportGif(
  content: ReplayExport,
  positions: number[],
  report: (done: number) => void,
  signal: AbortSignal,
): Promise<Blob | null> {
  const { GIFEncoder, quantize, applyPalette } = await import("gifenc");
  const canvas = document.createElement("canvas");
  const gif = GIFEncoder();
  const draw = (at: number) => drawExport(canvas, content, at, GIF_PANEL, 1);
  const sample = [0, 0.5, 1].map((share) => positions[Math.round(share * (positions.length - 1))] ?? 0);
  const palette = quantize(joinPixels(sample.map((at) => draw(at).data)), GIF_COLOURS);
  for (const [index, at] of positions.entries()) {
    if (signal.aborted) return null;
    const { data, width, height } = draw(at);
    const delay = index === positions.length - 1 ? GIF_END_DELAY_MS : GIF_DELAY_MS;
    gif.writeFrame(applyPalette(data, palette), width, height, index === 0 ? { palette, delay } : { delay });
    report(index + 1);
    await new Promise((resolve) => setTimeout(resolve)); // lets the page react
  }
  gif.finish();
  return new Blob([gif.bytes()], { type: "image/gif" });
}

function joinPixels(pictures: Uint8ClampedArray[]): Uint8ClampedArray {
  const joined = new Uint8ClampedArray(pictures.reduce((sum, { length }) => sum + length, 0));
  let offset = 0;
  for (const pixels of pictures) {
    joined.set(pixels, offset);
    offset += pixels.length;
  }
  return joined;
}

/** Draws caption and panels into a canvas of its own size, and returns its pixels. */
function drawExport(
  canvas: HTMLCanvasElement,
  { panels, captionAt, view, colours }: ReplayExport,
  at: number,
  panelSize: { width: number; height: number },
  ratio: number,
): ImageData {
  const sizes = panels.map(({ picture }) => worldPictureSize(picture, panelSize.width, panelSize.height));
  const width = sizes.reduce((sum, size) => sum + size.width + PADDING, PADDING);
  const top = panels.length > 1 ? 2 * LINE_HEIGHT : LINE_HEIGHT;
  const height = Math.max(...sizes.map((size) => size.height)) + top + PADDING;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const ctx = canvas.getContext("2d", { willReadFrequently: true });
  if (!ctx) throw new Error("The browser has no canvas for the export.");
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.fillStyle = colours.paper;
  ctx.fillRect(0, 0, width, height);
  ctx.font = "13px system-ui, sans-serif";
  ctx.fillStyle = colours.ink;
  ctx.fillText(captionAt(at), PADDING, LINE_HEIGHT - 6, width - 2 * PADDING);
  let left = PADDING;
  panels.forEach(({ title, picture, positionAt }, index) => {
    const size = sizes[index] ?? { width: 0, height: 0 };
    ctx.save();
    ctx.translate(left, top);
    ctx.fillStyle = colours.soft;
    if (panels.length > 1) ctx.fillText(title, 0, -7);
    ctx.font = "12px system-ui, sans-serif";
    ctx.beginPath();
    ctx.rect(0, 0, size.width, size.height);
    ctx.clip();
    drawWorldPicture(ctx, size, picture, { ...view, at: positionAt(at) }, colours);
    ctx.restore();
    left += size.width + PADDING;
  });
  return ctx.getImageData(0, 0, w, h);
}
