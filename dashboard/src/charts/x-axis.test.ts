import { expect, test } from "vitest";
import { stepClock } from "./step-clock";
import { durationText, episodesAt, middle, positionOf, spans, type PlacedPoints } from "./x-axis";

const POINTS: PlacedPoints = {
  at: [100, 110, 130],
  until: [110, 130, 130],
  first_episode: [0, 8, 24],
  first_step: [0, 400, 1000],
  steps: [400, 600, 50],
  episodes: [8, 10, 2],
  claimed: [0, 6, 0],
  version_high: [1, 4, 3],
};

test("each axis places the points of a series", () => {
  expect(spans("time", POINTS, 100)).toEqual([
    { from: 100, to: 110 },
    { from: 110, to: 130 },
    { from: 130, to: 130 },
  ]);
  expect(spans("elapsed", POINTS, 100).map(middle)).toEqual([5, 20, 30]);
  expect(spans("episodes", POINTS, 100).map(({ to }) => to)).toEqual([8, 24, 26]);
  expect(spans("steps", POINTS, 100).map(middle)).toEqual([200, 700, 1025]);
  // The last result is of an older version.
  expect(spans("version", POINTS, 100)).toEqual([
    { from: 1, to: 1 },
    { from: 1, to: 4 },
    { from: 4, to: 4 },
  ]);
  const clock = stepClock([{ at: [100, 120], step: [0, 40] }]);
  expect(spans("step", POINTS, 100, clock)).toEqual([
    { from: 0, to: 20 },
    { from: 20, to: 40 },
    { from: 40, to: 40 },
  ]);
});

test("a moment lies between the points around it", () => {
  const places = spans("episodes", POINTS, 100);
  expect(positionOf(90, POINTS, places)).toBe(0);
  expect(positionOf(105, POINTS, places)).toBe(4);
  expect(positionOf(120, POINTS, places)).toBe(16);
  expect(positionOf(500, POINTS, places)).toBe(26);
  expect(positionOf(1, { ...POINTS, at: [], until: [] }, [])).toBeUndefined();
});

test("a selection on one axis is a range of episodes", () => {
  const [steps, episodes] = [spans("steps", POINTS, 100), spans("episodes", POINTS, 100)];
  expect(episodesAt(-1, steps, episodes)).toBe(0);
  expect(episodesAt(200, steps, episodes)).toBe(4);
  expect(episodesAt(700, steps, episodes)).toBe(16);
  expect(episodesAt(9999, steps, episodes)).toBe(26);
});

test("durations have the unit that fits the axis", () => {
  expect(durationText(0, 10)).toBe("0 s");
  expect(durationText(45, 5)).toBe("45 s");
  expect(durationText(90, 30)).toBe("1.5 min");
  expect(durationText(7200, 3600)).toBe("2 h");
  expect(durationText(172_800, 86_400)).toBe("2 d");
});
