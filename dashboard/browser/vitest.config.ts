import { defineConfig } from "vitest/config";

// Real browsers before real services: two at a time.
export default defineConfig({
  test: {
    root: new URL("..", import.meta.url).pathname,
    include: ["browser/**/*.test.ts"],
    globalSetup: ["browser/seeded.ts"],
    testTimeout: 300_000,
    hookTimeout: 900_000,
    maxWorkers: 2,
    expect: { poll: { timeout: 15_000 } }, // two cores, a server and a browser
  },
});
