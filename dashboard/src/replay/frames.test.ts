import { expect, test } from "vitest";
import { closestApproaches, predictPath, type KesslerState } from "./frames";

const GM = 1000;
const circular = (id: number, r: number, angle: number) => {
  const v = Math.sqrt(GM / r);
  return {
    id,
    x: r * Math.cos(angle),
    y: r * Math.sin(angle),
    vx: -v * Math.sin(angle),
    vy: v * Math.cos(angle),
  };
};

test("a circular orbit keeps its radius and Kepler's period", () => {
  const period = 2 * Math.PI * Math.sqrt(60 ** 3 / GM); // 92.3 TU
  const positions = predictPath(circular(0, 60, 0), Math.round(period));
  // Semi-implicit Euler at dt = 1 shifts it by O(dt · v) along the track, with bounded error.
  for (const { x, y } of positions) expect(Math.abs(Math.hypot(x, y) - 60)).toBeLessThan(2.5);
  const last = positions.at(-1);
  expect(Math.hypot((last?.x ?? 0) - 60, last?.y ?? 99)).toBeLessThan(4);
});

test("a path ends at the Earth", () => {
  const positions = predictPath({ id: 0, x: 30, y: 0, vx: -8, vy: 0 }, 50);
  expect(positions.length).toBeLessThan(5);
});

test("close approaches are found, nearest first", () => {
  const satellite = { ...circular(0, 70, 0), fuel: 10, status: "active" };
  // The same orbit in the opposite direction: both meet half-way.
  const oncoming = {
    ...circular(1, 70, Math.PI / 4),
    vx: -circular(1, 70, Math.PI / 4).vx,
    vy: -circular(1, 70, Math.PI / 4).vy,
  };
  const far = circular(2, 50, Math.PI);
  const state: KesslerState = {
    satellites: [satellite],
    radar_debris: [far, oncoming],
    radar_range: 0,
    critical_alerts: [],
    total_score: 0,
  };
  const approaches = closestApproaches(state, 20, 12);
  expect(approaches[0]).toMatchObject({ satellite: 0, body: 1 });
  const misses = approaches.map(({ miss }) => miss);
  expect(misses).toEqual(misses.toSorted((a, b) => a - b));
  expect(
    closestApproaches({ ...state, satellites: [{ ...satellite, status: "destroyed" }] }, 20, 12),
  ).toEqual([]);
});
