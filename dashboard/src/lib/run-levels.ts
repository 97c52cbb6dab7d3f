/** Levels of the tasks of a run as text. */
import { shortTask } from "./format";

interface TaskLevel {
  task: string;
  level?: number | null | undefined;
}

/** Returns the level of a run in a few characters: that of its only task, or the range of all tasks; a dash without levels. */
export function levelRange(tasks: readonly TaskLevel[]): string {
  const levels = tasks.map(({ level }) => level).filter((level) => typeof level === "number");
  const [lowest, highest] = [Math.min(...levels), Math.max(...levels)];
  if (levels.length === 0) return "–";
  return lowest === highest ? String(lowest) : `${String(lowest)}–${String(highest)}`;
}

/** Returns the level of each task as a sentence. */
export function levelList(tasks: readonly TaskLevel[]): string {
  if (tasks.every(({ level }) => typeof level !== "number")) return "No task has a level";
  return tasks.map(({ task, level }) => `${shortTask(task)}: level ${String(level ?? "–")}`).join(", ");
}
