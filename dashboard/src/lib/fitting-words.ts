/** Words that fit into a cell of a table. */

/** Space of a word beside its letters, in characters: its badge and the gap to the next one. */
const FRAME = 3;

/**
 * Splits words into those that fit into lines of `chars` characters and the others; the last line leaves room for the number of the
 * others. The first word is always shown.
 */
export function fittingWords(
  words: readonly string[],
  { lines, chars }: { lines: number; chars: number },
): { shown: string[]; others: string[] } {
  let [line, used] = [1, 0];
  for (const [at, word] of words.entries()) {
    const size = Math.min(chars, word.length + FRAME);
    if (used + size > chars) [line, used] = [line + 1, 0];
    used += size;
    const isLast = at === words.length - 1;
    const hasRoom = line < lines || (line === lines && (isLast || used + FRAME + 2 <= chars));
    if (!hasRoom && at > 0) return { shown: words.slice(0, at), others: words.slice(at) };
  }
  return { shown: [...words], others: [] };
}
