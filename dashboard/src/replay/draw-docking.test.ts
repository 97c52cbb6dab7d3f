import { expect, test } from "vitest";
import { heightOf, reachAt } from "./draw-docking";
import type { DockingFrame } from "./frames";

function dockingFrame(step: number, x: number): DockingFrame {
  const deputy = {
    id: 0,
    x,
    y: 0,
    z: 0,
    vx: 0,
    vy: 0,
    vz: 0,
    speed: 0,
    speed_limit: 1,
    distance: x,
    status: "active",
  };
  const state = { deputies: [deputy], docking_radius: 0.5, critical_alerts: [], total_score: 0 };
  return { step, actions: [], reward: 0, done: false, state };
}

test("a picture reaches a round distance beyond the deputies of its trail", () => {
  const frames = [950, 400, 40, 0.2].map((x, step) => dockingFrame(step, x));
  expect(reachAt(frames, 0, 1)).toEqual({ along: 1500, away: 1500 });
  expect(reachAt(frames, 1, 1).along).toBe(1500); // the trail is visible
  expect(reachAt(frames, 2, 1).along).toBe(500);
  expect(reachAt(frames, 3, 1).along).toBe(50);
  expect(reachAt(frames, 3, 0).along).toBe(10);
});

test("the three squares are arranged for the largest size", () => {
  expect(heightOf(1200, 640)).toBeLessThan(450); // in a row
  const high = heightOf(600, 600);
  expect(high).toBeGreaterThan(500); // two rows
  expect(high).toBeLessThanOrEqual(600);
  expect(heightOf(360, Infinity)).toBeGreaterThan(900); // stacked
});
