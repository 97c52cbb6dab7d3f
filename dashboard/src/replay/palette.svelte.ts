/** The colours of pictures, as the page has them. */
import { appearance } from "../lib/theme.svelte";
import type { Palette } from "./draw-kessler";

export function palette(): Palette {
  void appearance.dark; // what is drawn by it is drawn again when that changes
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
