import { expect, test } from "vitest";
import type { AnyFrame } from "./frames";
import { agentsOf, roundTicks, spreadLabels, timelineAxis, timelineCharts } from "./timeline-charts";

function kesslerFrame(step: number, reward: number, fuel: number[]): AnyFrame {
  const satellites = fuel.map((left, id) => ({ id, x: 0, y: 0, vx: 0, vy: 0, fuel: left, status: "active" }));
  const state = { satellites, radar_debris: [], radar_range: 0, critical_alerts: [], total_score: 0 };
  return { step, actions: [], reward, done: false, state };
}

const FRAMES = [kesslerFrame(0, 0, [10, 10]), kesslerFrame(1, 0.5, [10, 8]), kesslerFrame(2, -0.25, [4, 8])];

test("kessler has the fuel of each satellite and the reward", () => {
  const [fuel, reward] = timelineCharts(FRAMES);
  expect(fuel).toEqual({
    title: "Fuel (units)",
    curves: [
      { agent: 0, values: [10, 10, 4] },
      { agent: 1, values: [10, 8, 8] },
    ],
    low: 0,
    high: 10,
  });
  expect(reward).toMatchObject({ title: "Reward per step", low: -0.25, high: 0.5 });
  expect(agentsOf(FRAMES)).toEqual([0, 1]);
  expect(timelineAxis(FRAMES)).toEqual({ title: "Step (1 TU each)", positions: [0, 1, 2], end: 2 });
});

test("a constant quantity has a range that can be drawn", () => {
  expect(timelineCharts([kesslerFrame(0, 0, [0])])[0]).toMatchObject({ low: 0, high: 1 });
});

test("an axis of curves that differ by little does not start at 0", () => {
  const [fuel] = timelineCharts([kesslerFrame(0, 0, [100, 100]), kesslerFrame(1, 0, [100, 90])]);
  expect(fuel).toMatchObject({ low: 89, high: 100 });
});

test("ticks are round numbers within the range", () => {
  expect(roundTicks(0, 50, 5)).toEqual([0, 10, 20, 30, 40, 50]);
  expect(roundTicks(-0.25, 0.5, 3)).toEqual([0, 0.5]);
  expect(roundTicks(0, 475, 6)).toEqual([0, 100, 200, 300, 400]);
  expect(roundTicks(3, 3, 4)).toEqual([3]);
});

test("labels at one place move apart, and stay within the chart", () => {
  expect(spreadLabels([10, 50], 12, 0, 60)).toEqual([10, 50]);
  expect(spreadLabels([50, 50, 50], 12, 0, 60)).toEqual([36, 48, 60]);
});
