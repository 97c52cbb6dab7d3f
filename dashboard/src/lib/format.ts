/** Formats numbers and times. Times are in the time zone of the browser. */
const whole = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });
const short = new Intl.NumberFormat("en", { notation: "compact", maximumFractionDigits: 1 });
const significantDigits = new Intl.NumberFormat("en", { maximumSignificantDigits: 4, useGrouping: false });
const significantShort = new Intl.NumberFormat("en", { notation: "compact", maximumSignificantDigits: 4 });
const moment = new Intl.DateTimeFormat("en", { dateStyle: "medium", timeStyle: "medium", hourCycle: "h23" });
const date = new Intl.DateTimeFormat("en", { dateStyle: "medium" });
const day = new Intl.DateTimeFormat("en", { month: "short", day: "numeric" });
const minute = new Intl.DateTimeFormat("en", { timeStyle: "short", hourCycle: "h23" });
const second = new Intl.DateTimeFormat("en", { timeStyle: "medium", hourCycle: "h23" });
const relative = new Intl.RelativeTimeFormat("en", { numeric: "auto", style: "short" });

/** Formats a count: 12345 as "12,345", 1234567 as "1.2M". */
export function count(n: number | null | undefined): string {
  if (n === null || n === undefined) return "–";
  return Math.abs(n) < 100_000 ? whole.format(n) : short.format(n);
}

/** Formats a count with its noun: "1 step", "2 steps". */
export function countOf(n: number, noun: string): string {
  return `${count(n)} ${noun}${n === 1 ? "" : "s"}`;
}

/** Formats a number with a fixed number of decimals. */
export function fixed(n: number | null | undefined, digits = 2): string {
  return n === null || n === undefined || !Number.isFinite(n)
    ? "–"
    : n.toFixed(digits).replace(/^-(0(?:\.0*)?)$/, "$1");
}

/** Formats a number with four significant digits: 12345678 as "12.35M", 0.00001234 as "1.234e-5". */
export function significant(n: number | null | undefined): string {
  if (n === null || n === undefined || !Number.isFinite(n)) return "–";
  const size = Math.abs(n);
  if ((size > 0 && size < 1e-3) || size >= 1e15)
    return n
      .toExponential(3)
      .replace(/\.?0+e/, "e")
      .replace("e+", "e");
  return (size < 100_000 ? significantDigits : significantShort).format(n);
}

/** Formats a difference with its sign: "+0.02", "−0.02". */
export function signed(difference: number, format: (size: number) => string = fixed): string {
  return `${difference < 0 ? "−" : "+"}${format(Math.abs(difference))}`;
}

/** Formats the size of a difference of shares in percentage points: 0.026 as "2.6 pp". */
export function points(difference: number): string {
  return `${(100 * difference).toFixed(1)} pp`;
}

/** Formats a share as a percentage. */
export function percent(n: number | null | undefined): string {
  return n === null || n === undefined || !Number.isFinite(n)
    ? "–"
    : `${(100 * n).toFixed(n > 0 && n < 0.1 ? 1 : 0)} %`;
}

const BYTE_UNITS = ["B", "KiB", "MiB", "GiB", "TiB"];

/** Formats a number of bytes: 1536 as "1.5 KiB". */
export function bytes(n: number | null | undefined): string {
  if (n === null || n === undefined || !Number.isFinite(n)) return "–";
  const power = Math.min(n < 1 ? 0 : Math.floor(Math.log2(n) / 10), BYTE_UNITS.length - 1);
  return `${fixed(n / 1024 ** power, power === 0 ? 0 : 1)} ${BYTE_UNITS[power] ?? ""}`;
}

/** Formats a date and time completely: "Nov 30, 2026, 09:13:48". */
export function time(at: string | number | null | undefined): string {
  return at === null || at === undefined ? "–" : moment.format(new Date(at));
}

const UNITS: [Intl.RelativeTimeFormatUnit, number][] = [
  ["day", 86_400_000],
  ["hour", 3_600_000],
  ["minute", 60_000],
  ["second", 1_000],
];

/** Formats the time since `at`: "3 hr. ago". */
export function ago(at: string | number, now: number): string {
  const difference = new Date(at).getTime() - now;
  const [unit, length] = UNITS.find(([, length]) => Math.abs(difference) >= length) ?? ["second", 1_000];
  return relative.format(Math.trunc(difference / length), unit);
}

const [MINUTE_MS, DAY_MS] = [60_000, 86_400_000];

/** Formats a time briefly: "3 hr. ago" within a week, else the date. The text has the complete time in its title (`Moment.svelte`). */
export function shortTime(at: string | number, now: number): string {
  const isRecent = Math.abs(new Date(at).getTime() - now) < 7 * DAY_MS;
  return isRecent ? ago(at, now) : date.format(new Date(at));
}

/** Formats a time on an axis whose labels are `step` milliseconds apart: the date, or the time of the day. */
export function axisTime(at: number, step: number): string {
  return (step >= DAY_MS ? day : step >= MINUTE_MS ? minute : second).format(new Date(at));
}

/** Formats the labels of an axis of times, in milliseconds: below a day apart, the first one of each day has its date too. */
export function axisTimes(ticks: readonly number[]): string[] {
  const step = (ticks[1] ?? 0) - (ticks[0] ?? 0);
  const days = ticks.map((tick) => day.format(new Date(tick)));
  return ticks.map((tick, i) => {
    const text = axisTime(tick, step);
    return step >= DAY_MS || days[i] === days[i - 1] ? text : `${text}\n${days[i] ?? ""}`;
  });
}

/** Formats a duration in its two largest units: "3 d 4 h". */
export function formatDuration(ms: number): string {
  const parts: [string, number][] = [
    ["d", 86_400_000],
    ["h", 3_600_000],
    ["min", 60_000],
    ["s", 1_000],
  ];
  const first = parts.findIndex(([, length]) => ms >= length);
  if (first < 0) return "0 s";
  let rest = ms;
  return parts
    .slice(first, first + 2)
    .map(([unit, length]) => {
      const n = Math.floor(rest / length);
      rest -= n * length;
      return n > 0 ? `${String(n)} ${unit}` : "";
    })
    .filter((text) => text !== "")
    .join(" ");
}

/** Returns the name of a task without its world: "survival" for kessler/survival. */
export function shortTask(task: string): string {
  return (task.split("/").pop() ?? task).replaceAll("_", " ");
}
