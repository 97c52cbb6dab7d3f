/** History of the browser, for pages that keep their view in the address. */

/** Keys under which the router keeps the scroll position of an entry of the history. */
const SCROLL_KEYS = { x: "__svelte_spa_router_scrollX", y: "__svelte_spa_router_scrollY" } as const;

/** Adds an entry with this address: the back button leads to the former view, at its scroll position. */
export function pushAddress(address: string) {
  const scroll = { [SCROLL_KEYS.x]: scrollX, [SCROLL_KEYS.y]: scrollY };
  history.replaceState({ ...(history.state as object | null), ...scroll }, "");
  history.pushState(null, "", address);
}
