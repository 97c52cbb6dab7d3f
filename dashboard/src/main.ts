import { mount } from "svelte";
import App from "./App.svelte";
import "uplot/dist/uPlot.min.css";
import "./app.css";

// Users of OpenEnv expect to play at /web/: it is this page, opened there.
if (location.pathname.startsWith("/web") && location.hash === "") location.hash = "#/play";

const target = document.getElementById("app");
if (target) mount(App, { target });
