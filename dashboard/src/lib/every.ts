/**
 * Asks again and again, while somebody looks, and never before the last question was answered: a service that is slow is not asked more than it
 * answers. Gives what ends it.
 */
export function every(ms: number, wanted: () => boolean, ask: () => Promise<void>): () => void {
  let under = false;
  const timer = setInterval(() => {
    if (under || document.hidden || !wanted()) return;
    under = true;
    void ask().finally(() => (under = false));
  }, ms);
  return () => clearInterval(timer);
}
