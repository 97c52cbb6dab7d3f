/** History of the browser, for pages that keep their view in the address. */

/** Keys under which the router keeps the scroll position of an entry of the history. */
const SCROLL_KEYS = { x: "__svelte_spa_router_scrollX", y: "__svelte_spa_router_scrollY" } as const;

/** Adds an entry with this address: the back button leads to the former view, at its scroll position. */
export function pushAddress(address: string) {
  const scroll = { [SCROLL_KEYS.x]: scrollX, [SCROLL_KEYS.y]: scrollY };
  history.replaceState({ ...(history.state as object | null), ...scroll }, "");
  history.pushState(null, "", address);
}

/** Returns the parameters of the address if it is the page at `route`; null on another page. */
export function addressQuery(route: string): URLSearchParams | null {
  const [shown, query] = location.hash.slice(1).split("?");
  return (shown || "/") === route ? new URLSearchParams(query) : null;
}

/** Returns the address of a page; parameters with an empty value are left out. Commas and slashes stay readable. */
export function addressOf(route: string, params: Iterable<[string, string]>): string {
  const query = new URLSearchParams([...params].filter(([, value]) => value !== "")).toString();
  const readable = query.replaceAll("%2C", ",").replaceAll("%2F", "/");
  return `#${route}${readable ? `?${readable}` : ""}`;
}

/** Changes parameters of the page at `route` in the address; an empty value removes one. Does nothing if the user has left the page. */
export function replaceQuery(route: string, changes: Readonly<Record<string, string>>) {
  const params = addressQuery(route);
  if (!params) return;
  for (const [name, value] of Object.entries(changes)) params.set(name, value);
  const address = addressOf(route, params);
  if (address !== location.hash) history.replaceState(history.state, "", address);
}
