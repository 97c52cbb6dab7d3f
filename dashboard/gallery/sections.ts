/** Sections of the gallery, in their order. */
import type { Component } from "svelte";
import ChartSection from "./sections/ChartSection.svelte";
import CompareSection from "./sections/CompareSection.svelte";
import DialogSection from "./sections/DialogSection.svelte";
import DistributionSection from "./sections/DistributionSection.svelte";
import PartSection from "./sections/PartSection.svelte";
import ReplaySection from "./sections/ReplaySection.svelte";
import RunSection from "./sections/RunSection.svelte";
import RunTableSection from "./sections/RunTableSection.svelte";
import TaskSection from "./sections/TaskSection.svelte";
import WorkerSection from "./sections/WorkerSection.svelte";

interface GallerySection {
  id: string;
  name: string;
  component: Component;
}

export const SECTIONS: GallerySection[] = [
  { id: "charts", name: "Charts", component: ChartSection },
  { id: "distributions", name: "Distributions", component: DistributionSection },
  { id: "parts", name: "Parts", component: PartSection },
  { id: "dialogs", name: "Dialogs", component: DialogSection },
  { id: "table", name: "Table of runs", component: RunTableSection },
  { id: "tasks", name: "Tasks of a run", component: TaskSection },
  { id: "run", name: "Tabs of a run", component: RunSection },
  { id: "replay", name: "Replay", component: ReplaySection },
  { id: "compare", name: "Comparison of runs", component: CompareSection },
  { id: "workers", name: "Workers", component: WorkerSection },
];
