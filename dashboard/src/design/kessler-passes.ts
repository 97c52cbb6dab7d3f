/** Paths of the debris of each encounter of a kessler design, and the sector at which the design aims. */
import { predictPath, type KesslerFrame } from "../replay/frames";
import type { DesignedEncounter, DesignParts } from "./design-parts";

export interface Place {
  x: number;
  y: number;
}

/** Path of the debris of an encounter. */
export interface EncounterPass {
  encounter: DesignedEncounter;
  /** Step after which the path begins. */
  firstStep: number;
  /** Place after that step and after each following one. */
  path: Place[];
}

/** Sector from which the aimed debris comes. */
export interface AimSector {
  /** Encounter at which it is drawn. */
  pass: EncounterPass;
  /** Place of the satellite when the bearing is measured. */
  from: Place;
  /** Direction of the middle of the sector, as an angle from +X towards +Y in degrees. */
  directionDeg: number;
}

/** Largest number of steps of an episode. */
const HORIZON = 50;
/** Half of a sector, in degrees; the server uses the same. */
export const AIM_TOLERANCE_DEG = 15;
/** Number of steps before an encounter at which its bearing is measured. */
const BEARING_STEPS = 5;
/** Number of steps that the path of a decoy or screen continues after its encounter. */
const STEPS_AFTER_ENCOUNTER = 3;

/**
 * Returns the debris of each encounter: those of the start come first among the debris, in the order of the encounters, and
 * `rogues` has the others. Paths assume point gravity.
 */
export function encounterPasses(
  { encounters }: DesignParts,
  frames: KesslerFrame[],
  rogues: [number, number, number, number, number][],
): EncounterPass[] {
  const start = frames[0]?.state.radar_debris ?? [];
  let [nextBody, nextRogue] = [0, 0];
  return encounters.flatMap((encounter): EncounterPass[] => {
    const end = encounter.step + (encounter.kind === "threat" ? 0 : STEPS_AFTER_ENCOUNTER);
    if (encounter.rogue) {
      const row = rogues[nextRogue++];
      if (!row) return [];
      const [arrival, x, y, vx, vy] = row;
      const firstStep = Math.max(0, Math.round(arrival) - 1);
      const path = predictPath({ id: 0, x, y, vx, vy }, Math.max(0, end - firstStep));
      return [{ encounter, firstStep, path }];
    }
    const body = start[nextBody++];
    return body ? [{ encounter, firstStep: 0, path: predictPath(body, end) }] : [];
  });
}

/** Returns the place of the debris after a step; undefined outside the path. */
export function placeAfter({ path, firstStep }: EncounterPass, step: number): Place | undefined {
  return path[step - firstStep];
}

/** Returns the paths of the satellites if they hold and none is lost, by their index. */
export function coastPaths(frames: KesslerFrame[]): Place[][] {
  const steps = Math.max(HORIZON, frames.length - 1);
  return (frames[0]?.state.satellites ?? []).map((satellite) => predictPath(satellite, steps));
}

/** Returns the sector of the aim, at the first encounter that counts for it; null if the design aims at no bearing. */
export function aimSector(
  parts: DesignParts,
  passes: EncounterPass[],
  coast: Place[][],
  radarRange: number,
): AimSector | null {
  if (parts.aimBearing === null) return null;
  const wanted = parts.mode === "wasted_fuel" ? "decoy" : "threat";
  const ordered = passes.toSorted((a, b) => a.encounter.step - b.encounter.step);
  const aimed = ordered.find(({ encounter }) => encounter.kind === wanted) ?? ordered[0];
  if (!aimed) return null;
  const from = coast[aimed.encounter.satellite]?.[bearingStep(aimed, coast, radarRange)];
  if (!from) return null;
  const radial = (Math.atan2(from.y, from.x) * 180) / Math.PI;
  return { pass: aimed, from, directionDeg: parts.aimBearing + (parts.isInertial ? 0 : radial) };
}

/** Returns the step after which a bearing is measured: the earliest of the last ones in which a radar shows the debris. */
export function bearingStep(pass: EncounterPass, coast: Place[][], radarRange: number): number {
  const { encounter, firstStep } = pass;
  const exists = firstStep + (encounter.rogue ? 1 : 0);
  const range = radarRange > 0 ? radarRange : Infinity;
  for (let step = Math.max(exists, encounter.step - BEARING_STEPS); step <= encounter.step; step++) {
    const place = placeAfter(pass, step);
    const isVisible = coast.some((path) => {
      const satellite = path[step];
      return place && satellite && Math.hypot(satellite.x - place.x, satellite.y - place.y) <= range;
    });
    if (isVisible) return step;
  }
  return encounter.step;
}

/** Place of debris relative to a satellite, in LU. */
export interface RelativePlace {
  step: number;
  inTrack: number;
  radial: number;
}

/** Returns the last steps of a pass as its satellite sees them. */
export function relativePath(pass: EncounterPass, coast: Place[][], steps: number): RelativePlace[] {
  const { encounter, firstStep, path } = pass;
  return path.flatMap((place, index): RelativePlace[] => {
    const step = firstStep + index;
    const satellite = coast[encounter.satellite]?.[step];
    if (!satellite || step < encounter.step - steps) return [];
    const r = Math.max(Math.hypot(satellite.x, satellite.y), 1e-9);
    const [rx, ry] = [satellite.x / r, satellite.y / r];
    const [dx, dy] = [place.x - satellite.x, place.y - satellite.y];
    return [{ step, inTrack: dy * rx - dx * ry, radial: dx * rx + dy * ry }];
  });
}

/** Returns the step in which a satellite is lost; null if it is not. */
export function stepOfLoss(frames: KesslerFrame[], satellite: number): number | null {
  const step = frames.findIndex(({ state }) => state.satellites[satellite]?.status !== "active");
  return step < 0 ? null : step;
}
