/** Whether a task is being learnt, in one sentence, and what its operator can change. */
import type { FailureModeCounts, TaskMastery, TaskSeries } from "../lib/api-types";
import { avoidableShare } from "../lib/failure-rates";
import { fixed, percent } from "../lib/format";
import { skillTrend } from "../lib/trend";

/** Answer to "is it learning": `mastered` if nothing is left to learn at the levels of the run, `fixed` if its policy never changed. */
export type Answer = "learning" | "mastered" | "fixed" | "steady" | "worse" | "unknown";

export interface Verdict {
  answer: Answer;
  /** The answer with its reason. */
  sentence: string;
  /** What the operator can change; empty if nothing needs a change. */
  advice: string;
}

/** What a verdict needs to know beside the state of the task. */
export interface VerdictFacts {
  /** Curve of the task over its episodes; undefined before there are results. */
  curve: Pick<TaskSeries, "skill" | "success" | "level" | "version_low" | "version_high"> | undefined;
  /** Highest level of the task; undefined for tasks without levels. */
  topLevel: number | undefined;
  /** Most frequent recent failure mode. */
  failure: FailureModeCounts | undefined;
  /** Number of designed layouts in training. */
  layouts: number;
}

/** Mastery, or success without a level, from which on a task has little left to teach. */
const MASTERED = 0.9;
/** Mastery at or below which most scenarios are out of reach. */
const OUT_OF_REACH = 0.1;
/** Least number of points with a policy version that show that the policy is fixed. */
const MIN_POINTS = 8;
/** Share of missing outcomes that delays the curriculum. */
const NOTABLE_MISSING = 0.1;
/** Share of groups with equal scores above which most groups teach a group learner nothing. */
const NOTABLE_ZERO_VARIANCE = 0.5;
/** Share of avoidable failures from which on a better policy can prevent most of them. */
const MOSTLY_AVOIDABLE = 0.5;

/** Returns the verdict on a task: first its level, then the trend of its skill, decide. */
export function verdictOf(task: TaskMastery, facts: VerdictFacts): Verdict {
  const { answer, sentence } = answerOf(task, facts);
  return { answer, sentence, advice: adviceOf(answer, task, facts) };
}

function answerOf(task: TaskMastery, { curve, topLevel }: VerdictFacts): Omit<Verdict, "advice"> {
  if (typeof task.probe_level === "number")
    return { answer: "unknown", sentence: "Placement looks for its first level." };
  const trend = curve ? skillTrend(curve) : null;
  const [before, now] = levelsOf(curve?.level ?? []);
  const success = task.mastery && task.mastery.n > 0 ? task.mastery.mean : lastQuarter(curve?.success ?? []);
  const isAtTop = topLevel === undefined || typeof task.level !== "number" || task.level >= topLevel;
  const version = curve ? onlyVersion(curve) : null;
  if (version !== null)
    return {
      answer: "fixed",
      sentence: `No: all of its episodes have policy version ${String(version)}. A fixed policy does not learn.`,
    };
  if (before !== null && now !== null && now > before)
    return {
      answer: "learning",
      sentence: `Yes: its level rose from ${String(before)} to ${String(now)} in the second half of its episodes.`,
    };
  if (isAtTop && typeof success === "number" && success >= MASTERED)
    return {
      answer: "mastered",
      sentence: `It has little left to learn here: ${percent(success)} success ${placeOf(task, topLevel)}.`,
    };
  if (before !== null && now !== null && now < before)
    return {
      answer: "worse",
      sentence: `No: its level fell from ${String(before)} to ${String(now)} in the second half of its episodes.`,
    };
  const where = typeof task.level === "number" ? ` at level ${String(task.level)}` : "";
  if (!trend) return { answer: "unknown", sentence: `Too few episodes${where} to say.` };
  const size = fixed(Math.abs(trend.difference));
  if (trend.direction === "rising")
    return { answer: "learning", sentence: `Yes: its skill rises${where}, by ${size} in the last quarter.` };
  if (trend.direction === "falling")
    return { answer: "worse", sentence: `No: its skill falls${where}, by ${size} in the last quarter.` };
  return { answer: "steady", sentence: `Not now: its skill is steady${where}.` };
}

/** Returns the policy version of all points if they have the same one; null if versions differ, or are unknown for most points. */
function onlyVersion({
  version_low: low,
  version_high: high,
}: Pick<TaskSeries, "version_low" | "version_high">): number | null {
  const versions = [...low, ...high].filter((version) => version !== null);
  const [first] = versions;
  if (first === undefined || versions.length < Math.max(low.length, MIN_POINTS)) return null;
  return versions.every((version) => version === first) ? first : null;
}

function placeOf({ level }: TaskMastery, topLevel: number | undefined): string {
  if (topLevel === undefined) return "in the last quarter of its episodes";
  return typeof level === "number" && level === topLevel
    ? "at the hardest level"
    : `at level ${String(level ?? 0)}`;
}

/** Returns the mean of the known values of the last quarter; null without any. */
function lastQuarter(values: (number | null)[]): number | null {
  const known = values.slice(-Math.ceil(values.length / 4)).filter((value) => value !== null);
  return known.length > 0 ? known.reduce((sum, value) => sum + value, 0) / known.length : null;
}

/** Returns the levels in the middle and at the end of the episodes; null if they are unknown. */
function levelsOf(levels: (number | null)[]): [number | null, number | null] {
  const middle = Math.floor(levels.length / 2);
  const known = (part: (number | null)[]) => part.findLast((level) => level !== null) ?? null;
  return [known(levels.slice(0, middle)), known(levels)];
}

function adviceOf(answer: Answer, task: TaskMastery, { topLevel, failure, layouts }: VerdictFacts): string {
  const { mastery, group_counts, results } = task;
  const missing = mastery && mastery.n > 0 ? mastery.missing : (results.missing ?? 0);
  if (missing >= NOTABLE_MISSING)
    return `${percent(missing)} of its outcomes are missing and count as failures: find out why episodes end without a result.`;
  if (answer === "mastered")
    return topLevel === undefined || task.level === topLevel
      ? "Add harder levels, or give other tasks more weight."
      : "Raise the level, or use a strategy that does.";
  if (answer === "worse")
    return "Compare the policy versions by evaluations, and continue from the best one.";
  if (answer === "fixed")
    return "If the trainer changes its policy, let it send a new policy version with the results.";
  if (answer !== "steady") return "";
  if (mastery && mastery.n > 0 && mastery.mean <= OUT_OF_REACH)
    return task.level === 0
      ? "Its easiest level is out of reach: add an easier one, or create a run with a strategy that has start rungs."
      : "Most scenarios at this level are out of reach: lower the level, or use a strategy that does.";
  const equal = group_counts.zero_variance_share ?? 0;
  if (equal > NOTABLE_ZERO_VARIANCE)
    return `${percent(equal)} of its groups have equal scores and teach a group learner nothing: create a run with the target half.`;
  if (failure && (avoidableShare(failure) ?? 0) >= MOSTLY_AVOIDABLE && layouts === 0)
    return `${percent(avoidableShare(failure))} of the failures “${failure.mode.replaceAll("_", " ")}” are avoidable: let a designer aim at them.`;
  return "Change the settings of the learner, such as its learning rate: the curriculum offers no easier step.";
}
