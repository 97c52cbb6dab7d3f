/** Gallery: every component of the dashboard in all of its states, fed by fixtures. */
import { mount } from "svelte";
import "@fontsource-variable/roboto";
import "uplot/dist/uPlot.min.css";
import "../src/app.css";
import "./gallery.css";
import { answer } from "./answers";
import { NOW } from "./fixtures/numbers";

// Both before the first component loads: a clock that stands still, and a server that has fixtures only.
Date.now = () => NOW;
window.fetch = answer;

// Charts draw their texts once: the font must be there before.
await Promise.all(
  [400, 600, 700].map((weight) => document.fonts.load(`${String(weight)} 15px "Roboto Variable"`)),
);

const { default: Gallery } = await import("./Gallery.svelte");
const target = document.getElementById("app");
if (target) mount(Gallery, { target });
