/** Work for elements that the user sees. */

/** Distance from the window at which an element counts as visible, so that its data are there when the user scrolls. */
const MARGIN = "200px";

/**
 * Attachment: calls `enter` when the element comes near the window, and the function that `enter` returned when it leaves or is
 * removed.
 */
export function whileVisible(enter: () => () => void): (element: Element) => () => void {
  return (element) => {
    let leave: (() => void) | undefined;
    const observer = new IntersectionObserver(
      (entries) => {
        const isVisible = entries.at(-1)?.isIntersecting ?? false;
        if (isVisible) leave ??= enter();
        else {
          leave?.();
          leave = undefined;
        }
      },
      { rootMargin: MARGIN },
    );
    observer.observe(element);
    return () => {
      observer.disconnect();
      leave?.();
    };
  };
}
