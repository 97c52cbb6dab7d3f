/** Colours and shapes that the pictures of all worlds share. */

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
  /** Sector at which a design aims. */
  aim: string;
  /** Decoys of designs, and the Sun. */
  decoy: string;
}

/** Opacity of an agent that is not the chosen one. */
const FAINT = 0.3;

/** Returns the opacity of an agent; `chosen` is the agent that the user chose, or null for all. */
export function agentOpacity(agent: number, chosen: number | null): number {
  return chosen === null || chosen === agent ? 1 : FAINT;
}

/** Returns the colour of an agent; the colours repeat if there are more agents. */
export function agentColour(colours: Palette, agent: number): string {
  return colours.satellite[agent % colours.satellite.length] ?? colours.ink;
}

/** Begins a path that is a circle; the caller strokes or fills it. */
export function traceCircle(ctx: CanvasRenderingContext2D, x: number, y: number, r: number) {
  ctx.beginPath();
  ctx.arc(x, y, r, 0, 2 * Math.PI);
}

export function drawCross(ctx: CanvasRenderingContext2D, x: number, y: number, size: number, colour: string) {
  ctx.strokeStyle = colour;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(x - size, y - size);
  ctx.lineTo(x + size, y + size);
  ctx.moveTo(x - size, y + size);
  ctx.lineTo(x + size, y - size);
  ctx.stroke();
}

export function drawArrow(
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
