/** Reasons for the verdicts of a critique; docs/reference/critique.md has the rules. */
import type { EpisodeCritique } from "../lib/api-types";
import { fixed } from "../lib/format";

type ActionValue = EpisodeCritique["actions"][number];

/** Difference of scores above which a verdict depends on the score: that of kessler and tasking, and that of docking. */
const RELEVANT_GAIN = { kessler: 0.001, docking: 0.05 };
/** Tasks of kessler whose episodes have a goal besides the survival of the satellites. */
const GOAL_TASKS = ["kessler/rendezvous", "kessler/formation"];
/** Failure modes in which a satellite is lost; so is one with the mode `risk` and an encounter. */
const LOSS_MODES = ["collision", "rogue", "fragment", "decay"];

/** Returns the reason for a verdict: the comparison of the episode with the same episode without the action. */
export function verdictReason(action: ActionValue, critique: EpisodeCritique): string {
  if (action.verdict === "harmless") return "No relevant effect on losses, goal or score.";
  if (action.verdict === "wasteful") return "Prevents no loss and lowers the score.";
  const { task } = critique;
  if (task.startsWith("docking/")) return dockingReason(action);
  const hasGoal = GOAL_TASKS.includes(task);
  const isRelevant = Math.abs(action.gain) > RELEVANT_GAIN.kessler;
  if (action.verdict === "needed") {
    if (isRelevant && action.gain > 0) return "Raises the score.";
    return hasGoal
      ? "Without it, more satellites are lost or the goal is missed."
      : "Without it, more satellites are lost.";
  }
  if (isRelevant && action.gain < 0)
    return hasGoal
      ? "With it, satellites are lost, or lost earlier, or the goal is missed."
      : "With it, more satellites are lost, or they are lost earlier.";
  return hasGoal
    ? `With it, more satellites are lost or the goal is missed${onlyLoss(critique)}.`
    : `With it, more satellites are lost${onlyLoss(critique)}.`;
}

function dockingReason({ verdict, gain }: ActionValue): string {
  const isRelevant = Math.abs(gain) >= RELEVANT_GAIN.docking;
  if (verdict === "needed")
    return isRelevant && gain > 0 ? "Raises the return of the deputy." : "The deputy docks only with it.";
  return isRelevant && gain < 0
    ? "With it, the deputy collides, does not dock, or has a lower return."
    : "With it, the deputy collides or does not dock.";
}

/** Returns the loss of the episode in parentheses if there is exactly one. */
function onlyLoss({ failures }: EpisodeCritique): string {
  const losses = failures.filter(
    ({ mode, encounter }) => LOSS_MODES.includes(mode) || (mode === "risk" && encounter),
  );
  const [loss] = losses;
  return loss && losses.length === 1
    ? ` (satellite ${String(loss.agent)}: ${loss.mode}, step ${String(loss.step)})`
    : "";
}

/** Noun for an action of the critique's world. */
export function actionNoun({ task }: EpisodeCritique): string {
  if (task.startsWith("tasking/")) return "action";
  return task.startsWith("docking/") ? "thrust" : "burn";
}

/** Formats the difference of the scores with and without an action, with its sign: "+0.042". */
export function formatGain(gain: number): string {
  return `${gain > 0 ? "+" : ""}${fixed(gain, 3).replace("-", "−")}`;
}
