import { expect, test } from "vitest";
import { skillTrend, trendOf } from "./trend";

const quarters = (before: number, last: number, noise: number) =>
  Array.from({ length: 40 }, (_, i) => (i < 30 ? before : last) + (i % 2 === 0 ? noise : -noise));

test("a difference beyond the noise is a trend", () => {
  expect(trendOf(quarters(0.5, 0.7, 0.05))?.direction).toBe("rising");
  expect(trendOf(quarters(0.7, 0.5, 0.05))?.direction).toBe("falling");
  expect(trendOf(quarters(0.5, 0.55, 0.2))?.direction).toBe("steady");
  expect(trendOf(quarters(0.5, 0.7, 0.05))?.difference).toBeCloseTo(0.2, 6);
});

test("few known values have no trend", () => {
  expect(trendOf([])).toBeNull();
  expect(trendOf([0.1, 0.2, 0.3])).toBeNull();
  expect(trendOf([...quarters(0.5, 0.7, 0).slice(0, 37), null, null, null])?.direction).toBe("rising");
  expect(trendOf(Array.from({ length: 40 }, () => null))).toBeNull();
});

test("skill at other levels is no part of the trend", () => {
  const skill = quarters(0.9, 0.5, 0.05);
  const level = Array.from({ length: 40 }, (_, i) => (i < 30 ? 1 : 2));
  expect(trendOf(skill)?.direction).toBe("falling");
  expect(skillTrend({ skill, level })).toBeNull();
  expect(skillTrend({ skill, level: level.map(() => 2) })?.direction).toBe("falling");
});
