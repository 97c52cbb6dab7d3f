import { describe, expect, test } from "vitest";
import {
  ago,
  axisTimes,
  bytes,
  count,
  countOf,
  fixed,
  formatDuration,
  percent,
  points,
  shortTask,
  shortTime,
  signed,
  significant,
  time,
} from "./format";

describe("formatted numbers", () => {
  test("counts", () => {
    expect([count(0), count(12_345), count(1_234_567), count(null)]).toEqual(["0", "12,345", "1.2M", "–"]);
  });
  test("small shares have one more digit", () => {
    expect([percent(0), percent(0.034), percent(0.5), percent(1), percent(undefined), percent(NaN)]).toEqual([
      "0 %",
      "3.4 %",
      "50 %",
      "100 %",
      "–",
      "–",
    ]);
  });
  test("metrics have four significant digits", () => {
    expect([0, 0.31, -1.23456, 1234.56, 99_999.4, 12_345_678].map(significant)).toEqual([
      "0",
      "0.31",
      "-1.235",
      "1235",
      "100000",
      "12.35M",
    ]);
    expect([1e-3, 1.23456e-5, -3e-9, 2.5e18].map(significant)).toEqual([
      "0.001",
      "1.235e-5",
      "-3e-9",
      "2.5e18",
    ]);
    expect([significant(null), significant(NaN)]).toEqual(["–", "–"]);
  });
  test("unknown values are a dash", () => {
    expect([fixed(null), fixed(Infinity), fixed(1.005, 1)]).toEqual(["–", "–", "1.0"]);
  });
  test("durations have their two largest units", () => {
    expect([
      formatDuration(0),
      formatDuration(59_000),
      formatDuration(3_600_000),
      formatDuration(90_061_000),
    ]).toEqual(["0 s", "59 s", "1 h", "1 d 1 h"]);
  });
  test("relative times", () => {
    const now = Date.UTC(2026, 0, 2);
    expect([ago(now - 5_000, now), ago(now - 7_200_000, now)]).toEqual(["5 sec. ago", "2 hr. ago"]);
  });
  test("a time is relative within a week, else a date; completely it has 24 hours", () => {
    const now = new Date(2026, 10, 30, 21, 13, 48).getTime();
    expect(time(now)).toBe("Nov 30, 2026, 21:13:48");
    expect(shortTime(now - 3_600_000, now)).toBe("1 hr. ago");
    expect(shortTime(now - 6 * 86_400_000, now)).toBe("6 days ago");
    expect(shortTime(now - 8 * 86_400_000, now)).toBe("Nov 22, 2026");
  });
  test("labels of times are as exact as their distance, and each day has its date once", () => {
    const at = (...parts: [number, number, number?]) => new Date(2026, 10, ...parts).getTime();
    expect(axisTimes([at(30, 9), at(30, 9, 1), at(30, 9, 2)])).toEqual(["09:00\nNov 30", "09:01", "09:02"]);
    expect(axisTimes([at(29, 23), at(30, 0), at(30, 1)])).toEqual([
      "23:00\nNov 29",
      "00:00\nNov 30",
      "01:00",
    ]);
    expect(axisTimes([at(29, 0), at(30, 0)])).toEqual(["Nov 29", "Nov 30"]);
    expect(axisTimes([0, 10_000].map((ms) => at(30, 9) + ms))[1]).toBe("09:00:10");
  });
  test("differences have a sign, and those of shares are percentage points", () => {
    expect([signed(0.025), signed(-0.026, points), signed(0, points)]).toEqual([
      "+0.03",
      "−2.6 pp",
      "+0.0 pp",
    ]);
  });
  test("a noun is singular after 1 only", () => {
    expect([0, 1, 2].map((n) => countOf(n, "episode"))).toEqual(["0 episodes", "1 episode", "2 episodes"]);
  });
  test("task names omit the world", () => {
    expect(shortTask("kessler/eco_station")).toBe("eco station");
  });
});

test("bytes have a unit in powers of 1024", () => {
  expect([0, 1023, 1536, 5 * 1024 ** 3, null].map((n) => bytes(n))).toEqual([
    "0 B",
    "1023 B",
    "1.5 KiB",
    "5.0 GiB",
    "–",
  ]);
});
