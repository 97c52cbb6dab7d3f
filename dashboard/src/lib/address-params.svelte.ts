/** Filters and selections of a page that its address holds. */
import { untrack } from "svelte";
import { addressQuery, replaceQuery } from "./page-history";

/**
 * Returns parameters of the address of the page at `route` as state; an empty text is the default. A change replaces the address, and
 * another address of the same page changes the state. Call it while a component starts.
 */
export function addressParams<Name extends string>(
  route: () => string,
  names: readonly Name[],
): Record<Name, string> {
  function read(): Record<Name, string> {
    const query = addressQuery(untrack(route));
    return Object.fromEntries(names.map((name) => [name, query?.get(name) ?? ""])) as Record<Name, string>;
  }

  const params = $state(read());
  let shown = untrack(route);
  $effect(() => {
    const [current, values] = [route(), $state.snapshot(params) as Record<Name, string>];
    if (current === shown) replaceQuery(current, values);
    else {
      shown = current;
      untrack(() => Object.assign(params, read()));
    }
  });
  $effect(() => {
    const update = () => {
      if (addressQuery(untrack(route))) Object.assign(params, read());
    };
    addEventListener("hashchange", update);
    return () => removeEventListener("hashchange", update);
  });
  return params;
}
