/** Types of the API that the dashboard uses, under their names in the OpenAPI document. */
import type { components } from "./schema";

type Schema = components["schemas"];

export type Comparison = Schema["Comparison"];
export type ComparisonSide = Schema["ComparisonSide"];
export type CreateDesignRequest = Schema["CreateDesignRequest"];
export type Design = Schema["Design"];
export type DesignRequestSummary = Schema["DesignRequestSummary"];
export type DesignStatistics = Schema["DesignStatistics"];
export type DesignSummary = Schema["DesignSummary"];
export type Episode = Schema["Episode"];
export type EpisodeCritique = Schema["EpisodeCritique"];
export type EpisodeFailure = Schema["EpisodeFailure"];
export type EpisodeSummary = Schema["EpisodeSummary"];
export type Evaluation = Schema["Evaluation"];
export type EvaluationScenario = Schema["EvaluationScenario"];
export type EvaluationSummary = Schema["EvaluationSummary"];
export type FailureModeCounts = Schema["FailureModeCounts"];
export type FailureProfiles = Schema["FailureProfiles"];
export type PolicyVersion = Schema["PolicyVersion"];
export type RecordedMove = Schema["RecordedMove"];
export type RunMastery = Schema["RunMastery"];
export type RunOverview = Schema["RunOverview"];
export type RunRequest = Schema["RunRequest"];
export type RunSeries = Schema["RunSeries"];
export type RunSettingsVersion = Schema["RunSettingsVersion"];
export type RunSummary = Schema["RunSummary"];
export type ScenarioCheck = Schema["ScenarioCheck"];
export type ScenarioRequest = Schema["ScenarioRequest"];
export type Strategy = Schema["Strategy"];
export type SuiteList = Schema["SuiteList"];
export type Task = Schema["Task"];
export type TaskMastery = Schema["TaskMastery"];
export type TaskSeries = Schema["TaskSeries"];
