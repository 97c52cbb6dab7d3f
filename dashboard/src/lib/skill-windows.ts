/** Episodes over which a place of the dashboard averages skill. Each place names its window after a comma, as the glossary does. */

interface SkillWindow {
  /** Name of the column or the curve. */
  name: string;
  /** What the window has, for a title. */
  title: string;
}

export const SKILL_WINDOWS = {
  recent: {
    name: "Skill, recent",
    title:
      "Mean skill of the latest episodes of all tasks: the weight of an episode halves every 1,000 episodes. Skill is measured at the level of the run: compare runs at equal levels",
  },
  training: { name: "Skill, all episodes", title: "Mean skill of all training episodes of the task" },
  lastQuarter: {
    name: "Skill, last quarter",
    title:
      "Mean skill of the last quarter of the task's episodes at the current level, minus that of the quarter before; steady within three standard errors",
  },
  lastTenth: { name: "Skill, last tenth", title: "Mean skill of the last tenth of the run's points" },
  scenarios: {
    name: "Skill, all scenarios",
    title: "Mean skill over all scenarios of the evaluation, with its 95 % interval",
  },
  point: { name: "skill, each point", title: "Mean skill of the episodes of each point" },
} as const satisfies Record<string, SkillWindow>;
