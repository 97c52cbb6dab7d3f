import { defineConfig } from "vitest/config";

// At most two test files run at the same time, each with a browser and a server.
export default defineConfig({
  test: {
    root: new URL("..", import.meta.url).pathname,
    include: ["browser/**/*.test.ts"],
    globalSetup: ["browser/global-setup.ts"],
    testTimeout: 600_000,
    hookTimeout: 900_000,
    maxWorkers: 2,
    expect: { poll: { timeout: 120_000 } }, // generous: machines may be loaded
  },
});
