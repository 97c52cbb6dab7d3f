/** Texts for the states of designs. */

/** Defects of designs that fail a check of the gate, by the name of the check: the name itself says what the design lacks. */
const DEFECTS: Record<string, string> = {
  schema: "invalid",
  compiles: "not placeable",
  aim: "off target",
  fair: "unfair",
  solvable: "unsolvable",
  contested: "not contested",
  decoy: "ineffective decoy",
  new: "duplicate",
};

/** Describes the defect of a design that failed a check of the gate. */
export function refusalText(check: string): string {
  return DEFECTS[check] ?? `failed the check ${check.replaceAll("_", " ")}`;
}

/** Reasons of retirement whose names say too little. */
const RETIREMENTS: Record<string, string> = { user: "by a user", wrong: "judged wrongly by a worker" };

/** Describes the state of a design with its reason: "refused: duplicate", "retired: mastered". */
export function designStateText(state: string, reason: string | null | undefined): string {
  if (!reason) return state;
  if (state === "refused") return `refused: ${refusalText(reason)}`;
  return `${state}: ${RETIREMENTS[reason] ?? reason.replaceAll("_", " ")}`;
}
