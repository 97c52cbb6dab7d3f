/** Colours of pictures, read from the style of the page. */
import { appearance } from "../lib/theme.svelte";
import type { Palette } from "./draw-kessler";

export function palette(): Palette {
  void appearance.dark; // dependency: redraw when the colour scheme changes
  const css = getComputedStyle(document.documentElement);
  const of = (name: string) => css.getPropertyValue(name).trim();
  return {
    paper: of("--card"),
    ink: of("--ink"),
    soft: of("--soft"),
    line: of("--line"),
    earth: of("--earth"),
    satellite: [of("--c0"), of("--c2"), of("--c3"), of("--c4")],
    debris: of("--soft"),
    bad: of("--bad"),
    burn: of("--c1"),
  };
}
