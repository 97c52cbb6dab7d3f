/**
 * Calls `load` every `ms` milliseconds while the page is visible and `enabled` returns true. A call starts only after the previous one
 * has ended, so that a slow service gets no more requests than it answers. Returns a function that stops the polling.
 */
export function pollEvery(ms: number, enabled: () => boolean, load: () => Promise<void>): () => void {
  let isLoading = false;
  const timer = setInterval(() => {
    if (isLoading || document.hidden || !enabled()) return;
    isLoading = true;
    void load().finally(() => (isLoading = false));
  }, ms);
  return () => clearInterval(timer);
}
