import { fileURLToPath } from "node:url";
import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig } from "vite";

/** The gallery is a page of its own: nothing of it is part of the dashboard that the server serves. */
export default defineConfig({
  root: fileURLToPath(new URL(".", import.meta.url)),
  base: "./",
  plugins: [svelte({ configFile: fileURLToPath(new URL("../svelte.config.js", import.meta.url)) })],
  // The files are not served over a network: a build takes half the time without minification.
  build: { target: "es2022", minify: false, emptyOutDir: true },
});
