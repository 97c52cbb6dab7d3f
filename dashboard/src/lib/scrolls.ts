/** What is larger than its place can be scrolled by the keyboard, too: it takes the focus while it is. */
export function scrolls(node: HTMLElement) {
  const look = () => {
    if (node.scrollWidth > node.clientWidth || node.scrollHeight > node.clientHeight) node.tabIndex = 0;
    else node.removeAttribute("tabindex");
  };
  const sized = new ResizeObserver(look);
  sized.observe(node);
  for (const child of node.children) sized.observe(child);
  const filled = new MutationObserver(look);
  filled.observe(node, { childList: true });
  return () => {
    sized.disconnect();
    filled.disconnect();
  };
}
