/** Names of the API types that the dashboard uses. `schema.d.ts` is generated from the OpenAPI document. */
import type { components } from "./schema";

type Schema = components["schemas"];

export type Comparison = Schema["Comparison"];
export type ComparisonSide = Schema["Side"];
export type Design = Schema["Design"];
export type DesignRequest = Schema["AskView"];
export type DesignStatistics = Schema["Summary"];
export type DesignSummary = Schema["DesignHead"];
export type Episode = Schema["Episode"];
export type EpisodeCritique = Schema["EpisodeCritique"];
export type EpisodeSummary = Schema["EpisodeHead"];
export type Evaluation = Schema["Evaluation"];
export type EvaluationReport = Schema["EvaluationFound"];
export type EvaluationScenario = Schema["EvaluationScenario"];
export type FailureEntry = Schema["FailureHead"];
export type FailureModeProfile = Schema["ModeView"];
export type FailureProfiles = Schema["Profiles"];
export type LevelMove = Schema["MoveView"];
export type MasteryReport = Schema["Masteries"];
export type PolicyVersion = Schema["Version"];
export type Run = Schema["Run"];
export type RunOverview = Schema["Overview"];
export type RunRequest = Schema["RunWish"];
export type RunSeries = Schema["Series"];
export type ScenarioCheck = Schema["Checked"];
export type ScenarioRequest = Schema["Wish"];
export type SettingsVersion = Schema["Told"]["settings"][number];
export type Strategy = Schema["Strategy"];
export type SuiteList = Schema["Suites"];
export type Task = Schema["Task"];
export type TaskMastery = Schema["TaskMastery"];
export type TaskSeries = Schema["TaskSeries"];
