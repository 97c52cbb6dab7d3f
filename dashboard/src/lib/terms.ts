/** Glossary terms with their explanations, as the documentation uses them. */
export const TERMS = {
  mastery:
    "How surely the agent succeeds at the level in force: the mean of the posterior over its success on contested scenarios there, with the band that holds it four times in five.",
  contested:
    "A scenario is contested where acting well matters: the reference succeeds, and in survival and eco_station it earns at least 0.05 more than the floor while at most half of the blind plans succeed. Success elsewhere says little of the agent.",
  "blind panel":
    "16 plans that look at nothing: they were drawn beforehand, and burn where they burn. What they reach is what luck reaches on the same scenarios.",
  skill:
    "Where a score lies between floor and reference: 0 is the floor, 1 the reference or better, −1 as far below. None where the two are less than 0.05 apart.",
  floor:
    "What blind plans earn on average in survival and eco_station; in other tasks, what is earned where nobody acts.",
  reference:
    "What a planner earns with hindsight: it is shown debris that nobody sees and rogues to come. Agents can beat it: it is no bound on what is possible.",
  regret:
    "What agents left on the table on a layout, on average: 1 − skill; on a decoy, the share of the reference's score that they missed.",
  "as aimed":
    "Of the criticised episodes on the layout that failed, the share in which the failure that it was designed for was among those found.",
  decoy:
    "A layout that looks dangerous, and on which doing nothing is right: it asks that no fuel is wasted.",
  avoidable: "When the danger could first be seen, there was still a burn that would have averted it.",
  "zero variance":
    "A group whose episodes all have the same score: an algorithm that compares them with each other (GRPO) learns nothing from it.",
  origin:
    "What its group was for: the level in force (frontier), finding where to start (placement), levels already passed (rehearsal), a designed layout, an evaluation's suite; other strategies have more.",
} as const;

export type TermName = keyof typeof TERMS;
