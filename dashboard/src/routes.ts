/** Pages by their path after the #. All but the start page load on demand. */
import { wrap } from "svelte-spa-router/wrap";
import NotFound from "./pages/NotFound.svelte";
import Runs from "./pages/Runs.svelte";
import RunGate, { type RunPageLoader } from "./parts/RunGate.svelte";

/** Returns the route of a page of a run, which opens if the run exists. */
const ofRun = (load: RunPageLoader) => wrap({ component: RunGate, props: { load } });

export const routes = {
  "/": Runs,
  "/runs/:run": ofRun(() => import("./pages/Run.svelte")),
  "/runs/:run/failures": ofRun(() => import("./pages/Failures.svelte")),
  "/runs/:run/episodes": ofRun(() => import("./pages/Episodes.svelte")),
  "/runs/:run/episodes/:episode": ofRun(() => import("./pages/Replay.svelte")),
  "/runs/:run/designs": ofRun(() => import("./pages/Designs.svelte")),
  "/runs/:run/designs/:design": ofRun(() => import("./pages/Design.svelte")),
  "/compare": wrap({ asyncComponent: () => import("./pages/CompareRuns.svelte") }),
  "/evaluations": wrap({ asyncComponent: () => import("./pages/Evaluations.svelte") }),
  "/evaluations/compare": wrap({ asyncComponent: () => import("./pages/Compare.svelte") }),
  "/evaluations/:evaluation": wrap({ asyncComponent: () => import("./pages/Evaluation.svelte") }),
  "/server": wrap({ asyncComponent: () => import("./pages/Server.svelte") }),
  "/workers": wrap({ asyncComponent: () => import("./pages/Workers.svelte") }),
  "/alerts": wrap({ asyncComponent: () => import("./pages/Alerts.svelte") }),
  "/play": wrap({ asyncComponent: () => import("./pages/Play.svelte") }),
  "*": NotFound,
};
