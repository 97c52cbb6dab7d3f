/** Colours of pictures, read from the style of the page. */
import { appearance } from "../lib/theme.svelte";
import type { Palette } from "./canvas-shapes";

/** Reads the palette of the current colour scheme; effects that call it run again when the scheme changes. */
export function readPalette(): Palette {
  void appearance.dark; // dependency: redraw when the colour scheme changes
  const css = getComputedStyle(document.documentElement);
  const colour = (name: string) => css.getPropertyValue(name).trim();
  return {
    paper: colour("--card"),
    ink: colour("--ink"),
    soft: colour("--soft"),
    line: colour("--line"),
    earth: colour("--earth"),
    satellite: [colour("--c0"), colour("--c2"), colour("--c3"), colour("--c4")],
    debris: colour("--soft"),
    bad: colour("--bad"),
    burn: colour("--c1"),
  };
}
