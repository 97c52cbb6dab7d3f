/** Texts about the level moves of a run. */
import type { RecordedMove } from "../lib/api-types";

/** Returns the evidence of a move in one sentence, or the move itself. */
export function moveSentence(move: RecordedMove): string {
  const { sentence } = move.evidence as { sentence?: string };
  return sentence ?? `${move.kind} to level ${String(move.to)}`;
}

/** Returns the levels of a move: "2 → 3". */
export function moveLevels({ from, to }: RecordedMove): string {
  return typeof from === "number" ? `${String(from)} → ${String(to)}` : `→ ${String(to)}`;
}
