/** Colours and dashes of agents, the same in pictures, curves and labels. */

/** Names of the colours of agents in the style of the page, by index. */
export const AGENT_COLOURS = ["--c0", "--c2", "--c3", "--c4"];
/** Dashes of agents, by index, so that their curves differ without colours too. */
const DASHES = ["", "7 3", "2 3", "9 3 2 3"];

/** Returns the colour of an agent for a style sheet; the colours repeat if there are more agents. */
export function agentColourName(agent: number): string {
  return `var(${AGENT_COLOURS[agent % AGENT_COLOURS.length] ?? "--ink"})`;
}

/** Returns the dashes of an agent's curve; empty for a solid one. */
export function agentDashes(agent: number): string {
  const turn = Math.floor(agent / AGENT_COLOURS.length); // agents of one colour have different dashes
  return DASHES[(agent + turn) % DASHES.length] ?? "";
}
