/** Thresholds and markers of a chart, drawn above its curves. */
import type uPlot from "uplot";
import type { Marker } from "./series";

/** Half of the width of a marker, in CSS pixels. */
const MARKER_SIZE = 5;

/** Draws the thresholds as dashed lines, and a triangle at the bottom for each marker. `colour` resolves a custom property. */
export function drawOverlay(u: uPlot, lines: number[], markers: Marker[], colour: (name: string) => string) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.strokeStyle = colour("--soft");
  ctx.setLineDash([6, 4]);
  for (const line of lines) {
    const y = u.valToPos(line, "y", true);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  }
  ctx.setLineDash([]);
  for (const marker of markers) drawMarker(u, marker, colour);
  ctx.restore();
}

/** Draws a triangle whose tip points in the direction of the move. */
function drawMarker(u: uPlot, marker: Marker, colour: (name: string) => string) {
  const { ctx, bbox } = u;
  const x = u.valToPos(marker.at, "x", true);
  if (x < bbox.left || x > bbox.left + bbox.width) return;
  const size = MARKER_SIZE * devicePixelRatio;
  const bottom = bbox.top + bbox.height;
  const direction = marker.kind === "down" ? 1 : -1;
  ctx.fillStyle = colour(marker.kind === "down" ? "--bad" : "--good");
  ctx.beginPath();
  ctx.moveTo(x - size, bottom - size - direction * size);
  ctx.lineTo(x + size, bottom - size - direction * size);
  ctx.lineTo(x, bottom - size + direction * size);
  ctx.fill();
}
