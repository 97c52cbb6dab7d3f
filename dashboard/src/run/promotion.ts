/** Texts about the next level of a task: its conditions, its progress, and the results that hold it back. */
import type { LevelTable, RunSummary, TaskMastery } from "../lib/api-types";
import { countOf, fixed } from "../lib/format";

/** Part of `TaskMastery.status` that this page reads. */
interface PromotionStatus {
  block?: { n: number; size: number; mean: number | null; open: number; waiting: number } | null;
  move_conditions?: { up: string | null; down: string | null } | null;
}

/** Strategy of a run, the target of its ladder, and the level tables of its tasks, as its settings have them. */
export interface CurriculumChoice {
  strategy: string;
  target: string;
  levels: Map<string, LevelTable>;
}

/** Part of the settings of a run that this page reads. */
interface CurriculumSettings {
  strategy?: string;
  target?: string;
  tasks?: (LevelTable & { task: string })[];
}

/** Returns strategy, target and level tables of the current settings of a run. */
export function curriculumChoice(run: Pick<RunSummary, "settings"> | null): CurriculumChoice {
  const settings = (run?.settings as { curriculum?: CurriculumSettings } | undefined)?.curriculum ?? {};
  return {
    strategy: settings.strategy ?? "",
    target: settings.target ?? "",
    levels: new Map((settings.tasks ?? []).map(({ task, columns, rows }) => [task, { columns, rows }])),
  };
}

/**
 * Returns the thresholds of mastery that move the level; empty under strategies without levels, and with the target `half`, which
 * compares the mean of a block instead.
 */
export function masteryThresholds({
  strategy,
  target,
}: Pick<CurriculumChoice, "strategy" | "target">): number[] {
  return strategy === "ladder" && target === "mastery" ? [0.3, 0.7] : [];
}

/** Returns the progress towards the next level in one sentence; empty for a task without levels. */
export function promotionText(task: Pick<TaskMastery, "status" | "level" | "probe_level">): string {
  const { block, move_conditions } = task.status as PromotionStatus;
  if (!move_conditions) return "";
  if (!move_conditions.up) return "The hardest level is reached.";
  const condition = `${move_conditions.up.charAt(0).toUpperCase()}${move_conditions.up.slice(1)}`;
  if (!block) return `${condition}.`;
  const mean = block.mean === null ? "" : `, mean success ${fixed(block.mean)}`;
  const open = block.open > 0 ? `, ${countOf(block.open, "leased scenario")} without a result` : "";
  return `${condition}. Now: ${String(block.n)} of ${String(block.size)} scenarios have results${mean}${open}.`;
}
