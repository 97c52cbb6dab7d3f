/** Makes an element focusable while its content overflows, so that it can be scrolled by keyboard. */
export function keyboardScrollable(node: HTMLElement) {
  const update = () => {
    if (node.scrollWidth > node.clientWidth || node.scrollHeight > node.clientHeight) node.tabIndex = 0;
    else node.removeAttribute("tabindex");
  };
  const resizeObserver = new ResizeObserver(update);
  resizeObserver.observe(node);
  for (const child of node.children) resizeObserver.observe(child);
  const childObserver = new MutationObserver(update);
  childObserver.observe(node, { childList: true });
  return () => {
    resizeObserver.disconnect();
    childObserver.disconnect();
  };
}
