import { expect, test } from "vitest";
import type { KesslerFrame } from "../replay/frames";
import { readDesignParts, readRogues } from "./design-parts";
import {
  aimSector,
  bearingStep,
  coastPaths,
  encounterPasses,
  placeAfter,
  relativePath,
} from "./kessler-passes";

const SPEED = Math.sqrt(1000 / 60);
const satellite = { id: 0, x: 60, y: 0, vx: 0, vy: SPEED, fuel: 10, status: "active" };
/** Debris ahead of the satellite on its orbit. */
const ahead = {
  id: 0,
  x: 60 * Math.cos(0.5),
  y: 60 * Math.sin(0.5),
  vx: -SPEED * Math.sin(0.5),
  vy: SPEED * Math.cos(0.5),
};
const FRAMES: KesslerFrame[] = [
  {
    step: 0,
    actions: [],
    reward: 0,
    done: false,
    state: {
      satellites: [satellite],
      radar_debris: [ahead],
      radar_range: 300,
      critical_alerts: [],
      total_score: 0,
    },
  },
];
const PARTS = readDesignParts({
  aim: { mode: "collision", bearing_deg: 90 },
  frame: "radial_in_track",
  encounters: [
    { satellite: 0, step: 9, kind: "threat", rogue: true },
    { satellite: 0, step: 12, kind: "decoy" },
  ],
});
const ROGUES = readRogues({ layout: { bodies: { rogues: [[4, 70, 0, 0, 1], "invalid", [1]] } } });

test("debris is assigned to the encounters in their order", () => {
  const [rogue, decoy] = encounterPasses(PARTS, FRAMES, ROGUES);
  expect(rogue?.firstStep).toBe(3);
  expect(rogue && placeAfter(rogue, 3)).toEqual({ x: 70, y: 0 });
  expect(rogue?.path).toHaveLength(7); // steps 3 to 9
  expect(decoy?.firstStep).toBe(0);
  expect(decoy?.path).toHaveLength(16); // steps 0 to 15: three after the encounter
  expect(encounterPasses(PARTS, FRAMES, [])).toHaveLength(1); // a rogue that the scenario lacks
});

test("a sector opens at the satellite, towards the aimed bearing", () => {
  const passes = encounterPasses(PARTS, FRAMES, ROGUES);
  const coast = coastPaths(FRAMES);
  const sector = aimSector(PARTS, passes, coast, 300);
  const step = passes[0] ? bearingStep(passes[0], coast, 300) : -1;
  expect(step).toBe(4); // five steps before the encounter
  const place = coast[0]?.[4];
  expect(sector?.from).toEqual(place);
  // 90° from radial out is in-track.
  const radial = (Math.atan2(place?.y ?? 0, place?.x ?? 0) * 180) / Math.PI;
  expect(sector?.directionDeg).toBeCloseTo(radial + 90);
  expect(aimSector({ ...PARTS, aimBearing: null }, passes, coast, 300)).toBeNull();
});

test("a pass is relative to the radial and in-track axes of its satellite", () => {
  const [, decoy] = encounterPasses(PARTS, FRAMES, ROGUES);
  const [first] = decoy ? relativePath(decoy, coastPaths(FRAMES), 12) : [];
  // A chord of 0.5 rad on a circle of 60 LU: ahead, and below the tangent.
  expect(first?.inTrack).toBeCloseTo(60 * Math.sin(0.5));
  expect(first?.radial).toBeCloseTo(60 * (Math.cos(0.5) - 1));
});

test("designs of other worlds and invalid ones have no encounters", () => {
  for (const design of [null, "text", {}, { encounters: "many", aim: [] }])
    expect(readDesignParts(design)).toEqual({
      mode: "",
      aimBearing: null,
      isInertial: false,
      encounters: [],
      fields: [],
    });
});
