import { expect, test } from "vitest";
import { gifPositions, MAX_GIF_FRAMES } from "./replay-export";

test("a GIF goes from the first to the last step at the speed of the replay", () => {
  const positions = gifPositions(2, (seconds) => 5 * seconds);
  expect(positions).toHaveLength(26); // a frame each 80 ms
  expect([positions[0], positions.at(-1)]).toEqual([0, 10]);
  expect(positions[1]).toBeCloseTo(0.4);
});

test("a long replay is limited to the largest number of frames", () => {
  const positions = gifPositions(600, (seconds) => seconds);
  expect(positions).toHaveLength(MAX_GIF_FRAMES);
  expect(positions.at(-1)).toBe(600);
});

test("an episode without steps has two frames", () => {
  expect(gifPositions(0, () => 0)).toEqual([0, 0]);
});
