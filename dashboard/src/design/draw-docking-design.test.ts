import { expect, test } from "vitest";
import type { Deputy } from "../replay/frames";
import { readDesignParts } from "./design-parts";
import { aimedDeputy } from "./draw-docking-design";

function deputyAt(id: number, x: number, y: number): Deputy {
  const still = {
    vx: 0,
    vy: 0,
    vz: 0,
    speed: 0,
    speed_limit: 1,
    distance: Math.hypot(x, y),
    status: "active",
  };
  return { id, x, y, z: 0, ...still };
}

const DEPUTIES = [deputyAt(0, 100, 0), deputyAt(1, 0, -80), deputyAt(2, 100, 50)];

test("the aimed deputy meets the chief from the aimed bearing", () => {
  const aim = (bearing: number | null) => readDesignParts({ aim: { mode: "crash", bearing_deg: bearing } });
  // Bearings count from radial out (x) towards in-track (y).
  expect(aimedDeputy(aim(180), DEPUTIES)?.id).toBe(0);
  expect(aimedDeputy(aim(88), DEPUTIES)?.id).toBe(1);
  expect(aimedDeputy(aim(210), DEPUTIES)?.id).toBe(2);
  expect(aimedDeputy(aim(null), DEPUTIES)).toBeNull();
});

test("in a collision it meets another deputy", () => {
  const parts = readDesignParts({ aim: { mode: "collision", bearing_deg: 90 } });
  expect(aimedDeputy(parts, DEPUTIES)?.id).toBe(0); // deputy 2 is ahead of it
});
