import { describe, expect, test } from "vitest";
import { ago, bytes, count, fixed, formatDuration, percent, shortTask, significant } from "./format";

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
