/** Pages by their path after the #. All but the start page load on demand. */
import { wrap } from "svelte-spa-router/wrap";
import NotFound from "./pages/NotFound.svelte";
import Runs from "./pages/Runs.svelte";

export const routes = {
  "/": Runs,
  "/runs/:run": wrap({ asyncComponent: () => import("./pages/Run.svelte") }),
  "/runs/:run/failures": wrap({ asyncComponent: () => import("./pages/Failures.svelte") }),
  "/runs/:run/episodes": wrap({ asyncComponent: () => import("./pages/Episodes.svelte") }),
  "/runs/:run/episodes/:episode": wrap({ asyncComponent: () => import("./pages/Replay.svelte") }),
  "/runs/:run/designs": wrap({ asyncComponent: () => import("./pages/Designs.svelte") }),
  "/runs/:run/designs/:design": wrap({ asyncComponent: () => import("./pages/Design.svelte") }),
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
