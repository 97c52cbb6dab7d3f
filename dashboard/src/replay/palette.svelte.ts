/** Colours of pictures, read from the style of the page. */
import { appearance } from "../lib/theme.svelte";
import { AGENT_COLOURS } from "./agent-style";
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
    satellite: AGENT_COLOURS.map(colour),
    debris: colour("--soft"),
    bad: colour("--bad"),
    burn: colour("--c1"),
    aim: colour("--c1"),
    decoy: colour("--c4"),
  };
}
