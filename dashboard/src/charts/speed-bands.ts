import type { SpeedBand } from "../lib/api-types";

/** Formats a band: "0.5 to 1 LU/TU", or "2 LU/TU and more". */
export function formatSpeedBand({ from, to, unit }: SpeedBand): string {
  return to === null || to === undefined
    ? `${String(from)} ${unit} and more`
    : `${String(from)} to ${String(to)} ${unit}`;
}
