import { mount } from "svelte";
import App from "./App.svelte";
import "uplot/dist/uPlot.min.css";
import "./app.css";

// OpenEnv users expect a playable page at /web/: open the play page there.
if (location.pathname.startsWith("/web") && location.hash === "") location.hash = "#/play";

const target = document.getElementById("app");
if (target) mount(App, { target });
