/** Polls of conditions; unlike `expect.poll` they also work outside of tests and return the value. */

const INTERVAL_MS = 100;
const TIMEOUT_MS = 120_000;

/**
 * Calls `read` until `isExpected` accepts its result, and returns that result.
 * Throws an error with the last result after `timeoutMs`.
 */
export async function waitFor<T>(
  read: () => Promise<T>,
  isExpected: (value: T) => boolean,
  timeoutMs = TIMEOUT_MS,
): Promise<T> {
  const deadline = Date.now() + timeoutMs;
  for (;;) {
    const value = await read();
    if (isExpected(value)) return value;
    if (Date.now() > deadline)
      throw new Error(`not reached in ${String(timeoutMs)} ms; last value: ${JSON.stringify(value)}`);
    await new Promise((resolve) => setTimeout(resolve, INTERVAL_MS));
  }
}
