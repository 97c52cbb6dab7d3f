import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { expect, test } from "vitest";
import { lineStyle } from "./line-styles";

const CSS = readFileSync(fileURLToPath(new URL("line-styles.css", import.meta.url)), "utf8");
/** Colours seen with normal vision, and with the strongest protanopia, deuteranopia and tritanopia (Machado et al. 2009). */
const VISIONS = {
  normal: [1, 0, 0, 0, 1, 0, 0, 0, 1],
  protanopia: [0.152286, 1.052583, -0.204868, 0.114503, 0.786281, 0.099216, -0.003882, -0.048116, 1.051998],
  deuteranopia: [0.367322, 0.860646, -0.227968, 0.280085, 0.672501, 0.047413, -0.01182, 0.04294, 0.968881],
  tritanopia: [1.255528, -0.076749, -0.178779, -0.078411, 0.930809, 0.147602, 0.004733, 0.691367, 0.3039],
};
/** Colour of the cards on which curves are drawn. */
const CARD = { light: "#ffffff", dark: "#18202a" };
/** Smallest difference of two colours in CIE Lab, and smallest contrast with the card below them. */
const MIN_DIFFERENCE = 10;
const MIN_CONTRAST = 3;

type Triple = [number, number, number];

function linearRgb(hex: string): Triple {
  const channel = (at: number) => {
    const value = parseInt(hex.slice(at, at + 2), 16) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  };
  return [channel(1), channel(3), channel(5)];
}

function product(matrix: number[], [r, g, b]: Triple): Triple {
  const row = (at: number) => (matrix[at] ?? 0) * r + (matrix[at + 1] ?? 0) * g + (matrix[at + 2] ?? 0) * b;
  return [row(0), row(3), row(6)];
}

function lab(rgb: Triple): Triple {
  const [x, y, z] = product(
    [0.4338, 0.3762, 0.1899, 0.2126729, 0.7151522, 0.072175, 0.01776, 0.10946, 0.87277],
    rgb.map((value) => Math.min(1, Math.max(0, value))) as Triple,
  ).map((t) => (t > 0.008856 ? Math.cbrt(t) : 7.787 * t + 16 / 116)) as Triple;
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

const luminance = ([r, g, b]: Triple) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

function palette(theme: "light" | "dark"): { colours: string[]; card: string } {
  const part = theme === "light" ? CSS.split(':root[data-theme="dark"]')[0] : CSS.split('"dark"] {')[1];
  const value = (name: string) => new RegExp(`${name}: (#[0-9a-f]{6});`).exec(part ?? "")?.[1] ?? "";
  return { colours: Array.from({ length: 8 }, (_, i) => value(`--r${String(i)}`)), card: CARD[theme] };
}

test.each(["light", "dark"] as const)("colours of the %s theme differ with every vision", (theme) => {
  const { colours, card } = palette(theme);
  const ground = luminance(linearRgb(card));
  for (const colour of colours) {
    const own = luminance(linearRgb(colour));
    const contrast = (Math.max(own, ground) + 0.05) / (Math.min(own, ground) + 0.05);
    expect(contrast, `${colour} on ${card}`).toBeGreaterThan(MIN_CONTRAST);
  }
  for (const [vision, matrix] of Object.entries(VISIONS)) {
    const seen = colours.map((colour) => lab(product(matrix, linearRgb(colour))));
    seen.forEach((a, i) => {
      seen.slice(0, i).forEach((b, j) => {
        const difference = Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
        expect(difference, `${vision}: ${String(colours[i])} and ${String(colours[j])}`).toBeGreaterThan(
          MIN_DIFFERENCE,
        );
      });
    });
  }
});

test("more than eight curves have dashes", () => {
  const styles = Array.from({ length: 32 }, (_, i) => lineStyle(i));
  expect(styles.slice(0, 8).every(({ dash }) => dash === undefined)).toBe(true);
  expect(styles.slice(8).every(({ dash }) => dash !== undefined)).toBe(true);
  expect(new Set(styles.map((style) => JSON.stringify(style))).size).toBe(32);
});
