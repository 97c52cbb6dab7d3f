/** Results of two sides of evaluations, scenario by scenario. */
import type { EvaluationScenario } from "../lib/api-types";

/** Quantity of a scenario that is compared. */
export type ScenarioMeasure = "score" | "skill" | "success";

/** Scenarios of one evaluation, with the run whose trainer ran them. */
export interface EvaluatedScenarios {
  evaluation: string;
  run: string | null;
  scenarios: EvaluationScenario[];
}

/** Replay of a scenario's first episode in one evaluation. */
export interface ScenarioReplay {
  evaluation: string;
  /** Address of the replay. */
  href: string;
}

/** One scenario on both sides. */
export interface ScenarioPair {
  scenario: EvaluationScenario;
  /** Mean value of the first side, and of the second. */
  a: number;
  b: number;
  replaysOfA: ScenarioReplay[];
  replaysOfB: ScenarioReplay[];
}

/** Returns the scenarios that both sides have, with their values; evaluations of one side are averaged. */
export function pairScenarios(
  sideA: EvaluatedScenarios[],
  sideB: EvaluatedScenarios[],
  measure: ScenarioMeasure,
): ScenarioPair[] {
  const [valuesA, valuesB] = [byIndex(sideA), byIndex(sideB)];
  return [...valuesA].flatMap(([index, of]) => {
    const [a, b] = [mean(of, measure), mean(valuesB.get(index) ?? [], measure)];
    const scenario = of[0]?.scenario;
    if (scenario === undefined || a === null || b === null) return [];
    return [{ scenario, a, b, replaysOfA: replays(of), replaysOfB: replays(valuesB.get(index) ?? []) }];
  });
}

interface EvaluatedScenario {
  evaluation: string;
  run: string | null;
  scenario: EvaluationScenario;
}

function byIndex(side: EvaluatedScenarios[]): Map<number, EvaluatedScenario[]> {
  const found = new Map<number, EvaluatedScenario[]>();
  for (const { scenarios, ...of } of side)
    for (const scenario of scenarios)
      found.set(scenario.index, [...(found.get(scenario.index) ?? []), { ...of, scenario }]);
  return found;
}

/** Returns the mean of the evaluations that have the value; null if none has it. */
function mean(of: EvaluatedScenario[], measure: ScenarioMeasure): number | null {
  const values = of.map(({ scenario }) => scenario[measure]).filter((value) => typeof value === "number");
  return values.length > 0 ? values.reduce((sum, value) => sum + value, 0) / values.length : null;
}

function replays(of: EvaluatedScenario[]): ScenarioReplay[] {
  return of.flatMap(({ evaluation, run, scenario }) =>
    run !== null && scenario.first_episode
      ? [{ evaluation, href: `#/runs/${run}/episodes/${scenario.first_episode}` }]
      : [],
  );
}

/** Returns the pairs with the largest differences in favour of A and of B. */
export function largestDifferences(pairs: ScenarioPair[], count: number): ScenarioPair[] {
  const sorted = pairs.filter(({ a, b }) => a !== b).sort((x, y) => y.a - y.b - (x.a - x.b));
  const [first, last] = [sorted.slice(0, count), sorted.slice(-count)];
  return [...first.filter(({ a, b }) => a > b), ...last.filter(({ a, b }) => a < b)];
}
