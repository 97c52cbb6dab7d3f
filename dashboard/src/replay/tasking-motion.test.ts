import { describe, expect, it } from "vitest";
import { circleAround } from "./draw-tasking";
import type { SatelliteMotion, TaskingFrame } from "./frames";
import {
  actionKind,
  indexAt,
  joinMotion,
  placeAt,
  stepAtTime,
  timeAtStep,
  wrapLongitude,
} from "./tasking-motion";
import { formatDuration } from "./time-text";

/** Samples of a satellite that moves along the equator. */
function samples(longitudes: number[]): SatelliteMotion {
  const same = <T>(value: T) => longitudes.map(() => value);
  return {
    longitude: longitudes,
    latitude: same(0),
    view: same(null),
    battery: same(0.5),
    storage: same(0),
    wheels: same(0.1),
    instrument_error: same(3),
    sun_error: same(90),
    sunlight: same(1),
    station: same(null),
  };
}

function frame(step: number, times: number[], longitudes: number[], action: string | null): TaskingFrame {
  return {
    step,
    actions: [],
    reward: 0,
    done: false,
    state: {
      time_s: times.at(-1) ?? 0,
      time_limit_s: 60,
      actions: ["scan", "charge"],
      satellites: [
        {
          id: 0,
          alive: true,
          needs_action: true,
          action,
          battery: 0.5,
          storage: 0,
          wheels: [0.1, 0, 0],
          instrument_error_deg: 3,
          sun_error_deg: 90,
          targets: [],
        },
      ],
      critical_alerts: [],
      total_score: 0,
      map: {
        motion: { time_s: times, sun: times.map(() => [0, 0]), satellites: [samples(longitudes)] },
        upcoming: [[]],
        tasked: [null],
        imaged: step === 2 ? [[0, 4]] : [],
        links: [],
      },
    },
  };
}

const FRAMES = [
  frame(0, [0], [170], null),
  frame(1, [10, 20, 25], [176, -178, -175], "scan"),
  frame(2, [35, 40], [-169, -166], "image_3"),
];

describe("joinMotion", () => {
  it("joins the samples of all frames with the action of each step", () => {
    const motion = joinMotion(FRAMES);
    expect(motion.times).toEqual([0, 10, 20, 25, 35, 40]);
    expect(motion.satellites[0]?.action).toEqual([null, "scan", "scan", "scan", "image_3", "image_3"]);
    expect(motion.spans).toEqual([
      { step: 1, start: 0, end: 25, actions: ["scan"] },
      { step: 2, start: 25, end: 40, actions: ["image_3"] },
    ]);
    expect(motion.images).toEqual([{ time: 40, satellite: 0, target: 4 }]);
  });

  it("interpolates places on the short way over the date line", () => {
    const motion = joinMotion(FRAMES);
    expect(placeAt(motion, 0, 15)).toEqual([179, 0]);
    expect(placeAt(motion, 0, 18)[0]).toBeCloseTo(-179.2);
    expect(placeAt(motion, 0, 99)).toEqual([-166, 0]);
    expect(placeAt(motion, 0, -5)).toEqual([170, 0]);
  });
});

describe("times and steps", () => {
  it("are converted into each other", () => {
    const times = [0, 25, 40];
    for (const [step, time] of [
      [0, 0],
      [0.4, 10],
      [1, 25],
      [1.5, 32.5],
      [2, 40],
    ] as const) {
      expect(timeAtStep(times, step)).toBeCloseTo(time);
      expect(stepAtTime(times, time)).toBeCloseTo(step);
    }
    expect(stepAtTime(times, 99)).toBe(2);
    expect(indexAt(times, -1)).toBe(0);
  });
});

describe("small helpers", () => {
  it("wrap longitudes, name kinds of actions and format durations", () => {
    expect([190, -190, 540, 10].map(wrapLongitude)).toEqual([-170, 170, -180, 10]);
    expect(["image_9", "charge", null].map(actionKind)).toEqual(["image", "charge", "none"]);
    expect([5, 60, 725, 28_500].map(formatDuration)).toEqual(["5 s", "1 min", "12 min 5 s", "7 h 55 min"]);
  });

  it("draws circles at a constant distance", () => {
    const rad = Math.PI / 180;
    for (const [longitude, latitude] of circleAround([10, 60], 20)) {
      const cosine =
        Math.sin(60 * rad) * Math.sin(latitude * rad) +
        Math.cos(60 * rad) * Math.cos(latitude * rad) * Math.cos((longitude - 10) * rad);
      expect(Math.acos(cosine) / rad).toBeCloseTo(20, 6);
    }
  });
});
