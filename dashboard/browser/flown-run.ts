/** Runs whose episodes have actions, for the tests of replays. */
import { waitFor } from "./poll";
import type { Lease, SparringServer } from "./server";

/** Actions of a step, each with its agent; `episode` is the index of the episode. */
type ActionsAt = (step: number, episode: number) => number[][];

/** A run of one task, and the actions of its episodes. */
export interface FlownTask {
  task: string;
  steps: number;
  actionsAt: ActionsAt;
}

/** Number of episodes of a group. */
export const GROUP_SIZE = 12;

/** Episodes of each world in which the agents act. */
export const FLOWN_TASKS: Record<"kessler" | "docking" | "tasking", FlownTask> = {
  kessler: {
    task: "kessler/survival",
    steps: 50,
    actionsAt: (step, episode) =>
      step % 9 === 2 * (episode % 4) + 1 ? [[step % 3, 0.3 - 0.1 * (episode % 4), 0.2]] : [],
  },
  docking: {
    task: "docking/multiagent",
    steps: 60,
    actionsAt: (step, episode) => [
      [0, 0.3 * ((step % 3) - 1), 0.2, 0],
      [1, -0.2, 0.05 * (episode % 4), 0.1],
    ],
  },
  // All satellites charge, and image now and then.
  tasking: {
    task: "tasking/constellation",
    steps: 40,
    actionsAt: (step) => [0, 1, 2].map((agent) => [agent, step % 5 === 4 ? agent : 10]),
  },
};

/** Creates a run without designs, and reports `groups` groups of episodes. Returns their ids in the order of the lease. */
export async function createFlownRun(
  server: SparringServer,
  id: string,
  { task, steps, actionsAt }: FlownTask,
  groups: number,
  settings: object = {},
): Promise<string[]> {
  await server.post("/v1/runs", {
    id,
    seed: 5,
    tasks: [task],
    strategy: "fixed",
    placement: false,
    group_size: GROUP_SIZE,
    design: { designer: "off" },
    ...settings,
  });
  const lease = await waitFor(
    () => server.post<Lease>(`/v1/runs/${id}/leases`, { groups }).catch(() => null), // not ready: a status of 503
    (found) => found !== null,
  );
  const episodes = (lease?.groups ?? []).flatMap((group) => group.episodes);
  const results = episodes.map((episode, index) => ({
    episode,
    actions: {
      steps: Array.from({ length: steps }, (_, step) => actionsAt(step, index)),
      stopped: "too_late",
    },
  }));
  await server.post(`/v1/runs/${id}/results`, { results });
  return episodes;
}
