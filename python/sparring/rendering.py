"""Images of environments, and the window that shows them."""

from __future__ import annotations

from typing import Any

from .errors import invalid, one_of

#: Frames per second of the window and of recorded videos.
FPS = 10
#: Maximum length of one side of an image, pixels.
MAX_SIDE_PIXELS = 4096


class Renderer:
    """Renders environments as arrays of pixels, or in a window."""

    #: Number of open windows of this process.
    _open_windows = 0

    def __init__(self, mode: str | None, size: tuple[int, int], metadata: dict[str, Any]) -> None:
        if mode is not None and mode not in metadata["render_modes"]:
            raise one_of("render_mode", tuple(metadata["render_modes"]), mode)
        try:
            width, height = (int(side) for side in size)
        except (TypeError, ValueError):
            raise invalid("render_size", "a width and a height in pixels", size) from None
        if not (64 <= width <= MAX_SIDE_PIXELS and 64 <= height <= MAX_SIDE_PIXELS):
            raise invalid("render_size", f"two sides from 64 to {MAX_SIDE_PIXELS} pixels", (width, height))
        self.mode, self.width, self.height = mode, width, height
        self._window: Any = None
        self._clock: Any = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of an image, pixels."""
        return self.width, self.height

    def render(self, native: Any, env: int) -> Any:
        """Returns an image in mode `rgb_array`; shows it in a window and returns None in mode `human`."""
        if self.mode is None:
            import gymnasium

            gymnasium.logger.warn('render() needs a render mode: make the environment with render_mode="rgb_array".')
            return None
        pixels = native.render(env, self.width, self.height)
        if self.mode == "rgb_array":
            return pixels
        self._show(pixels)
        return None

    def _show(self, pixels: Any) -> None:
        try:
            import pygame
        except ImportError as error:
            from gymnasium.error import DependencyNotInstalled

            raise DependencyNotInstalled("pygame is not installed: pip install 'sparring[human]'") from error
        if self._window is None:
            pygame.display.init()
            Renderer._open_windows += 1
            pygame.display.set_caption("Sparring")
            self._window = pygame.display.set_mode((self.width, self.height))
            self._clock = pygame.time.Clock()
        surface = pygame.surfarray.make_surface(pixels.swapaxes(0, 1))
        self._window.blit(surface, (0, 0))
        pygame.event.pump()
        self._clock.tick(FPS)
        pygame.display.flip()

    def close(self) -> None:
        """Closes the window, if it is open."""
        if self._window is not None:
            import pygame

            # pygame has a single window, shared by all renderers.
            Renderer._open_windows -= 1
            if Renderer._open_windows == 0:
                pygame.display.quit()
            self._window = None
