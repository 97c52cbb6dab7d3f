/** Glossary terms with their explanations, as the documentation uses them. */
export const TERMS = {
  mastery:
    "Probability that the agent succeeds on contested scenarios of its current level: mean of the posterior, with an 80 % credible interval.",
  contested:
    "A scenario in which actions matter: the reference succeeds; in survival and eco_station its score is also at least 0.05 above the floor, and at most half of the blind plans succeed. Success on other scenarios says little about the agent.",
  "blind panel":
    "Plans that use no observations: 16 plans of random burns in survival and eco_station, eight fixed cycles of actions in the tasking tasks, only holding in other tasks. Their success rate is the chance level on the same scenarios.",
  skill:
    "Position of a score between floor and reference: 0 is the floor, 1 the reference or better, −1 as far below the floor. Undefined if the two differ by less than 0.05.",
  floor:
    "Score without acting on observations: the mean score of the blind plans in survival and eco_station; the best of them, at least 0, in the tasking tasks; in other tasks, the score of holding.",
  reference:
    "Score of a planner with hindsight: it knows debris beyond the radar and rogues that appear later, or the whole orbit with its windows. Agents can exceed it.",
  regret:
    "Mean shortfall of agents on a layout: 1 − skill; on a decoy, the missing share of the reference's score.",
  "as aimed":
    "Share of the failed, analysed episodes on the layout that have the failure it was designed for.",
  decoy: "A layout that looks dangerous although holding is right: it tests whether the agent wastes fuel.",
  avoidable: "Failure that a burn could still have averted when the danger first became visible.",
  "zero variance":
    "A group whose episodes all have the same score: group-relative algorithms (GRPO) get no learning signal from it.",
  sampler:
    "Part of the strategy that chooses the next scenario of a task, by the latest results. It claims no mastery.",
  rung: "Step of difficulty of a task: a start rung, which is a value of the param start_scale, or a level.",
  chain:
    "Position on the rungs that a staircase moves up after a success and down after a failure. A task has many.",
  job: "Work that any machine can compute from its message alone: the preparation of a scenario, the replay of results (audit), or a critique.",
  "remote worker":
    "Program `sparring worker` on another machine. It does jobs of the server and keeps nothing: it can be stopped at any time.",
  role: "Purpose of the scenario: current level (frontier), search for the initial level (placement), earlier levels (rehearsal), a designed layout, or the suite of an evaluation; other strategies have more.",
} as const;

export type TermName = keyof typeof TERMS;
