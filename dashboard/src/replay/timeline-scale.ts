/** Mapping of the common axis of the timeline to pixels. */
import type { TimelineAxis } from "./timeline-charts";

/** Space on the left for the numbers and names of rows, in pixels. */
export const LEFT = 62;
/** Space on the right for the numbers of agents, in pixels. */
export const RIGHT = 18;

/** Returns the pixel of a position on the axis. */
export function pixelAt(axis: TimelineAxis, width: number, position: number): number {
  return LEFT + ((width - LEFT - RIGHT) * position) / axis.end;
}

/** Returns the frame nearest to a pixel. */
export function frameAt(axis: TimelineAxis, width: number, pixel: number): number {
  const position = ((pixel - LEFT) / Math.max(width - LEFT - RIGHT, 1)) * axis.end;
  let nearest = 0;
  axis.positions.forEach((place, index) => {
    if (Math.abs(place - position) < Math.abs((axis.positions[nearest] ?? 0) - position)) nearest = index;
  });
  return nearest;
}
