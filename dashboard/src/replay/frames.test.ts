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
  const places = predictPath(circular(0, 60, 0), Math.round(period));
  // Semi-implicit Euler at dt = 1 shifts it by O(dt · v) along the track, with bounded error.
  for (const { x, y } of places) expect(Math.abs(Math.hypot(x, y) - 60)).toBeLessThan(2.5);
  const last = places.at(-1);
  expect(Math.hypot((last?.x ?? 0) - 60, last?.y ?? 99)).toBeLessThan(4);
});

test("a path ends at the Earth", () => {
  const places = predictPath({ id: 0, x: 30, y: 0, vx: -8, vy: 0 }, 50);
  expect(places.length).toBeLessThan(5);
});

test("an approach is found at its place, nearest first", () => {
  const satellite = { ...circular(0, 70, 0), fuel: 10, status: "active" };
  // The same orbit in the opposite direction: they meet half-way.
  const meets = {
    ...circular(1, 70, Math.PI / 4),
    vx: -circular(1, 70, Math.PI / 4).vx,
    vy: -circular(1, 70, Math.PI / 4).vy,
  };
  const far = circular(2, 50, Math.PI);
  const state: KesslerState = {
    satellites: [satellite],
    radar_debris: [far, meets],
    radar_range: 0,
    critical_alerts: [],
    total_score: 0,
  };
  const found = closestApproaches(state, 20, 12);
  expect(found[0]).toMatchObject({ satellite: 0, body: 1 });
  expect(found.every((one, i) => i === 0 || one.miss >= (found[i - 1]?.miss ?? 0))).toBe(true);
  expect(
    closestApproaches({ ...state, satellites: [{ ...satellite, status: "destroyed" }] }, 20, 12),
  ).toEqual([]);
});
